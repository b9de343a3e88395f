// A nonlinear system of one's own: a chain of pendulums on flexible joints, each before a wall.
//
// The links q_i swing before a wall at angle 0, but only the motors p_i can be pushed, through flexible
// joints: relative degree 4, nonlinear. pendulum_chain.hpp has the equations and their zero-dynamics form,
// written as a ZdSystem: rates, sparsity pattern, Jacobian.
//
// Shown here: a ZdSystem, its Jacobian held against finite differences, and a march over it. Each step is a
// nonlinear box VI; its Newton iterations are SNESVI's, or the predictor's.
//
// Run:    example_pendulum_chain
//         mpirun -n 2 example_pendulum_chain -count 100
//         example_pendulum_chain -finite_differences       (instead of the Jacobian)
//         example_pendulum_chain -steps_per_second 1000    (100 by default)
// Expect: the Jacobian agrees with finite differences to 1e-7. A pendulum alone hits the wall at t = 0.578894
// (exact),
//         stopped by mu_2 and mu_3, and leaves it again; w = 0.168121 at t = 1 (exact), found with an error
//         of .034, .0035, .00035 at 100, 1000, 10000 steps per second: first order.

#include <cstdio>

#include "pendulum_chain.hpp"
#include "sweepvi/time_march.hpp"

using namespace sweepvi;

namespace {

void simulate(MPI_Comm comm) {
  PendulumChain::Parameters parameters;
  PetscInt per_second = 100;
  PetscBool differences = PETSC_FALSE;
  check(PetscOptionsGetInt(nullptr, nullptr, "-count", &parameters.count, nullptr));
  check(PetscOptionsGetInt(nullptr, nullptr, "-steps_per_second", &per_second, nullptr));
  check(PetscOptionsGetBool(nullptr, nullptr, "-finite_differences", &differences, nullptr));
  parameters.own_jacobian = differences == PETSC_FALSE;

  // 1. The system, and its Jacobian against finite differences at the start.
  const PendulumChain chain(comm, parameters);
  ZdJacobian derivative(chain);
  check(PetscPrintf(comm, "Jacobian against finite differences: %.1e\n",
                    derivative.error(0.0, chain.initial_state().get())));

  // 2. A march over [0, 3] s in equal steps.
  const TimeGrid grid{.start = 0.0, .end = 3.0, .steps = 3 * per_second};
  const auto problem = make_zd_dvi(chain, grid);
  TimeMarch march(*problem, grid);
  check(PetscPrintf(comm, "%6s %16s %10s\n", "t", "w of element 0", "in contact"));
  PetscInt iterations = 0;
  while (march.steps_taken() < grid.steps) {
    const StepReport report = march.step();
    if (!report.certified) throw Error(ExitCode::unsolved, "a step could not be certified: " + report.reason);
    iterations += report.iterations;
    if (march.steps_taken() % (grid.steps / 15) != 0) continue;
    PetscInt contacts = problem->active();
    MPI_Allreduce(MPI_IN_PLACE, &contacts, 1, MPIU_INT, MPI_SUM, comm);
    const double w0 = problem->w().empty() ? 0.0 : problem->w()[0];  // element 0 is rank 0's
    check(PetscPrintf(comm, "%6.3f %16.9e %10d\n", march.time(), w0, static_cast<int>(contacts)));
  }
  check(PetscPrintf(comm, "%d Newton iterations of SNES in %d steps\n", static_cast<int>(iterations),
                    static_cast<int>(grid.steps)));
}

}  // namespace

int main(int argc, char** argv) {
  const Session session(argc, argv);  // first: every other object must die before PETSc does
  try {
    simulate(session.comm());
  } catch (const Error& error) {  // all ranks throw the same one
    int rank = 0;
    MPI_Comm_rank(session.comm(), &rank);
    if (rank == 0) std::fprintf(stderr, "pendulum_chain: %s\n", error.what());
    return static_cast<int>(error.code());
  }
  return 0;
}
