// A system of one's own, stepped by hand: a load on a flexible joint.
//
// A motor at p carries a load at q through a spring k; the load also hangs on a spring to the ground and is pushed by a
// force f(t). The load must stay above a floor, but only the motor can be pushed:
//
//     q'' = k (p - q) - q + f(t),    p'' = k (q - p) + lambda,    0 <= w = q  _|_  lambda >= 0.
//
// lambda has to go through the motor and the joint before it reaches w: relative degree 4. What holds the load is
// therefore not a force: mu_1 ... mu_4, the measures of levels 1 to 4, stand for a lambda made of Dirac impulses and
// their derivatives, and at an impact even the motor's position jumps.
//
// Shown here: a linear system given as dense matrices, its relative degree, a march whose steps we take ourselves,
// and what can be read after each step.
//
// Build:  cmake -S examples/own_system -B build/own_system -DCMAKE_PREFIX_PATH=<where sweepvi is installed>
//         cmake --build build/own_system
//    or:  g++ -std=c++20 examples/own_system/main.cpp -o own_system $(pkg-config --cflags --libs sweepvi)
// Run:    own_system
//         mpirun -n 2 own_system -snes_vi_monitor          (any PETSc option)
//         own_system -h_inverse 1000                       (steps per second, 100 by default)
// Expect: @EXPECT@

#include <cstdio>
#include <vector>

#include "sweepvi/linear_dvi.hpp"
#include "sweepvi/time_march.hpp"

using namespace sweepvi;

namespace {

void simulate(MPI_Comm comm) {
  int rank = 0;
  MPI_Comm_rank(comm, &rank);

  // 1. The system x' = A x + B lambda + f, w = C x with x = (q, p, q', p'), row by row. All ranks give the same numbers;
  //    the library deals the rows out.
  const double k = 10.0;  // [1/s^2], per unit mass
  const PetscInt states = 4;
  const PetscInt constraints = 1;
  const std::vector<double> a = {0.0,      0.0, 1.0, 0.0,   //
                                 0.0,      0.0, 0.0, 1.0,   //
                                 -k - 1.0, k,   0.0, 0.0,   //
                                 k,        -k,  0.0, 0.0};
  const std::vector<double> b = {0.0, 0.0, 0.0, 1.0};
  const std::vector<double> c = {1.0, 0.0, 0.0, 0.0};
  const std::vector<double> x0 = {0.5, 0.5, 0.0, 0.0};
  const Signal push = {.offset = -1.0, .amplitude = 0.5, .frequency = 0.25};  // [m/s^2], [Hz]
  const LinearSystem system =
      LinearSystem::dense(comm, states, constraints, a, b, c, x0, {}, {Signal{}, Signal{}, push, Signal{}});

  // 2. How lambda reaches w. Throws if it never does, or if the steps would have no unique solution.
  const RelativeDegree relative_degree = analyse_relative_degree(system);
  check_markov_matrix(system, relative_degree);
  if (rank == 0) std::printf("relative degree %d\n", relative_degree.highest);

  // 3. The discretisation, and a march over [0, 5] s in equal steps. The march is a PETSc TS, its step a SNESVI.
  PetscInt per_second = 100;
  check(PetscOptionsGetInt(nullptr, nullptr, "-h_inverse", &per_second, nullptr));
  const double end = 5.0;
  const PetscInt steps = 5 * per_second;
  const auto problem = make_linear_dvi(system, relative_degree, Scheme::homsp,
                                       choose_form(Scheme::homsp, relative_degree), 0.0, end / static_cast<double>(steps));
  TimeMarch march(*problem, 0.0, end, steps);

  // 4. Step by step. w, level and mu hold this rank's constraints; the only one here lives on rank 0.
  if (rank == 0) std::printf("%6s %12s %6s %12s %12s %12s %12s\n", "t", "w", "level", "mu_1", "mu_2", "mu_3", "mu_4");
  while (march.steps_taken() < march.steps()) {
    const StepReport report = march.step();
    if (!report.certified) throw Error(ExitCode::unsolved, "a step could not be certified: " + report.reason);
    const bool eventful = !problem->events().empty();
    const bool tenth = march.steps_taken() % (per_second / 2) == 0;
    if (rank == 0 && (eventful || tenth)) {
      const std::vector<double>& mu = problem->mu();
      std::printf("%6.3f %12.5e %6d %12.5e %12.5e %12.5e %12.5e\n", march.time(), problem->w()[0], problem->level()[0],
                  mu[0], mu[1], mu[2], mu[3]);
    }
  }

  // 5. The end state, in our own coordinates. Rows are dealt out in order, so each rank prints after the one before it.
  check(PetscSynchronizedPrintf(comm, "%s", rank == 0 ? "end" : ""));
  {
    const ReadArray x(problem->x());
    for (PetscInt i = 0; i < x.size(); ++i) check(PetscSynchronizedPrintf(comm, " %.15e", x[i]));
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
