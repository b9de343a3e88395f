#include "vi/affine_box.hpp"

#include <petscsys.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <vector>

namespace sweepvi {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Indices = std::vector<Index>;

constexpr double smallest_pivot = 1e-11;  // rows are scaled to 1: below this an entry is rounding

bool has_lower(const AffineBox& box, Index i) {
  return box.lower[i] > PETSC_NINFINITY;
}
bool has_upper(const AffineBox& box, Index i) {
  return box.upper[i] < PETSC_INFINITY;
}

/// w = M z + q >= 0, z >= 0, w'z = 0.
class Lemke {
public:
  /// @param covered  rows that the artificial variable is added to
  Lemke(const MatrixXd& M, const VectorXd& q, const std::vector<char>& covered)
      : n_(q.size()), tableau_(n_, 2 * n_ + 2), basis_(static_cast<std::size_t>(n_)) {
    tableau_.leftCols(n_).setIdentity();
    tableau_.middleCols(n_, n_) = -M;
    for (Index i = 0; i < n_; ++i) {
      tableau_(i, artificial()) = covered[static_cast<std::size_t>(i)] != 0 ? -1.0 : 0.0;
      basis_[static_cast<std::size_t>(i)] = i;
    }
    tableau_.col(right()) = q;
  }

  bool solve() {
    Index row = first_row();
    if (row < 0) return true;  // q >= 0: z = 0
    Index entering = artificial();
    const Index most = 200 * (n_ + 1);  // a safeguard: the lexicographic rule visits no basis twice
    while (pivots_ < most) {
      const Index leaving = basis_[static_cast<std::size_t>(row)];
      pivot(row, entering);
      if (leaving == artificial()) return true;
      entering = leaving < n_ ? leaving + n_ : leaving - n_;  // the complement
      row = blocking_row(entering);
      if (row < 0) return false;  // a ray
    }
    return false;
  }

  int pivots() const { return pivots_; }
  /// Whether z_i is in the final basis; otherwise it is zero, and w_i is in.
  bool basic(Index i) const { return std::find(basis_.begin(), basis_.end(), n_ + i) != basis_.end(); }

private:
  Index artificial() const { return 2 * n_; }
  Index right() const { return 2 * n_ + 1; }

  // Rows (right side | B^{-1}) are lexicographically positive from the first pivot on; B^{-1} stands where
  // the identity stood. Compares row i over `pivot_i` with row j over `pivot_j`.
  bool before(Index i, double pivot_i, Index j, double pivot_j) const {
    const auto less = [&](Index column, int& sign) {
      const double a = tableau_(i, column) / pivot_i;
      const double b = tableau_(j, column) / pivot_j;
      sign = std::abs(a - b) <= 1e-13 * (std::abs(a) + std::abs(b)) ? 0 : (a < b ? -1 : 1);
      return sign;
    };
    int sign = 0;
    if (less(right(), sign) != 0) return sign < 0;
    for (Index column = 0; column < n_; ++column)
      if (less(column, sign) != 0) return sign < 0;
    return false;
  }

  // The covered row of the lexicographically smallest right side, if that is negative.
  Index first_row() const {
    Index smallest = -1;
    for (Index i = 0; i < n_; ++i) {
      if (tableau_(i, artificial()) == 0.0 || tableau_(i, right()) >= 0.0) continue;
      if (smallest < 0 || before(i, 1.0, smallest, 1.0)) smallest = i;
    }
    return smallest;
  }

  Index blocking_row(Index entering) const {
    Index row = -1;
    for (Index i = 0; i < n_; ++i) {
      if (tableau_(i, entering) <= smallest_pivot) continue;
      if (row < 0 || before(i, tableau_(i, entering), row, tableau_(row, entering))) row = i;
    }
    return row;
  }

  void pivot(Index row, Index entering) {
    tableau_.row(row) /= tableau_(row, entering);
    for (Index i = 0; i < n_; ++i)
      if (i != row) tableau_.row(i) -= tableau_(i, entering) * tableau_.row(row);
    basis_[static_cast<std::size_t>(row)] = entering;
    ++pivots_;
  }

  Index n_;
  MatrixXd tableau_;  // columns: w, z, z_0, right side
  Indices basis_;
  int pivots_ = 0;
};

MatrixXd block(const MatrixXd& M, const Indices& rows, const Indices& columns) {
  return M(rows, columns);
}

}  // namespace

AffineBoxSolution solve_affine_box(const AffineBox& box) {
  AffineBoxSolution solution;
  const Index n = box.q.size();
  VectorXd u = VectorXd::Zero(n);
  Indices open;     // no bounds
  Indices bounded;  // at least one
  for (Index i = 0; i < n; ++i) {
    if (!has_lower(box, i) && !has_upper(box, i)) {
      open.push_back(i);
    } else if (box.lower[i] == box.upper[i]) {
      u[i] = box.lower[i];  // no unknown at all
    } else {
      bounded.push_back(i);
    }
  }
  const VectorXd q = box.q + box.M * u;

  // 1. Without the open unknowns: their rows say what they are.
  MatrixXd S = block(box.M, bounded, bounded);
  VectorXd r = q(bounded);
  if (!open.empty()) {
    const Eigen::FullPivLU<MatrixXd> factor(block(box.M, open, open));
    if (!factor.isInvertible()) return solution;
    const MatrixXd rows = block(box.M, bounded, open);
    S -= rows * factor.solve(block(box.M, open, bounded));
    r -= rows * factor.solve(VectorXd(q(open)));
  }

  // 2. Distances z >= 0 from a bound, and multipliers y >= 0 of the bounds on the other side:
  //    S z + r + y >= 0 for z, cap - z >= 0 for y. Rows scaled to 1. Only the rows of z are covered by z_0.
  //    If all have caps there is no ray. Along one, z would stay, as it is bounded. If z_0 grows, all rows of
  //    z are positive at last, hence z = 0, hence y = 0: the ray we came from. If it stays and some y_i
  //    grows, row i is positive, hence z_i = 0, its cap is slack, hence y_i = 0.
  const auto m = static_cast<Index>(bounded.size());
  Indices capped;
  VectorXd flip(m);
  VectorXd origin(m);
  for (Index k = 0; k < m; ++k) {
    const Index i = bounded[static_cast<std::size_t>(k)];
    flip[k] = has_lower(box, i) ? 1.0 : -1.0;
    origin[k] = has_lower(box, i) ? box.lower[i] : box.upper[i];
    if (has_lower(box, i) && has_upper(box, i)) capped.push_back(k);
  }
  r = flip.cwiseProduct(r + S * origin);
  S = flip.asDiagonal() * S * flip.asDiagonal();
  const auto caps = static_cast<Index>(capped.size());
  MatrixXd M = MatrixXd::Zero(m + caps, m + caps);
  VectorXd right(m + caps);
  std::vector<char> covered(static_cast<std::size_t>(m + caps), 0);
  for (Index k = 0; k < m; ++k) {
    const double largest = S.row(k).cwiseAbs().maxCoeff();
    const double scale = largest > 0.0 ? 1.0 / largest : 1.0;
    M.row(k).head(m) = scale * S.row(k);
    right[k] = scale * r[k];
    covered[static_cast<std::size_t>(k)] = 1;
  }
  for (Index c = 0; c < caps; ++c) {
    const Index k = capped[static_cast<std::size_t>(c)];
    const Index i = bounded[static_cast<std::size_t>(k)];
    M(k, m + c) = 1.0;
    M(m + c, k) = -1.0;
    right[m + c] = box.upper[i] - box.lower[i];
  }
  Lemke lemke(M, right, covered);
  solution.solved = lemke.solve();
  solution.pivots = lemke.pivots();
  if (!solution.solved) return solution;

  // 3. From the sets found, by a fresh factorization: free of what the pivots have rounded.
  Indices inside = open;
  for (Index k = 0; k < m; ++k) {
    const Index i = bounded[static_cast<std::size_t>(k)];
    const auto cap = std::find(capped.begin(), capped.end(), k);
    const bool at_cap = cap != capped.end() && lemke.basic(m + (cap - capped.begin()));
    if (at_cap) {
      u[i] = box.upper[i];
    } else if (lemke.basic(k)) {
      inside.push_back(i);
    } else {
      u[i] = origin[k];
    }
  }
  if (!inside.empty()) {
    const VectorXd known = (box.q + box.M * u)(inside);
    u(inside) = -Eigen::PartialPivLU<MatrixXd>(block(box.M, inside, inside)).solve(known);
  }
  solution.u = u.cwiseMax(box.lower).cwiseMin(box.upper);
  return solution;
}

}  // namespace sweepvi
