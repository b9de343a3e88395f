#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <span>
#include <type_traits>
#include <vector>

#include "sweepvi/dvi.hpp"

namespace sweepvi {

/// This rank's rows of a matrix K, for what a step asks of an affine F(u) = K u - b: its values and the terms
/// they are summed from in one pass over K, instead of a MatMult each and a copy of |K|. Rows that are alike,
/// as those of equal elements of a chain, are kept once: what is read from memory then is vectors alone.
class AffineRows {
public:
  struct Entry {
    PetscInt offset;  ///< column less row
    double value;
  };
  /// What a row is summed from: its sum, and that of the absolute values.
  struct Row {
    double sum = 0.0, size = 0.0;
  };

  AffineRows() = default;
  /// Copies the entries of K (AIJ). @note Collective, like all that takes vectors.
  explicit AffineRows(Mat K);

  /// y = K x, y += K x
  void multiply(Vec x, Vec y) const;
  void add_to(Vec x, Vec y) const;
  /// f = K u - b
  void residual(Vec u, Vec b, Vec f) const;
  /// terms = |K| |u| + |b|_terms
  void terms(Vec u, Vec b_terms, Vec terms) const;
  /// Both.
  void evaluate(Vec u, Vec b, Vec b_terms, Vec f, Vec terms) const;
  /// Both, and what rows make of u in [lower, upper].
  RowRatios judge(Vec u, Vec lower, Vec upper, Vec b, Vec b_terms, Vec f, Vec terms) const;

  /// sum += K u, terms += |K| |u|
  void add_product(Vec u, Vec sum, Vec terms) const;
  /// y = K x, y_terms = |K| x_terms; none of them the same.
  void map(Vec x, Vec x_terms, Vec y, Vec y_terms) const;

  /// The least of 1 - (sum of |K_ij|, j != i) / K_ii over this rank's rows: above 0, K is strictly diagonally
  /// dominant there. Below where a diagonal entry is not positive. @note Not collective.
  double dominance() const;

  PetscInt size() const { return static_cast<PetscInt>(kind_.size()); }
  /// Those of row i, in the order of their columns. Columns i + offset count this rank's entries of a vector
  /// first, then those of other ranks in the order of `ghosts`.
  std::span<const Entry> entries(PetscInt i) const {
    const Kind& kind = kind_of(i);
    return {entries_.data() + kind.begin, entries_.data() + kind.end};
  }
  /// K u in row i. @param others  ghosts(u)
  Row row(PetscInt i, const double* own, const double* others) const;
  /// Calls visit(i, K u in row i) for all rows, each once, in any order.
  template <class Visit>
  void each_row(const double* own, const double* others, Visit&& visit) const;
  /// The same, of rows that are alike every other one first: where a visit changes what the row beside it
  /// reads, that one need not wait for it.
  template <class Visit>
  void each_row_apart(const double* own, const double* others, Visit&& visit) const;

  /// The entries of u on other ranks that rows read; valid until the next call. Null where all are our own.
  const double* ghosts(Vec u) const;
  /// How many they are.
  PetscInt ghost_count() const { return ghost_count_; }

private:
  struct Kind {
    PetscInt begin, end;  // of its entries
    bool reads_ghosts;
  };
  /// Rows side by side whose kinds, which read no ghosts, come back after `period` rows; or, with a period of
  /// 0, any.
  struct Run {
    PetscInt end;  // where it begins the one before ends
    PetscInt period;
  };
  const Kind& kind_of(PetscInt i) const {
    return kinds_[static_cast<std::size_t>(kind_[static_cast<std::size_t>(i)])];
  }
  void take_rows(Mat own, Mat others);
  void find_runs();
  PetscInt straight_until(PetscInt begin, PetscInt period) const;
  template <class Visit>
  void each_row_by(PetscInt least_stride, const double* own, const double* others, Visit&& visit) const;
  template <class Visit>
  void each_of_kind(PetscInt begin, PetscInt end, PetscInt period, const double* own, Visit&& visit) const;
  template <int Count, class Visit>
  static void each_with(PetscInt begin, PetscInt end, PetscInt period, const Entry* entries,
                        const double* own, Visit&& visit);
  template <class Visit>
  void evaluate_each(Vec u, Vec b, Vec b_terms, Vec f, Vec terms, Visit&& visit) const;

  std::vector<std::int32_t> kind_;  // of each row
  std::vector<Kind> kinds_;
  std::vector<Run> runs_;
  std::vector<Entry> entries_;  // of each kind
  PetscInt columns_ = 0;        // of our own
  PetscInt ghost_count_ = 0;
  Scatter scatter_;  // empty: no rank reads another one's
  Vector ghosts_;
};

// The compiler leaves out what is not used of the result.
inline AffineRows::Row AffineRows::row(PetscInt i, const double* own, const double* others) const {
  const Kind& kind = kind_of(i);
  const Entry* const end = entries_.data() + kind.end;
  Row result;
  const auto add = [&result](double product) {
    result.sum += product;
    result.size += std::abs(product);
  };
  if (!kind.reads_ghosts) {
    for (const Entry* entry = entries_.data() + kind.begin; entry < end; ++entry)
      add(entry->value * own[i + entry->offset]);
    return result;
  }
  for (const Entry* entry = entries_.data() + kind.begin; entry < end; ++entry) {
    const PetscInt column = i + entry->offset;
    // NOLINTNEXTLINE(clang-analyzer-core.NullDereference): who reads ghosts has some
    add(entry->value * (column < columns_ ? own[column] : others[column - columns_]));
  }
  return result;
}

// Rows begin, begin + period, ... Where the number of entries is known at compile time they stay in
// registers.
template <int Count, class Visit>
inline void AffineRows::each_with(PetscInt begin, PetscInt end, PetscInt period, const Entry* entries,
                                  const double* own, Visit&& visit) {
  std::array<double, Count> value;        // NOLINT: filled here
  std::array<const double*, Count> read;  // NOLINT
  for (std::size_t k = 0; k < Count; ++k) {
    value[k] = entries[k].value;
    read[k] = own + entries[k].offset;
  }
  for (PetscInt i = begin; i < end; i += period) {
    Row result;
    for (std::size_t k = 0; k < Count; ++k) {
      const double product = value[k] * read[k][i];
      result.sum += product;
      result.size += std::abs(product);
    }
    visit(i, result);
  }
}

template <class Visit>
inline void AffineRows::each_of_kind(PetscInt begin, PetscInt end, PetscInt period, const double* own,
                                     Visit&& visit) const {
  const std::span<const Entry> entries = this->entries(begin);
  const auto with = [&](auto count) {
    each_with<count.value>(begin, end, period, entries.data(), own, visit);
  };
  switch (entries.size()) {
    case 1:
      return with(std::integral_constant<int, 1>());
    case 2:
      return with(std::integral_constant<int, 2>());
    case 3:
      return with(std::integral_constant<int, 3>());
    case 4:
      return with(std::integral_constant<int, 4>());
    case 5:
      return with(std::integral_constant<int, 5>());
    case 6:
      return with(std::integral_constant<int, 6>());
    default:
      for (PetscInt i = begin; i < end; i += period)
        visit(i, row(i, own, nullptr));
  }
}

template <class Visit>
void AffineRows::each_row(const double* own, const double* others, Visit&& visit) const {
  each_row_by(1, own, others, visit);
}

template <class Visit>
void AffineRows::each_row_apart(const double* own, const double* others, Visit&& visit) const {
  each_row_by(2, own, others, visit);
}

template <class Visit>
inline void AffineRows::each_row_by(PetscInt least_stride, const double* own, const double* others,
                                    Visit&& visit) const {
  constexpr PetscInt near = 400;  // rows: what a few vectors have of them stays in the cache
  PetscInt begin = 0;
  for (const Run& run : runs_) {
    const PetscInt stride = std::max(run.period, least_stride);
    if (run.period == 0)
      for (PetscInt i = begin; i < run.end; ++i)
        visit(i, row(i, own, others));
    else if (stride == 1)
      each_of_kind(begin, run.end, 1, own, visit);
    else
      for (PetscInt part = begin; part < run.end; part += near / stride * stride)
        for (PetscInt i = part; i < std::min(run.end, part + stride); ++i)
          each_of_kind(i, std::min(run.end, part + near / stride * stride), stride, own, visit);
    begin = run.end;
  }
}

}  // namespace sweepvi
