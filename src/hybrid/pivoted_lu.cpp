#include "hybrid/pivoted_lu.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace sweepvi {

namespace {
constexpr double dependent = 1e-13;
}  // namespace

PivotedLu::PivotedLu(const std::vector<std::vector<double>>& matrix, const std::vector<std::size_t>& members,
                     const std::vector<char>& set) {
  std::vector<std::size_t> rows;  // places in `members`
  for (std::size_t i = 0; i < members.size(); ++i)
    if (set[members[i]] != 0) rows.push_back(i);
  std::vector<std::size_t> columns = rows;
  const std::size_t size = rows.size();
  lu_.resize(size * size);
  double largest = 0.0;
  for (std::size_t i = 0; i < size; ++i)
    for (std::size_t j = 0; j < size; ++j) {
      lu_[i * size + j] = matrix[rows[i]][columns[j]];
      largest = std::max(largest, std::abs(lu_[i * size + j]));
    }
  for (; rank_ < size; ++rank_) {
    std::size_t p = rank_, q = rank_;
    for (std::size_t i = rank_; i < size; ++i)
      for (std::size_t j = rank_; j < size; ++j)
        if (std::abs(lu_[i * size + j]) > std::abs(lu_[p * size + q])) {
          p = i;
          q = j;
        }
    if (!(std::abs(lu_[p * size + q]) > dependent * largest)) break;
    std::swap(rows[rank_], rows[p]);
    std::swap(columns[rank_], columns[q]);
    for (std::size_t j = 0; j < size && p != rank_; ++j)
      std::swap(lu_[rank_ * size + j], lu_[p * size + j]);
    for (std::size_t i = 0; i < size && q != rank_; ++i)
      std::swap(lu_[i * size + rank_], lu_[i * size + q]);
    for (std::size_t i = rank_ + 1; i < size; ++i) {
      const double multiple = lu_[i * size + rank_] /= lu_[rank_ * size + rank_];
      for (std::size_t j = rank_ + 1; j < size && multiple != 0.0; ++j)
        lu_[i * size + j] -= multiple * lu_[rank_ * size + j];
    }
  }
  for (std::size_t i = 0; i < size; ++i) {
    rows_.push_back(members[rows[i]]);
    columns_.push_back(members[columns[i]]);
  }
}

void PivotedLu::solve(const std::vector<double>& right, std::vector<double>& values) const {
  const std::size_t size = rows_.size();
  std::vector<double> y(size, 0.0);
  for (std::size_t i = 0; i < rank_; ++i) {
    y[i] = right[rows_[i]];
    for (std::size_t j = 0; j < i; ++j)
      y[i] -= lu_[i * size + j] * y[j];
  }
  for (std::size_t i = rank_; i-- > 0;) {
    for (std::size_t j = i + 1; j < rank_; ++j)
      y[i] -= lu_[i * size + j] * y[j];
    y[i] /= lu_[i * size + i];
  }
  for (std::size_t i = 0; i < size; ++i)
    values[columns_[i]] = y[i];
}

void PivotedLu::bound(const std::vector<double>& right, std::vector<double>& values) const {
  std::vector<double> unit(right.size(), 0.0), column(right.size(), 0.0);
  for (const std::size_t b : columns_)
    values[b] = 0.0;
  for (std::size_t i = 0; i < rank_; ++i) {
    if (right[rows_[i]] == 0.0) continue;
    unit[rows_[i]] = right[rows_[i]];
    solve(unit, column);
    unit[rows_[i]] = 0.0;
    for (const std::size_t b : columns_)
      values[b] += std::abs(column[b]);
  }
}

}  // namespace sweepvi
