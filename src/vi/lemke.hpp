#pragma once

#include <Eigen/Core>
#include <vector>

namespace sweepvi {

/// How Lemke's method ended.
enum class LemkeEnd {
  solution,
  ray,   ///< a secondary ray: no solution for matrices of the classes that the method processes
  limit  ///< too many pivots: rounding
};

/// The linear complementarity problem  w = M z + q >= 0,  z >= 0,  w'z = 0  by Lemke's method: the smallest
/// artificial variable z_0 >= 0 that makes z = 0 a solution of w = M z + q + d z_0 is driven to zero, one
/// complementary pivot at a time. Lexicographic ratios: degenerate problems cannot cycle. O(n^2) a pivot,
/// usually O(n) pivots. Rows should have entries of size 1.
///
/// Sources: C. E. Lemke, Management Science 11 (1965) 681-689; the lexicographic rule in R. W. Cottle, J.-S.
/// Pang, R. E. Stone, The Linear Complementarity Problem, 1992, section 4.9.
class Lemke {
public:
  /// @param cover  d >= 0: rows that the artificial variable is added to, and how much of it
  Lemke(const Eigen::MatrixXd& M, const Eigen::VectorXd& q, const Eigen::VectorXd& cover);

  LemkeEnd solve();

  int pivots() const { return pivots_; }
  /// Whether z_i is in the final basis; otherwise it is zero.
  bool basic(Eigen::Index i) const { return row_of(n_ + i) >= 0; }
  /// z_i in the final basis, with what the pivots have rounded.
  double value(Eigen::Index i) const { return basic(i) ? right_[row_of(n_ + i)] : 0.0; }

private:
  using Index = Eigen::Index;
  Index artificial() const { return 2 * n_; }
  Index row_of(Index variable) const { return row_of_[static_cast<std::size_t>(variable)]; }
  Index column_of(Index variable) const { return column_of_[static_cast<std::size_t>(variable)]; }
  double inverse_entry(Index row, Index k) const;
  bool before(Index i, double pivot_i, Index j, double pivot_j) const;
  Index first_row() const;
  Index blocking_row(Index entering) const;
  void pivot(Index row, Index entering);
  void renew();

  const Eigen::MatrixXd& M_;
  const Eigen::VectorXd& q_;
  const Eigen::VectorXd& cover_;
  Index n_;
  // Variables: w, z, z_0. The basic ones are right_ - table_ (nonbasic ones).
  Eigen::MatrixXd table_;
  Eigen::VectorXd right_;
  std::vector<Index> basis_, nonbasis_;    // variable of a row, of a column
  std::vector<Index> row_of_, column_of_;  // of a variable, or -1
  int pivots_ = 0;
  int since_renewal_ = 0;
};

}  // namespace sweepvi
