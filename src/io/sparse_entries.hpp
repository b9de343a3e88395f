#pragma once

#include <cstdint>
#include <vector>

namespace sweepvi {

/// A sparse matrix in compressed rows, numbered from 0. Row i has the entries row_starts[i] <= k <
/// row_starts[i+1]; their columns increase strictly, their values are finite.
struct SparseEntries {
  std::int64_t rows = 0;
  std::int64_t cols = 0;
  std::vector<std::int64_t> row_starts;  ///< length rows + 1
  std::vector<std::int64_t> columns;     ///< one per entry
  std::vector<double> values;            ///< one per entry

  double entry(std::int64_t i, std::int64_t j) const;  ///< 0 where there is none
};

/// Brings the entries of each row into order and sums those of the same column.
void sort_rows(SparseEntries& matrix);

}  // namespace sweepvi
