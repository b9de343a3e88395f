#include "vi/predictor.hpp"

#include <cmath>
#include <limits>

#include "petsc/sparse.hpp"

namespace sweepvi {

namespace {
constexpr int most_iterations = 30;  // the sets of a step settle in a few; a cycle never does
}

Predictor::Predictor(Dvi& problem, Mat pattern) : problem_(problem) {
  check(MatDuplicate(pattern, MAT_COPY_VALUES, jacobian_.put()));
  check(MatSetOption(jacobian_.get(), MAT_KEEP_NONZERO_PATTERN, PETSC_TRUE));
  for (Vector* vector : {&f_, &right_side_, &step_})
    *vector = duplicate(problem.state());
  check(KSPCreate(problem.comm(), solver_.put()));
  check(KSPSetOperators(solver_.get(), jacobian_.get(), jacobian_.get()));
  check(KSPSetType(solver_.get(), KSPPREONLY));
  PC preconditioner = nullptr;
  check(KSPGetPC(solver_.get(), &preconditioner));
  check(PCSetType(preconditioner, PCLU));
  check(PCFactorSetMatSolverType(preconditioner, MATSOLVERMUMPS));
  check_options(KSPSetFromOptions(solver_.get()));
  check(KSPSetErrorIfNotConverged(solver_.get(), PETSC_FALSE));  // a bad guess is no failure
}

// Rows at a bound and the Newton step's right side. Returns false if the set is that of the factorization.
bool Predictor::classify(Vec u, Vec f, Vec lower, Vec upper) {
  const LocalRange rows = row_range(jacobian_.get());
  active_.clear();
  {
    const ReadArray x(u);
    const ReadArray residual(f);
    const ReadArray l(lower);
    const ReadArray b(upper);
    const WriteArray right(right_side_.get());
    for (PetscInt i = 0; i < x.size(); ++i) {
      const double shifted = x[i] - residual[i];
      const bool low = shifted <= l[i];
      const bool high = shifted >= b[i];
      right[i] = low ? l[i] - x[i] : high ? b[i] - x[i] : -residual[i];
      if (low || high) active_.push_back(rows.first + i);
    }
  }
  int changed =
      has_factor_ && active_ == factored_ && problem_.jacobian_version() == factored_version_ ? 0 : 1;
  MPI_Allreduce(MPI_IN_PLACE, &changed, 1, MPI_INT, MPI_LOR, problem_.comm());
  return changed != 0;
}

// u += J_active^{-1} right_side
bool Predictor::solve(Vec u) {
  check(KSPSolve(solver_.get(), right_side_.get(), step_.get()));
  KSPConvergedReason reason = KSP_CONVERGED_ITERATING;
  check(KSPGetConvergedReason(solver_.get(), &reason));
  if (reason < 0) return false;
  check(VecAXPY(u, 1.0, step_.get()));
  return true;
}

bool Predictor::improve(Vec u, Vec lower, Vec upper, double target, const Ratio& ratio) {
  double previous = std::numeric_limits<double>::infinity();
  for (int iteration = 0; iteration < most_iterations; ++iteration) {
    problem_.residual(u, f_.get());
    const bool changed = classify(u, f_.get(), lower, upper);
    if (changed) {
      problem_.jacobian(u, jacobian_.get());
      check(MatZeroRows(jacobian_.get(), static_cast<PetscInt>(active_.size()), active_.data(), 1.0, nullptr,
                        nullptr));
      factored_ = active_;
      factored_version_ = problem_.jacobian_version();
      has_factor_ = true;
    }
    if (!solve(u)) {
      has_factor_ = false;
      check(KSPReset(solver_.get()));  // MUMPS's factor object does not recover from a singular matrix
      check(KSPSetOperators(solver_.get(), jacobian_.get(), jacobian_.get()));
      return false;
    }
    // Exactly on the bound, not up to the rounding of a solve.
    {
      const LocalRange rows = row_range(jacobian_.get());
      const ReadArray l(lower);
      const ReadArray b(upper);
      const WriteArray x(u);
      for (const PetscInt row : active_) {
        const PetscInt i = row - rows.first;
        const bool two_sided = l[i] > PETSC_NINFINITY && b[i] < PETSC_INFINITY;
        x[i] = l[i] <= PETSC_NINFINITY || (two_sided && std::abs(x[i] - b[i]) < std::abs(x[i] - l[i])) ? b[i]
                                                                                                       : l[i];
      }
    }
    const double reached = ratio(u);
    if (reached <= target) return true;
    if (!changed && !(reached < 0.5 * previous))
      return false;  // the set has settled and rounding is all that is left
    previous = reached;
  }
  return false;
}

}  // namespace sweepvi
