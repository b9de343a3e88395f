#pragma once

#include <vector>

#include "sweepvi/dvi.hpp"

namespace sweepvi {

/// This rank's rows of a matrix K in compressed form, for what a step asks of an affine F(u) = K u - b: its
/// values and the terms they are summed from in one pass over K, instead of a MatMult each and a copy of |K|.
class AffineRows {
public:
  AffineRows() = default;
  /// Copies the entries of K (AIJ). @note Collective, like all that takes vectors.
  explicit AffineRows(Mat K);

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

  PetscInt size() const { return static_cast<PetscInt>(starts_.size()) - 1; }
  /// Rows are [starts[i], starts[i+1]) of columns and values. Columns count this rank's entries of a vector
  /// first, then those of other ranks in the order of `ghosts`.
  const std::vector<PetscInt>& starts() const { return starts_; }
  const std::vector<PetscInt>& columns() const { return columns_; }
  const std::vector<double>& values() const { return values_; }

  /// The entries of u on other ranks that rows read; valid until the next call. Null where all are our own.
  const double* ghosts(Vec u) const;

private:
  struct Row {
    double sum = 0.0, size = 0.0;
  };
  Row row(PetscInt i, const double* own, const double* others) const;
  template <class Visit>
  void evaluate_each(Vec u, Vec b, Vec b_terms, Vec f, Vec terms, Visit&& visit) const;

  std::vector<PetscInt> starts_, columns_;
  std::vector<double> values_;
  Scatter scatter_;  // empty: no rank reads another one's
  Vector ghosts_;
};

}  // namespace sweepvi
