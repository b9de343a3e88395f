// Nonlinear mechanics with impacts: a row of carts on springs, with pendulums whose bobs swing between walls.
//
// The mass matrix depends on the angles, F holds a centrifugal force, and the gaps wall -+ (x + l sin phi)
// are nonlinear. pendulum_walls.hpp writes this as a NonlinearLagrangian: M, F, gaps, their gradient, and
// the derivatives that Newton's method needs.
//
// Shown here: the derivatives held against finite differences, a march by Moreau and Jean's scheme, and what
// becomes of the energy. With theta = 1/2 the scheme neither adds nor takes energy but at impacts, up to
// second order of the step.
//
// Run:    example_pendulum_walls
//         mpirun -n 2 example_pendulum_walls -count 100 -seconds 2
//         example_pendulum_walls -finite_differences          (instead of the Jacobian)
//         example_pendulum_walls -steps_per_second 1000       (100 by default)
// Expect: the derivatives agree with finite differences to 1e-6. A cart alone has 7 impacts in 5 s, the first
// at
//         0.027822 s, and the angle 0.058411 at 5 s (event-driven solution), found with an error of 0.0251,
//         0.00311, 0.00033 at 100, 1000, 10000 steps per second: first order. No bob ever passes a wall. Of
//         2.31 J, 1.70 J are lost at impacts; the balance, kinetic + potential + dissipated, is off by 8e-4,
//         8e-5, 8e-6 J at most (each impact costs O(h)), and without impacts (-wall 10) by O(h^2).
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "pendulum_walls.hpp"
#include "sweepvi/time_march.hpp"

using namespace sweepvi;

namespace {

void simulate(MPI_Comm comm) {
  PendulumWalls::Parameters parameters;
  PetscInt per_second = 100;
  PetscReal seconds = 5.0;
  PetscBool differences = PETSC_FALSE;
  MoreauJeanOptions options{.theta = 0.5};
  check(PetscOptionsGetInt(nullptr, nullptr, "-count", &parameters.count, nullptr));
  check(PetscOptionsGetReal(nullptr, nullptr, "-e", &parameters.e, nullptr));
  check(PetscOptionsGetReal(nullptr, nullptr, "-wall", &parameters.wall, nullptr));
  check(PetscOptionsGetReal(nullptr, nullptr, "-theta", &options.theta, nullptr));
  check(PetscOptionsGetReal(nullptr, nullptr, "-seconds", &seconds, nullptr));
  check(PetscOptionsGetInt(nullptr, nullptr, "-steps_per_second", &per_second, nullptr));
  check(PetscOptionsGetBool(nullptr, nullptr, "-finite_differences", &differences, nullptr));
  parameters.own_jacobian = differences == PETSC_FALSE;

  // 1. The system, and its derivatives against finite differences at the start.
  const PendulumWalls carts(comm, parameters);
  const Vector q = carts.initial_position();
  const Vector v = carts.initial_velocity();
  check(PetscPrintf(comm, "derivatives against finite differences: %.1e\n",
                    jacobian_error(carts, 0.0, q.get(), v.get())));

  // 2. A march in equal steps.
  const auto steps = static_cast<PetscInt>(std::lround(seconds * static_cast<double>(per_second)));
  const TimeGrid grid{.start = 0.0, .end = seconds, .steps = steps};
  const auto problem = make_moreau_jean(carts, options, grid);
  TimeMarch march(*problem, grid);
  PetscInt iterations = 0;
  PetscInt impacts = 0;
  double deepest = 0.0;
  const Energy start = problem->energy();
  const double total = start.kinetic + start.potential;
  check(PetscPrintf(comm, "%6s %14s %14s %12s %12s %12s %12s\n", "t", "x of cart 0", "angle 0", "kinetic",
                    "potential", "dissipated", "balance"));
  while (march.steps_taken() < grid.steps) {
    const StepReport report = march.step();
    if (!report.certified) throw Error(ExitCode::unsolved, "a step could not be certified: " + report.reason);
    iterations += report.iterations;
    deepest = std::max(deepest, problem->penetration());
    for (const StepEvent& event : problem->events())
      impacts += event.impact ? 1 : 0;
    if (march.steps_taken() % std::max<PetscInt>(1, grid.steps / 10) != 0) continue;

    // 3. Where the energy is.
    const Energy energy = problem->energy();
    const ReadArray at(problem->position());
    check(PetscPrintf(comm, "%6.3f %14.9f %14.9f %12.8f %12.8f %12.8f %12.3e\n", march.time(),
                      at.size() > 0 ? at[0] : 0.0, at.size() > 0 ? at[1] : 0.0, energy.kinetic,
                      energy.potential, energy.dissipated,
                      energy.kinetic + energy.potential + energy.dissipated - total));
  }
  MPI_Allreduce(MPI_IN_PLACE, &impacts, 1, MPIU_INT, MPI_SUM, comm);
  check(PetscPrintf(comm, "%d impacts, %d Newton iterations of SNES in %d steps, worst penetration %.2e\n",
                    static_cast<int>(impacts), static_cast<int>(iterations), static_cast<int>(grid.steps),
                    deepest));
}

}  // namespace

int main(int argc, char** argv) {
  const Session session(argc, argv);  // first: every other object must die before PETSc does
  try {
    simulate(session.comm());
  } catch (const Error& error) {  // all ranks throw the same one
    int rank = 0;
    MPI_Comm_rank(session.comm(), &rank);
    if (rank == 0) std::fprintf(stderr, "pendulum_walls: %s\n", error.what());
    return static_cast<int>(error.code());
  }
  return 0;
}
