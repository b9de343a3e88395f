#include "vi/predictor.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>

#include "petsc/direct_solver.hpp"
#include "petsc/sparse.hpp"

namespace sweepvi {

namespace {
constexpr int most_iterations = 30;    // the sets of a step settle in a few; a cycle never does
constexpr int settled_by = 8;          // in an ordinary step
constexpr int most_one_way = 3;        // changes of the sets in a row, when they have not settled by then
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
  configure(solver_.get());  // a bad guess is no failure
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

// Of the sets, from those of the last iteration.
Predictor::Change Predictor::change() {
  std::array<int, 2> some = {0, 0};
  auto then = before_.begin();
  for (const Bound& now : active_) {
    for (; then != before_.end() && then->row < now.row; ++then)
      some[1] = 1;
    if (then != before_.end() && then->row == now.row) {
      if (then->value != now.value) some = {1, 1};
      ++then;
    } else {
      some[0] = 1;
    }
  }
  if (then != before_.end()) some[1] = 1;
  MPI_Allreduce(MPI_IN_PLACE, some.data(), 2, MPI_INT, MPI_LOR, problem_.comm());
  return {some[0] != 0, some[1] != 0};
}

// Equal for equal sets, on all ranks.
std::uint64_t Predictor::fingerprint() const {
  std::uint64_t sum = 0;
  for (const Bound& bound : active_) {
    std::uint64_t mixed =
        std::bit_cast<std::uint64_t>(bound.value) ^ (static_cast<std::uint64_t>(bound.row) << 1U);
    for (const std::uint64_t factor : {0xbf58476d1ce4e5b9U, 0x94d049bb133111ebU}) {  // splitmix64
      mixed = (mixed ^ (mixed >> 30U)) * factor;
      mixed ^= mixed >> 27U;
    }
    sum += mixed;
  }
  MPI_Allreduce(MPI_IN_PLACE, &sum, 1, MPI_UINT64_T, MPI_SUM, problem_.comm());
  return sum;
}

Predictor::Outcome Predictor::improve(Vec u, Vec lower, Vec upper, double target, const Ratio& ratio) {
  double reached = std::numeric_limits<double>::infinity();
  bool refining = false;  // the sets are right: with them kept, rounding in degenerate rows cannot flip them
  std::vector<std::uint64_t> seen;
  bool came_back = false;
  int one_way = 0;
  Change last;
  for (int iteration = 0; iteration < most_iterations; ++iteration) {
    const double previous = reached;
    const bool late = iteration >= settled_by;
    if (late) before_ = active_;
    problem_.residual(u, f_.get());
    const bool changed = !refining && classify(u, lower, upper);
    if (late && changed) {
      const Change now = change();
      const bool turns = (now.entered || last.entered) && (now.left || last.left);
      one_way = turns ? 0 : one_way + 1;
      last = now;
      if (one_way > most_one_way) return Outcome::creeping;
      const std::uint64_t print = fingerprint();
      came_back = came_back || std::find(seen.begin(), seen.end(), print) != seen.end();
      seen.push_back(print);
    }
    if (changed) factor(u);
    if (!advance(u)) return Outcome::failed;
    reached = ratio(u);
    if (reached <= target) return Outcome::solved;
    const bool improved = reached < 0.5 * previous;
    if (!improved && !changed && !refining) return Outcome::failed;  // the sets repeat; rounding is left
    refining = reached <= refine_below && (improved || !refining);
  }
  return came_back ? Outcome::failed : Outcome::unfinished;
}

}  // namespace sweepvi
