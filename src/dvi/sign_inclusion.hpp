#pragma once

#include <Eigen/Core>
#include <array>
#include <functional>
#include <optional>
#include <vector>

namespace sweepvi {

/// A few inclusions lambda_i in sgn(y_i(lambda)), i < m <= 4, that may have several solutions, or families of
/// them. Solved by trying all branches, each lambda_i being 1 (y_i >= 0), -1 (y_i <= 0) or free (y_i = 0), in
/// an order that says which solution is wanted: 3^m at most, few where the reach of y rules most of them out.
struct SignInclusion {
  static constexpr int most = 4;
  using Values = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, most, 1>;
  using Block = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, most, most>;
  using Branch = std::array<int, most>;  ///< 1, -1, or 0: free

  struct Outputs {
    Values y;
    Block derivative;  ///< dy/dlambda
    Values terms;      ///< size of the terms of y, which is zero where it is below the rounding of those
  };
  std::function<Outputs(const Values& lambda)> outputs;
  Values low, high;  ///< what y_i can be, whatever lambda is
  std::vector<std::array<int, 3>>
      wanted;                  ///< per row: its branches, the first choice first; row 0 weighs most
  std::vector<Values> starts;  ///< of Newton's method, the first that leads to a solution is taken
  std::function<bool(const Values& lambda, const Branch& branch)> admissible;  ///< whether to take a solution

  struct Solution {
    Values lambda;
    Branch branch{};
  };
  /// The first admissible solution in the order of `wanted`. Where a branch leaves a whole family it is the
  /// member near the start: Newton steps of least norm.
  std::optional<Solution> solve() const;

private:
  bool solve_branch(const Branch& branch, const Values& start, Values& lambda) const;
  bool settle(Solution& solution, const Values& start) const;
  bool reachable(int row, int sign) const;
};

}  // namespace sweepvi
