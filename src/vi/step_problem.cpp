#include <cmath>

#include "petsc/sparse.hpp"
#include "sweepvi/step_solver.hpp"

namespace sweepvi {

namespace {

bool finite(Vec vector) {
  double largest = 0.0;
  check(VecNorm(vector, NORM_INFINITY, &largest));
  return std::isfinite(largest);
}

/// Whether `left` vanishes against `terms`, up to what evaluating F twice may round.
bool negligible(MPI_Comm comm, Vec left, Vec terms) {
  constexpr double same = 1e-12;
  int yes = 1;
  {
    const ReadArray l(left);
    const ReadArray t(terms);
    for (PetscInt i = 0; i < l.size(); ++i)
      if (!(std::abs(l[i]) <= same * t[i])) yes = 0;
  }
  MPI_Allreduce(MPI_IN_PLACE, &yes, 1, MPI_INT, MPI_LAND, comm);
  return yes != 0;
}

}  // namespace

void StepSolver::return_to(const Step& step, Vec point) {
  problem_.begin(step, lower_.get(), upper_.get(), guess_.get());
  check(VecCopy(point, u_.get()));
  problem_.residual(u_.get(), f_.get());
}

StepProblem StepSolver::problem() {
  StepProblem step;
  const auto copy = [](Vec of) {
    Vector mine = duplicate(of);
    check(VecCopy(of, mine.get()));
    return mine;
  };
  step.lower = copy(lower_.get());
  step.upper = copy(upper_.get());
  step.u0 = copy(finite(u_.get()) ? u_.get() : guess_.get());
  step.q = duplicate(u_.get());
  step.terms = duplicate(u_.get());
  step.M = problem_.create_jacobian();
  const Vec u = step.u0.get();
  problem_.derivative(u, step.M.get());

  // F(0), if that and M give F(u).
  check(VecSet(settled_.get(), 0.0));
  problem_.residual(settled_.get(), step.q.get());
  problem_.row_terms(settled_.get(), step.terms.get());
  const Vector left = duplicate(u);
  const Vector size = duplicate(u);
  check(MatMultAdd(step.M.get(), u, step.q.get(), left.get()));
  problem_.residual(u, f_.get());
  problem_.row_terms(u, size.get());
  check(VecAXPY(left.get(), -1.0, f_.get()));
  step.affine = negligible(problem_.comm(), left.get(), size.get());
  if (step.affine) return step;

  // The linearisation: q = F(u) - M u.
  check(MatMult(step.M.get(), u, left.get()));
  check(VecWAXPY(step.q.get(), -1.0, left.get(), f_.get()));
  check(VecCopy(size.get(), step.terms.get()));
  return step;
}

}  // namespace sweepvi
