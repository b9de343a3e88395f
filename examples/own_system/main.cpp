// A system of one's own, stepped by hand: a load on a flexible joint.
//
// A motor at p carries a load at q through a spring k; the load also hangs on a spring to the ground and is
// pushed by a force f(t). The load must stay above a floor, but only the motor can be pushed:
//
//     q'' = k (p - q) - q + f(t),    p'' = k (q - p) + lambda,    0 <= w = q  _|_  lambda >= 0.
//
// lambda has to go through the motor and the joint before it reaches w: relative degree 4. What holds the
// load is therefore not a force: mu_1 ... mu_4, the measures of levels 1 to 4, stand for a lambda made of
// Dirac impulses and their derivatives, and at an impact even the motor's position jumps.
//
// Shown here: a linear system given as dense matrices, its relative degree, a march whose steps we take
// ourselves, and what can be read after each step.
//
// Build:  cmake -S examples/own_system -B build/own_system -DCMAKE_PREFIX_PATH=<where sweepvi is installed>
//         cmake --build build/own_system
//    or:  g++ -std=c++20 examples/own_system/main.cpp -o own_system $(pkg-config --cflags --libs sweepvi)
// Run:    own_system
//         mpirun -n 2 own_system -snes_monitor             (any PETSc option)
//         own_system -steps_per_second 1000                (100 by default)
// Expect: the load bounces at t = 1.3906 (exact 1.390600), stopped by mu_2 (velocity) and mu_3
//         (acceleration); z_4 > 0 takes it off again, and level 4 is not needed. It comes to stay at
//         t = 1.7349 (exact 1.734852). This program finds both too early, by less than 0.1, 0.015,
//         0.0015 s at 100, 1000, 10000 steps per second. From then on lambda = mu_4 / h = -f''/k - f
//         to first order and p = -f(t)/k to rounding. End state (q, q', p, p') = (0, 0, 0.05, 0).

#include <algorithm>
#include <cstdio>
#include <vector>

#include "sweepvi/linear_dvi.hpp"
#include "sweepvi/time_march.hpp"

using namespace sweepvi;

namespace {

void simulate(MPI_Comm comm) {
  int rank = 0;
  MPI_Comm_rank(comm, &rank);

  // 1. The system x' = A x + B lambda + f, w = C x with x = (q, q', p, p'), row by row. All ranks give
  //    the same numbers; the library deals the rows out, in order.
  const double k = 10.0;                                   // [1/s^2], per unit mass
  const std::vector<double> a = {0.0,      1.0, 0.0, 0.0,  //
                                 -k - 1.0, 0.0, k,   0.0,  //
                                 0.0,      0.0, 0.0, 1.0,  //
                                 k,        0.0, -k,  0.0};
  const std::vector<double> b = {0.0, 0.0, 0.0, 1.0};
  const std::vector<double> c = {1.0, 0.0, 0.0, 0.0};
  const std::vector<double> x0 = {0.5, 0.0, 0.5, 0.0};
  const Signal push = {.offset = -1.0, .amplitude = 0.5, .frequency = 0.25};  // [m/s^2], [Hz]
  const LinearSystem system = LinearSystem::dense(
      comm, {.A = a, .B = b, .C = c, .x0 = x0, .f = {Signal{}, push, Signal{}, Signal{}}});

  // 2. How lambda reaches w. Throws if it never does, or if the steps would have no unique solution.
  const RelativeDegree relative_degree = analyse_relative_degree(system);
  check_markov_matrix(system, relative_degree);
  if (rank == 0) std::printf("relative degree %d\n", relative_degree.highest);

  // 3. The discretisation, and a march over [0, 5] s in equal steps. The march is a PETSc TS,
  //    its step a SNESVI; -help lists their options.
  PetscInt per_second = 100;
  check(PetscOptionsGetInt(nullptr, nullptr, "-steps_per_second", &per_second, nullptr));
  const TimeGrid grid{.start = 0.0, .end = 5.0, .steps = 5 * per_second};
  const Form form = choose_form(system, relative_degree, Scheme::homsp);
  const auto problem = make_linear_dvi(system, relative_degree, Scheme::homsp, form, grid);
  TimeMarch march(*problem, grid);

  // 4. Step by step. w, level and mu hold this rank's constraints; the only one here lives on rank 0.
  if (rank == 0)
    std::printf("%6s %12s %6s %12s %12s %12s %12s\n", "t", "w", "level", "mu_1", "mu_2", "mu_3", "mu_4");
  while (march.steps_taken() < grid.steps) {
    const StepReport report = march.step();
    if (!report.certified) throw Error(ExitCode::unsolved, "a step could not be certified: " + report.reason);
    const bool eventful = !problem->events().empty();
    const bool half_second = march.steps_taken() % std::max<PetscInt>(1, grid.steps / 10) == 0;
    if (rank == 0 && (eventful || half_second)) {
      const std::vector<double>& mu = problem->mu();
      std::printf("%6.3f %12.5e %6d %12.5e %12.5e %12.5e %12.5e\n", march.time(), problem->w()[0],
                  problem->level()[0], mu[0], mu[1], mu[2], mu[3]);
    }
  }

  // 5. The end state, in our own coordinates. Each rank prints its rows after the one before it.
  check(PetscSynchronizedPrintf(comm, "%s", rank == 0 ? "end" : ""));
  {
    const ReadArray x(problem->x());
    for (PetscInt i = 0; i < x.size(); ++i)
      check(PetscSynchronizedPrintf(comm, " %.15e", x[i]));
  }
  check(PetscSynchronizedFlush(comm, stdout));
  check(PetscPrintf(comm, "\n"));
}

}  // namespace

int main(int argc, char** argv) {
  const Session session(argc, argv);  // first: every other object must die before PETSc does
  try {
    simulate(session.comm());
  } catch (const Error& error) {  // all ranks throw the same one
    int rank = 0;
    MPI_Comm_rank(session.comm(), &rank);
    if (rank == 0) std::fprintf(stderr, "own_system: %s\n", error.what());
    return static_cast<int>(error.code());
  }
  return 0;
}
