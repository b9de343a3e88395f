#include "vi/lemke.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <utility>

namespace sweepvi {

namespace {

using Eigen::Index;

constexpr double smallest_pivot = 1e-11;  // rows are scaled to 1: below this an entry is rounding

std::size_t at(Index i) {
  return static_cast<std::size_t>(i);
}

}  // namespace

Lemke::Lemke(const Eigen::MatrixXd& M, const Eigen::VectorXd& q, const Eigen::VectorXd& cover)
    : M_(M),
      q_(q),
      cover_(cover),
      n_(q.size()),
      table_(n_, n_ + 1),
      right_(q),
      basis_(at(n_)),
      nonbasis_(at(n_ + 1)),
      row_of_(at(2 * n_ + 1), -1),
      column_of_(at(2 * n_ + 1), -1) {
  table_.leftCols(n_) = -M;
  table_.col(n_) = -cover;
  for (Index i = 0; i < n_; ++i) {
    basis_[at(i)] = i;
    row_of_[at(i)] = i;
  }
  for (Index c = 0; c <= n_; ++c) {
    nonbasis_[at(c)] = n_ + c;
    column_of_[at(n_ + c)] = c;
  }
}

LemkeEnd Lemke::solve() {
  Index row = first_row();
  if (row < 0) return LemkeEnd::solution;  // q >= 0: z = 0
  Index entering = artificial();
  // A safeguard against rounding: the lexicographic rule visits no basis twice. Small problems may visit all.
  const Index most = 50 * (n_ + 1) + (n_ <= 16 ? Index{1} << n_ : 0);
  while (pivots_ < most) {
    const Index leaving = basis_[at(row)];
    pivot(row, entering);
    if (leaving == artificial()) return LemkeEnd::solution;
    entering = leaving < n_ ? leaving + n_ : leaving - n_;  // the complement
    row = blocking_row(entering);
    if (row >= 0) continue;
    if (since_renewal_ == 0) return LemkeEnd::ray;
    renew();  // is it one? Only without the rounding of the pivots
    row = blocking_row(entering);
    if (row < 0) return LemkeEnd::ray;
  }
  return LemkeEnd::limit;
}

// Of the inverse of the basis: the columns of w in the table of all variables, since w began as the basis.
double Lemke::inverse_entry(Index row, Index k) const {
  const Index column = column_of(k);
  return column >= 0 ? table_(row, column) : (row_of(k) == row ? 1.0 : 0.0);
}

// Rows (right side | inverse of the basis) are lexicographically positive from the first pivot on. Compares
// row i over `pivot_i` with row j over `pivot_j`.
bool Lemke::before(Index i, double pivot_i, Index j, double pivot_j) const {
  const auto compare = [](double a, double b) {
    if (std::abs(a - b) <= 1e-13 * (std::abs(a) + std::abs(b))) return 0;
    return a < b ? -1 : 1;
  };
  int sign = compare(right_[i] / pivot_i, right_[j] / pivot_j);
  for (Index k = 0; sign == 0 && k < n_; ++k)
    sign = compare(inverse_entry(i, k) / pivot_i, inverse_entry(j, k) / pivot_j);
  return sign < 0;
}

// The covered row of the lexicographically smallest right side over its cover, if that is negative.
Index Lemke::first_row() const {
  Index smallest = -1;
  for (Index i = 0; i < n_; ++i) {
    if (cover_[i] == 0.0 || right_[i] >= 0.0) continue;
    if (smallest < 0 || before(i, cover_[i], smallest, cover_[smallest])) smallest = i;
  }
  return smallest;
}

Index Lemke::blocking_row(Index entering) const {
  const auto column = table_.col(column_of(entering));
  Index row = -1;
  for (Index i = 0; i < n_; ++i) {
    if (column[i] <= smallest_pivot) continue;
    if (row < 0 || before(i, column[i], row, column[row])) row = i;
  }
  // z_0 leaves as soon as it may: where it ties with others, a solution is reached.
  const Index covering = row_of(artificial());
  if (row < 0 || covering < 0 || column[covering] <= smallest_pivot) return row;
  const double first = right_[row] / column[row];
  const double last = right_[covering] / column[covering];
  return last - first <= 1e-13 * (std::abs(first) + std::abs(last)) ? covering : row;
}

void Lemke::pivot(Index row, Index entering) {
  const Index c = column_of(entering);
  const Index leaving = basis_[at(row)];
  const Eigen::VectorXd column = table_.col(c);
  const double pivot = column[row];
  for (Index j = 0; j <= n_; ++j) {
    if (j == c) continue;
    const double factor = table_(row, j) / pivot;
    if (factor != 0.0) table_.col(j) -= factor * column;
    table_(row, j) = factor;
  }
  const double factor = right_[row] / pivot;
  right_ -= factor * column;
  right_[row] = factor;
  table_.col(c) = -column / pivot;
  table_(row, c) = 1.0 / pivot;
  basis_[at(row)] = entering;
  nonbasis_[at(c)] = leaving;
  row_of_[at(entering)] = row;
  column_of_[at(entering)] = -1;
  row_of_[at(leaving)] = -1;
  column_of_[at(leaving)] = c;
  ++pivots_;
  if (++since_renewal_ >= std::max<Index>(100, n_)) renew();
}

// The table of the current basis from the data, free of what pivots have rounded.
void Lemke::renew() {
  const auto column = [&](Index variable) -> Eigen::VectorXd {
    if (variable < n_) return Eigen::VectorXd::Unit(n_, variable);
    if (variable < artificial()) return -M_.col(variable - n_);
    return -cover_;
  };
  Eigen::MatrixXd B(n_, n_);
  Eigen::MatrixXd N(n_, n_ + 2);
  for (Index i = 0; i < n_; ++i)
    B.col(i) = column(basis_[at(i)]);
  for (Index c = 0; c <= n_; ++c)
    N.col(c) = column(nonbasis_[at(c)]);
  N.col(n_ + 1) = q_;
  const Eigen::MatrixXd fresh = Eigen::PartialPivLU<Eigen::MatrixXd>(B).solve(N);
  since_renewal_ = 0;
  if (!fresh.allFinite()) return;
  table_ = fresh.leftCols(n_ + 1);
  right_ = fresh.col(n_ + 1);
}

}  // namespace sweepvi
