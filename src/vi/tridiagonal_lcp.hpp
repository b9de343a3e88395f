#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace sweepvi {

/// The linear complementarity problem of a tridiagonal M-matrix T (off-diagonals <= 0, pivots > 0), about a
/// given x >= 0 at which w = T x + q is known: find the change y with
///
///     0 <= x + y   _|_   w + T y >= 0.
///
/// One pass finds the set of positive components without trying sets: entries are taken in one by one, and
/// what has become positive stays so, because the solution grows with each (T is an M-matrix). Runs of
/// neighbours that are positive are kept by what their two ends do in answer to what acts on them from
/// outside (two-ports, of nonnegative numbers), so that joining two takes the same time however long they
/// are. Then an elimination (Thomas) in each run, for y: rounding is relative to the change, not to x.
///
/// Cost O(n), whatever the data. Source: for the problem, and for the growth of the solution, C. W. Cryer,
/// The efficient solution of linear complementarity problems for tridiagonal Minkowski matrices, ACM Trans.
/// Math. Software 9 (1983) 199-214; two-ports in place of his eliminations from both ends.
class TridiagonalLcp {
public:
  TridiagonalLcp() = default;
  /// Row i is lower[i] x[i-1] + diagonal[i] x[i] + upper[i] x[i+1]; lower[0] and upper[n-1] are not read.
  TridiagonalLcp(std::vector<double> lower, std::vector<double> diagonal, std::vector<double> upper);

  /// Off-diagonals are <= 0 and pivots well above rounding.
  bool is_m_matrix() const { return is_m_matrix_; }
  std::size_t size() const { return diagonal_.size(); }

  /// @param w  infinite: x_i = 0 stays 0 @param y  becomes the change; exactly -x_i where x + y is 0
  void solve(std::span<const double> w, std::span<const double> x, std::span<double> y);
  /// The same without bounds: T y = -w.
  void solve_free(std::span<const double> w, std::span<double> y);

private:
  /// A run [first, last]: its first and last component are a[0] + a[1] s + a[2] t and b[0] + b[1] s + b[2] t,
  /// where s and t act on its first and last row.
  struct Run {
    std::ptrdiff_t first, last;
    double a[3], b[3];
  };
  Run single(std::ptrdiff_t i, double q) const;
  Run join(const Run& left, const Run& right) const;
  void find_runs(std::span<const double> w, std::span<const double> x);
  void eliminate(std::ptrdiff_t first, std::ptrdiff_t last, std::span<const double> w, std::span<double> y);

  std::vector<double> lower_, diagonal_, upper_;
  bool is_m_matrix_ = false;
  std::vector<Run> runs_;       // of positive components, from left to right
  std::vector<double> factor_;  // of the elimination
};

}  // namespace sweepvi
