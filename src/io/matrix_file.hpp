#pragma once

#include <cstdint>
#include <string>
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

// The readers below are serial: one rank reads and hands out. Matrices stored densely come without their
// zeros, those stored sparsely keep the zeros they name. Entries named twice are summed. At most 2^31 - 1
// rows and columns, because PETSc may count them in 32 bits. All throw Error (ExitCode::bad_input) with the
// file, the line or dataset, what was found and what was expected.

/// A MatrixMarket file: coordinate or array; real, integer or pattern (values 1); general, symmetric or
/// skew-symmetric (the file then holds the lower triangle). Source: R. F. Boisvert, R. Pozo, K. A. Remington,
/// The Matrix Market Exchange Formats, NISTIR 5935 (1996).
SparseEntries read_matrix_market(const std::string& path);

/// A MatrixMarket file with one column or one row.
std::vector<double> read_matrix_market_vector(const std::string& path);

/// An HDF5 dataset with two axes, or a group with one-dimensional data, indices, indptr and the attribute
/// shape = (rows, cols): compressed rows, numbered from 0.
SparseEntries read_hdf5_matrix(const std::string& path, const std::string& dataset);

/// An HDF5 dataset with one axis, or with two of which one has length 1.
/// @param infinity  whether numbers that are not finite are the caller's business
std::vector<double> read_hdf5_vector(const std::string& path, const std::string& dataset,
                                     bool infinity = false);

/// Brings the entries of each row into order and sums those of the same column.
void sort_rows(SparseEntries& matrix);

}  // namespace sweepvi
