#include "dvi/sign_inclusion.hpp"

#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <limits>

namespace sweepvi {

namespace {
constexpr double zero = 32 * std::numeric_limits<double>::epsilon();  // of the terms: a dozen, rounded
constexpr double dependent =
    1e-10;  // rows that say the same, s = 0 and s = s_ref = 0, are equal up to rounding
constexpr int most_iterations = 25;
}  // namespace

bool SignInclusion::reachable(int row, int sign) const {
  return (sign > 0 || low[row] <= 0.0) && (sign < 0 || high[row] >= 0.0);
}

std::optional<SignInclusion::Solution> SignInclusion::solve() const {
  const auto size = static_cast<int>(wanted.size());
  Solution solution;
  solution.branch.fill(0);
  int branches = 1;
  for (int row = 0; row < size; ++row)
    branches *= 3;
  for (int number = 0; number < branches; ++number) {
    bool possible = true;
    for (int row = size - 1, rest = number; row >= 0; --row, rest /= 3) {
      const auto i = static_cast<std::size_t>(row);
      solution.branch[i] = wanted[i][static_cast<std::size_t>(rest % 3)];
      possible = possible && reachable(row, solution.branch[i]);
    }
    if (!possible) continue;
    for (const Values& start : starts)
      if (solve_branch(solution.branch, start, solution.lambda) && settle(solution, start)) return solution;
  }
  return std::nullopt;
}

// Outputs that are zero up to rounding become zero, and their signs free: the largest active set. If there is
// no such solution, what has the wrong sign by rounding is none either. True if what comes out is admissible.
bool SignInclusion::settle(Solution& solution, const Values& start) const {
  const auto size = static_cast<int>(wanted.size());
  const Outputs at = outputs(solution.lambda);
  Solution held = solution;
  bool right = true;
  for (int i = 0; i < size; ++i) {
    int& sign = held.branch[static_cast<std::size_t>(i)];
    right = right && sign * at.y[i] >= 0.0;
    if (std::abs(at.y[i]) <= zero * at.terms[i]) sign = 0;
  }
  if (held.branch != solution.branch) {
    for (const Values& from : {start, solution.lambda}) {
      if (!solve_branch(held.branch, from, held.lambda)) continue;
      if (!admissible(held.lambda, held.branch)) continue;
      solution = held;
      return true;
    }
  }
  return right && admissible(solution.lambda, solution.branch);
}

bool SignInclusion::solve_branch(const Branch& branch, const Values& start, Values& lambda) const {
  const auto size = static_cast<int>(wanted.size());
  std::vector<int> free;
  lambda = start;
  for (int i = 0; i < size; ++i) {
    const int sign = branch[static_cast<std::size_t>(i)];
    if (sign == 0) {
      free.push_back(i);
    } else {
      lambda[i] = sign;
    }
  }
  Outputs at;
  double worst = 0.0;
  for (int iteration = 0;; ++iteration) {
    at = outputs(lambda);
    const double previous = worst;
    worst = 0.0;
    for (const int i : free)
      if (at.y[i] != 0.0) worst = std::max(worst, std::abs(at.y[i]) / at.terms[i]);
    const bool stuck = iteration > 4 && worst > zero && worst > 0.99 * previous;  // no such solution
    if (!std::isfinite(worst) || stuck || iteration == most_iterations) return false;
    if (worst == 0.0 || (worst <= zero && iteration > 0 && worst > 0.5 * previous)) break;
    const auto count = static_cast<Eigen::Index>(free.size());
    Values right(count);
    Block block(count, count);
    for (Eigen::Index a = 0; a < count; ++a) {
      const int i = free[static_cast<std::size_t>(a)];
      const double scale = at.terms[i] > 0.0 ? 1.0 / at.terms[i] : 1.0;
      right[a] = -scale * at.y[i];
      for (Eigen::Index b = 0; b < count; ++b)
        block(a, b) = scale * at.derivative(i, free[static_cast<std::size_t>(b)]);
    }
    Eigen::CompleteOrthogonalDecomposition<Block> factor(count, count);
    factor.setThreshold(dependent);
    const Values step = factor.compute(block).solve(right);
    for (Eigen::Index a = 0; a < count; ++a)
      lambda[free[static_cast<std::size_t>(a)]] += step[a];
    constexpr double far = 10.0;  // nothing comes back from there
    if (lambda.cwiseAbs().maxCoeff() > far) return false;
  }
  for (int i = 0; i < size; ++i) {
    const int sign = branch[static_cast<std::size_t>(i)];
    if (sign * at.y[i] < -zero * at.terms[i] || std::abs(lambda[i]) > 1.0 + zero) return false;
    lambda[i] = std::clamp(lambda[i], -1.0, 1.0);
  }
  return true;
}

}  // namespace sweepvi
