#pragma once

#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "io/sparse_entries.hpp"

namespace sweepvi {

// What the readers of matrices share. All throw Error (bad_input).

constexpr std::int64_t most_entries = std::numeric_limits<std::int32_t>::max();  ///< and rows, and columns

/// Complains about a size that is not 1 to 2^31 - 1 rows and columns.
void check_size(const std::string& where, std::uint64_t rows, std::uint64_t cols);

/// Complains about the first value that is not finite.
/// @param offset  of the first value among all that are read
/// @param width   of their rows, 0 if they have one axis
void check_finite(const double* values, std::size_t count, const std::string& where, std::uint64_t offset = 0,
                  std::uint64_t width = 0);

/// Entries in any order.
struct Triplets {
  std::vector<std::int32_t> row, column;  ///< from 0
  std::vector<double> value;

  void reserve(std::size_t count);
  void add(std::int64_t i, std::int64_t j, double v);  ///< throws if the memory for it is not there
};

/// @param mirror  0: the entries are all there are; 1 or -1: each one off the diagonal stands for itself and,
///                times `mirror`, for its mirror image
SparseEntries compress(const Triplets& entries, std::int64_t rows, std::int64_t cols, int mirror,
                       const std::string& where);

/// Rows, columns and values of entries in any order, numbered from 0; equal places are summed.
SparseEntries from_coordinates(const std::vector<std::int64_t>& row, const std::vector<std::int64_t>& col,
                               const std::vector<double>& data, std::int64_t rows, std::int64_t cols,
                               const std::string& where);

/// The arrays of a matrix compressed by rows or by columns, as a file has them.
struct Compressed {
  std::int64_t rows = 0, cols = 0;
  bool by_columns = false;
  std::int64_t base = 0;                ///< number of the first row, column and entry
  std::vector<std::int64_t> starts{};   ///< length rows + 1 (columns + 1), from `base`
  std::vector<std::int64_t> indices{};  ///< columns (rows) of the entries
  std::vector<double> values{};
  std::string starts_name, indices_name, values_name;  ///< with the file, for messages
};

/// Checks that the arrays are what they should be, and brings them into rows, in order.
SparseEntries checked(Compressed&& arrays);

SparseEntries transposed(const SparseEntries& matrix);

/// Collects a dense matrix row by row without its zeros. Where a file has columns one after another they are
/// handed in as rows, and the result transposed.
class DenseRows {
public:
  DenseRows(std::uint64_t rows, std::uint64_t cols, bool by_columns, const std::string& where);
  /// The next rows; the last block may be smaller.
  void append(const double* values, std::uint64_t count);
  std::uint64_t block_rows() const { return block_; }  ///< as many as should be read at a time
  SparseEntries finish();

private:
  std::string where_;
  bool by_columns_;
  std::uint64_t rows_, cols_, block_;  // as the file has them
  SparseEntries matrix_;
};

/// A matrix of one column or one row.
std::vector<double> as_vector(const SparseEntries& matrix, const std::string& where);

}  // namespace sweepvi
