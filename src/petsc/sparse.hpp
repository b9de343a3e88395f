#pragma once

#include <algorithm>
#include <limits>
#include <span>
#include <utility>
#include <vector>

#include "sweepvi/petsc.hpp"

namespace sweepvi {

/// Counts what was written to a vector.
PetscObjectState state_of(Vec vector);

/// A sum is rounding when it is below this, relative to the sum of the absolute values of its terms.
inline constexpr double rounding = 64 * std::numeric_limits<double>::epsilon();

/// A sparse row or vector: (index, value), sorted by index.
using SparseRow = std::vector<std::pair<PetscInt, double>>;

/// Sorts by index and adds up what has the same index.
void normalise(SparseRow& row);

/// a + factor b, both sorted.
SparseRow add(const SparseRow& a, double factor, const SparseRow& b);

/// Sum over common indices.
double dot(const SparseRow& a, const SparseRow& b);

/// Collects the rows a rank owns, in order, and makes an AIJ matrix of them: no off-process traffic, exact
/// preallocation.
class RowBuilder {
public:
  void add(PetscInt column, double value) { row_.emplace_back(column, value); }
  void add(const SparseRow& row, double factor = 1.0) {
    for (const auto& [column, value] : row)
      row_.emplace_back(column, factor * value);
  }
  void end_row();
  /// @param local_columns  this rank's share of the columns (the layout of the vectors the matrix multiplies)
  /// @throws Error (bad_input) on every rank if a rank has more entries than a PetscInt counts
  /// @note Collective on `comm`. The builder is empty afterwards.
  Matrix finish(MPI_Comm comm, PetscInt local_columns);

private:
  SparseRow row_;
  std::vector<PetscInt> starts_{0}, columns_;
  std::vector<double> values_;
};

/// Calls visit(global row, columns, values) for each row this rank owns.
template <class Visit>
void for_each_row(Mat matrix, Visit&& visit) {
  PetscInt first = 0;
  PetscInt last = 0;
  check(MatGetOwnershipRange(matrix, &first, &last));
  for (PetscInt row = first; row < last; ++row) {
    PetscInt count = 0;
    const PetscInt* columns = nullptr;
    const PetscScalar* values = nullptr;
    check(MatGetRow(matrix, row, &count, &columns, &values));
    visit(row, std::span(columns, static_cast<std::size_t>(count)),
          std::span(values, static_cast<std::size_t>(count)));
    check(MatRestoreRow(matrix, row, &count, &columns, &values));
  }
}

SparseRow get_row(Mat matrix, PetscInt row);

/// Gives `to` the entries of `from`. @return false, with nothing changed, if they do not fit into its
/// pattern.
/// @note Collective.
bool replace_values(Mat to, Mat from);

/// A copy whose entries are the absolute values; shares the sparsity pattern with its source.
/// @note Collective.
Matrix absolute_copy(Mat matrix);

/// Product of two sparse matrices. @note Collective.
Matrix multiply(Mat a, Mat b);
/// The same without entries that are rounding: below 64 eps of the sum of the absolute values of their terms.
/// @note Collective.
Matrix multiply_clean(Mat a, Mat b);
/// a + factor b. @note Collective.
Matrix add(Mat a, double factor, Mat b);
/// Transpose. @note Collective.
Matrix transpose(Mat a);

Vector make_vector(MPI_Comm comm, PetscInt local_size);
Vector duplicate(Vec vector);

struct LocalRange {
  PetscInt first = 0, last = 0;
  PetscInt size() const { return last - first; }
  bool contains(PetscInt i) const { return i >= first && i < last; }
};
LocalRange row_range(Mat matrix);
LocalRange column_range(Mat matrix);

}  // namespace sweepvi
