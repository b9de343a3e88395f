#include "vi/predictor.hpp"

#include <cmath>
#include <limits>

#include "petsc/direct_solver.hpp"
#include "petsc/sparse.hpp"

namespace sweepvi {

namespace {
constexpr int most_iterations = 30;    // the sets of a step settle in a few; a cycle never does
constexpr double refine_below = 1e-6;  // a ratio that wrong sets do not reach

double sign_of(Degenerate degenerate) {
  return degenerate == Degenerate::at_bound ? 1.0 : degenerate == Degenerate::off_bound ? -1.0 : 0.0;
}
}  // namespace

Predictor::Predictor(Dvi& problem, Mat pattern) : problem_(problem) {
  check(MatDuplicate(pattern, MAT_COPY_VALUES, jacobian_.put()));
  check(MatSetOption(jacobian_.get(), MAT_KEEP_NONZERO_PATTERN, PETSC_TRUE));
  for (Vector* vector : {&f_, &right_side_, &step_, &terms_})
    *vector = duplicate(problem.state());
  check(KSPCreate(problem.comm(), solver_.put()));
  check(KSPSetOperators(solver_.get(), jacobian_.get(), jacobian_.get()));
  default_to_mumps(solver_.get());
  check_options(KSPSetFromOptions(solver_.get()));
  check(KSPSetErrorIfNotConverged(solver_.get(), PETSC_FALSE));  // a bad guess is no failure
}

// Finds the rows at a bound. Returns true if the factorization is not that of this set and Jacobian.
bool Predictor::classify(Vec u, Vec lower, Vec upper) {
  const LocalRange rows = row_range(jacobian_.get());
  active_.clear();
  problem_.row_terms(u, terms_.get());
  {
    const ReadArray x(u);
    const ReadArray residual(f_.get());
    const ReadArray l(lower);
    const ReadArray b(upper);
    const ReadArray terms(terms_.get());
    const double slack = held_rtol * sign_of(problem_.degenerate());
    for (PetscInt i = 0; i < x.size(); ++i) {
      const double shifted = x[i] - residual[i];
      if (shifted <= l[i] + slack * terms[i])
        active_.push_back({rows.first + i, l[i]});
      else if (shifted >= b[i] - slack * terms[i])
        active_.push_back({rows.first + i, b[i]});
    }
  }
  int changed =
      has_factor_ && problem_.jacobian_version() == factored_version_ && active_ == factored_ ? 0 : 1;
  MPI_Allreduce(MPI_IN_PLACE, &changed, 1, MPI_INT, MPI_LOR, problem_.comm());
  return changed != 0;
}

void Predictor::factor(Vec u) {
  problem_.jacobian(u, jacobian_.get());
  std::vector<PetscInt> rows;
  for (const Bound& bound : active_)
    rows.push_back(bound.row);
  check(MatZeroRows(jacobian_.get(), static_cast<PetscInt>(rows.size()), rows.data(), 1.0, nullptr, nullptr));
  factored_ = active_;
  factored_version_ = problem_.jacobian_version();
  has_factor_ = true;
}

// One Newton step with the current sets: u += J^{-1} (bound - u | -F).
bool Predictor::advance(Vec u) {
  const PetscInt first = row_range(jacobian_.get()).first;
  check(VecCopy(f_.get(), right_side_.get()));
  check(VecScale(right_side_.get(), -1.0));
  {
    const ReadArray x(u);
    const WriteArray right(right_side_.get());
    for (const Bound& bound : active_)
      right[bound.row - first] = bound.value - x[bound.row - first];
  }
  if (!solve(solver_.get(), jacobian_.get(), right_side_.get(), step_.get())) {
    has_factor_ = false;
    return false;
  }
  check(VecAXPY(u, 1.0, step_.get()));
  const WriteArray x(u);
  for (const Bound& bound : active_)
    x[bound.row - first] = bound.value;  // exactly, not up to the rounding of a solve
  return true;
}

bool Predictor::improve(Vec u, Vec lower, Vec upper, double target, const Ratio& ratio) {
  double reached = std::numeric_limits<double>::infinity();
  bool refining = false;  // the sets are right: with them kept, rounding in degenerate rows cannot flip them
  for (int iteration = 0; iteration < most_iterations; ++iteration) {
    const double previous = reached;
    problem_.residual(u, f_.get());
    const bool changed = !refining && classify(u, lower, upper);
    if (changed) factor(u);
    if (!advance(u)) return false;
    reached = ratio(u);
    if (reached <= target) return true;
    const bool improved = reached < 0.5 * previous;
    if (!improved && !changed && !refining) return false;  // the sets repeat and rounding is all that is left
    refining = reached <= refine_below && (improved || !refining);
  }
  return false;
}

}  // namespace sweepvi
