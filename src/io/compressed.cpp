#include "io/compressed.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "parallel/memory.hpp"
#include "sweepvi/error.hpp"

namespace sweepvi {

using std::to_string;

double SparseEntries::entry(std::int64_t i, std::int64_t j) const {
  const auto first = columns.begin() + row_starts[static_cast<std::size_t>(i)];
  const auto last = columns.begin() + row_starts[static_cast<std::size_t>(i) + 1];
  const auto at = std::lower_bound(first, last, j);
  return at == last || *at != j ? 0.0 : values[static_cast<std::size_t>(at - columns.begin())];
}

void sort_rows(SparseEntries& matrix) {
  std::vector<std::pair<std::int64_t, double>> row;
  std::size_t first = 0, kept = 0;
  for (std::size_t i = 0; i < std::size_t(matrix.rows); ++i) {
    const auto last = std::size_t(matrix.row_starts[i + 1]);
    row.clear();
    for (std::size_t k = first; k < last; ++k)
      row.emplace_back(matrix.columns[k], matrix.values[k]);
    const auto before = [](const auto& a, const auto& b) { return a.first < b.first; };
    // Stable, so that equal places are always summed in the order of the file.
    if (!std::is_sorted(row.begin(), row.end(), before)) std::stable_sort(row.begin(), row.end(), before);
    const std::size_t begin = kept;
    for (const auto& [column, value] : row) {
      if (kept > begin && matrix.columns[kept - 1] == column) {
        matrix.values[kept - 1] += value;
      } else {
        matrix.columns[kept] = column;
        matrix.values[kept++] = value;
      }
    }
    first = last;
    matrix.row_starts[i + 1] = std::int64_t(kept);
  }
  matrix.columns.resize(kept);
  matrix.values.resize(kept);
}

void check_size(const std::string& where, std::uint64_t rows, std::uint64_t cols) {
  const auto most = std::uint64_t(most_entries);
  if (rows < 1 || cols < 1 || rows > most || cols > most)
    throw InputError(where + " has shape " + to_string(rows) + " x " + to_string(cols) +
                     "; expected 1 to 2147483647 rows and columns");
}

void check_finite(const double* values, std::size_t count, const std::string& where, std::uint64_t offset,
                  std::uint64_t width) {
  const double* bad = std::find_if_not(values, values + count, [](double v) { return std::isfinite(v); });
  if (bad == values + count) return;
  const std::uint64_t index = offset + std::uint64_t(bad - values);
  throw InputError(
      where + " should hold finite numbers, found " + to_string(*bad) + " at [" +
      (width > 0 ? to_string(index / width) + ", " + to_string(index % width) : to_string(index)) + "]");
}

void Triplets::reserve(std::size_t count) {
  require_memory(16.0 * double(count), to_string(count) + " entries of a matrix take");
  row.reserve(count);
  column.reserve(count);
  value.reserve(count);
}

void Triplets::add(std::int64_t i, std::int64_t j, double v) {
  if (value.size() == value.capacity()) reserve(std::max<std::size_t>(64, 2 * value.size()));
  row.push_back(std::int32_t(i));
  column.push_back(std::int32_t(j));
  value.push_back(v);
}

SparseEntries compress(const Triplets& entries, std::int64_t rows, std::int64_t cols, int mirror,
                       const std::string& where) {
  SparseEntries matrix{rows, cols, std::vector<std::int64_t>(std::size_t(rows) + 1, 0), {}, {}};
  std::vector<std::int64_t>& starts = matrix.row_starts;
  const auto each = [&](auto&& use) {
    for (std::size_t k = 0; k < entries.value.size(); ++k) {
      const std::int32_t i = entries.row[k], j = entries.column[k];
      use(i, j, entries.value[k]);
      if (mirror != 0 && i != j) use(j, i, mirror * entries.value[k]);
    }
  };
  each([&](std::int32_t i, std::int32_t, double) { ++starts[std::size_t(i) + 1]; });
  for (std::size_t i = 0; i < std::size_t(rows); ++i)
    starts[i + 1] += starts[i];
  require_memory(16.0 * double(starts.back()), where + ": " + to_string(starts.back()) + " entries take");
  matrix.columns.resize(std::size_t(starts.back()));
  matrix.values.resize(std::size_t(starts.back()));
  // starts[i] walks through row i, and ends up where row i + 1 began.
  each([&](std::int32_t i, std::int32_t j, double value) {
    const auto place = std::size_t(starts[std::size_t(i)]++);
    matrix.columns[place] = j;
    matrix.values[place] = value;
  });
  std::copy_backward(starts.begin(), starts.end() - 1, starts.end());
  starts.front() = 0;
  sort_rows(matrix);
  return matrix;
}

SparseEntries from_coordinates(const std::vector<std::int64_t>& row, const std::vector<std::int64_t>& col,
                               const std::vector<double>& data, std::int64_t rows, std::int64_t cols,
                               const std::string& where) {
  if (row.size() != data.size() || col.size() != data.size())
    throw InputError(where + ": row, col and data have lengths " + to_string(row.size()) + ", " +
                     to_string(col.size()) + " and " + to_string(data.size()) + "; expected the same");
  if (std::ssize(data) > most_entries)
    throw InputError(where + " has " + to_string(data.size()) + " entries; expected at most 2147483647");
  Triplets entries;
  entries.reserve(data.size());
  for (std::size_t k = 0; k < data.size(); ++k) {
    if (row[k] < 0 || row[k] >= rows || col[k] < 0 || col[k] >= cols)
      throw InputError(where + ": entry " + to_string(k) + " is at (" + to_string(row[k]) + ", " +
                       to_string(col[k]) + "), outside a matrix of " + to_string(rows) + " x " +
                       to_string(cols) + " numbered from 0");
    entries.add(row[k], col[k], data[k]);
  }
  SparseEntries matrix = compress(entries, rows, cols, 0, where);
  check_finite(matrix.values.data(), matrix.values.size(), where + ": data, after summing equal places,");
  return matrix;
}

SparseEntries transposed(const SparseEntries& matrix) {
  SparseEntries result{
      matrix.cols, matrix.rows, std::vector<std::int64_t>(std::size_t(matrix.cols) + 1, 0), {}, {}};
  std::vector<std::int64_t>& starts = result.row_starts;
  for (const std::int64_t j : matrix.columns)
    ++starts[std::size_t(j) + 1];
  for (std::size_t j = 0; j < std::size_t(matrix.cols); ++j)
    starts[j + 1] += starts[j];
  result.columns.resize(matrix.columns.size());
  result.values.resize(matrix.values.size());
  for (std::size_t i = 0; i < std::size_t(matrix.rows); ++i)
    for (auto k = std::size_t(matrix.row_starts[i]); k < std::size_t(matrix.row_starts[i + 1]); ++k) {
      const auto place = std::size_t(starts[std::size_t(matrix.columns[k])]++);
      result.columns[place] = std::int64_t(i);
      result.values[place] = matrix.values[k];
    }
  std::copy_backward(starts.begin(), starts.end() - 1, starts.end());
  starts.front() = 0;
  return result;
}

SparseEntries checked(Compressed&& arrays) {
  const bool columns = arrays.by_columns;
  const std::int64_t major = columns ? arrays.cols : arrays.rows;
  const std::int64_t minor = columns ? arrays.rows : arrays.cols;
  std::vector<std::int64_t>& starts = arrays.starts;
  const std::string where = arrays.starts_name;
  const std::size_t count = arrays.values.size();
  const std::int64_t base = arrays.base;
  if (starts.size() != std::size_t(major) + 1)
    throw InputError(where + " has length " + to_string(starts.size()) + "; expected " +
                     (columns ? "columns" : "rows") + " + 1 = " + to_string(major + 1) +
                     (starts.size() == std::size_t(minor) + 1
                          ? std::string(", unless the matrix is stored by ") + (columns ? "rows" : "columns")
                          : ""));
  if (arrays.indices.size() != count)
    throw InputError(arrays.indices_name + " has length " + to_string(arrays.indices.size()) +
                     "; expected that of " + arrays.values_name.substr(arrays.values_name.rfind('/') + 1) +
                     ", " + to_string(count));
  if (starts.front() != base || starts.back() != base + std::int64_t(count))
    throw InputError(where + " goes from " + to_string(starts.front()) + " to " + to_string(starts.back()) +
                     "; expected " + to_string(base) + " to " +
                     (base == 0 ? "the length" : to_string(base) + " + the length") + " of " +
                     arrays.values_name.substr(arrays.values_name.rfind('/') + 1) + ", " + to_string(count));
  const auto drop = std::is_sorted_until(starts.begin(), starts.end());
  if (drop != starts.end())
    throw InputError(where + " should not decrease, found " + to_string(*drop) + " after " +
                     to_string(*(drop - 1)) + " at [" + to_string(drop - starts.begin()) + "]");
  const auto bad = std::find_if(arrays.indices.begin(), arrays.indices.end(),
                                [&](std::int64_t j) { return j < base || j >= base + minor; });
  if (bad != arrays.indices.end())
    throw InputError(arrays.indices_name + " holds " + (columns ? "row " : "column ") + to_string(*bad) +
                     " at [" + to_string(bad - arrays.indices.begin()) + "]; expected " + to_string(base) +
                     " ... " + to_string(base + minor - 1));
  if (base != 0) {
    for (std::int64_t& start : starts)
      start -= base;
    for (std::int64_t& index : arrays.indices)
      index -= base;
  }
  SparseEntries matrix{major, minor, std::move(starts), std::move(arrays.indices), std::move(arrays.values)};
  if (columns) matrix = transposed(matrix);
  sort_rows(matrix);
  check_finite(matrix.values.data(), matrix.values.size(),
               arrays.values_name + ", after summing equal places,");
  return matrix;
}

DenseRows::DenseRows(std::uint64_t rows, std::uint64_t cols, bool by_columns, const std::string& where)
    : where_(where), by_columns_(by_columns), rows_(rows), cols_(cols) {
  check_size(where, rows, cols);
  // Some rows at a time: the zeros of a large matrix need not be in memory all at once.
  block_ = std::clamp((std::uint64_t{1} << 20U) / cols, std::uint64_t{1}, rows);
  require_memory(8.0 * (double(rows) + double(block_) * double(cols)),
                 where + ": shape " + to_string(rows) + " x " + to_string(cols) + " takes");
  matrix_ = {std::int64_t(rows), std::int64_t(cols), {0}, {}, {}};
}

void DenseRows::append(const double* values, std::uint64_t count) {
  check_finite(values, count * cols_, where_, std::uint64_t(matrix_.row_starts.size() - 1) * cols_, cols_);
  for (std::uint64_t i = 0; i < count; ++i) {
    for (std::uint64_t j = 0; j < cols_; ++j) {
      const double value = values[i * cols_ + j];
      if (value == 0) continue;
      if (matrix_.values.size() == matrix_.values.capacity())
        require_memory(32.0 * double(matrix_.values.size()), where_ + ": its entries take");
      matrix_.columns.push_back(std::int64_t(j));
      matrix_.values.push_back(value);
    }
    matrix_.row_starts.push_back(std::int64_t(matrix_.values.size()));
  }
  if (std::ssize(matrix_.values) > most_entries)
    throw InputError(where_ + " has more than 2147483647 entries that are not 0; that is the most");
}

SparseEntries DenseRows::finish() {
  return by_columns_ ? transposed(matrix_) : std::move(matrix_);
}

std::vector<double> as_vector(const SparseEntries& matrix, const std::string& where) {
  if (matrix.rows != 1 && matrix.cols != 1)
    throw InputError(where + ": a vector is expected here, and the file holds a " + to_string(matrix.rows) +
                     " x " + to_string(matrix.cols) + " matrix; give it one column or one row");
  const std::int64_t length = std::max(matrix.rows, matrix.cols);
  require_memory(8.0 * double(length), where + ": a vector of length " + to_string(length) + " takes");
  std::vector<double> vector(std::size_t(length), 0.0);
  for (std::size_t i = 0; i < std::size_t(matrix.rows); ++i)
    for (auto k = std::size_t(matrix.row_starts[i]); k < std::size_t(matrix.row_starts[i + 1]); ++k)
      vector[std::max(i, std::size_t(matrix.columns[k]))] = matrix.values[k];
  return vector;
}

}  // namespace sweepvi
