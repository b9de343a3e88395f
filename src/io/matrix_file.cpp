#include "io/matrix_file.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include "io/hdf5_guard.hpp"
#include "io/hdf5_handle.hpp"
#include "io/hdf5_input.hpp"
#include "parallel/memory.hpp"
#include "sweepvi/error.hpp"

namespace sweepvi {

double SparseEntries::entry(std::int64_t i, std::int64_t j) const {
  const auto first = columns.begin() + row_starts[static_cast<std::size_t>(i)];
  const auto last = columns.begin() + row_starts[static_cast<std::size_t>(i) + 1];
  const auto at = std::lower_bound(first, last, j);
  return at == last || *at != j ? 0.0 : values[static_cast<std::size_t>(at - columns.begin())];
}
namespace {

constexpr hsize_t most = std::numeric_limits<std::int32_t>::max();  // of rows, of columns, of entries

template <class T>
std::vector<T> read_column(hid_t object, const std::string& where, hid_t type, bool infinity = false) {
  if (H5Iget_type(object) != H5I_DATASET)
    throw InputError(where + " is not a dataset; a vector is expected here");
  const Hdf5Space space(H5Dget_space(object));
  const std::vector<hsize_t> shape = shape_of(space.get());
  const bool flat = shape.size() == 1 || (shape.size() == 2 && std::min(shape[0], shape[1]) == 1);
  if (!flat) throw InputError(where + " has " + shape_text(shape) + "; a vector is expected here");
  check_numbers(object, where, std::is_integral_v<T>);
  check_extent(object, shape, where);
  const hsize_t length = shape.size() == 1 ? shape[0] : std::max(shape[0], shape[1]);
  if (length > most)
    throw InputError(where + " has " + shape_text(shape) + "; expected at most 2147483647 entries");
  require_memory(double(sizeof(T)) * double(length), where + ": " + shape_text(shape) + " takes");
  std::vector<T> values(static_cast<std::size_t>(length));
  if (H5Dread(object, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()) < 0)
    throw InputError(where + " cannot be read: " + hdf5_reason());
  if constexpr (std::is_floating_point_v<T>)
    if (!infinity) check_finite(values.data(), values.size(), where, 0, 0);
  return values;
}

void check_size(const std::string& where, hsize_t rows, hsize_t cols) {
  if (rows < 1 || cols < 1 || rows > most || cols > most)
    throw InputError(where + " has " + shape_text({rows, cols}) +
                     "; expected 1 to 2147483647 rows and columns");
}

SparseEntries read_dense(hid_t dataset, const std::string& where) {
  const Hdf5Space space(H5Dget_space(dataset));
  const std::vector<hsize_t> shape = shape_of(space.get());
  if (shape.size() != 2)
    throw InputError(where + " has " + shape_text(shape) + "; a matrix with two axes is expected here");
  const hsize_t rows = shape[0], cols = shape[1];
  check_size(where, rows, cols);
  check_numbers(dataset, where, false);
  check_extent(dataset, shape, where);
  require_memory(8.0 * double(rows), where + ": " + shape_text(shape) + " takes");
  SparseEntries matrix{std::int64_t(rows), std::int64_t(cols), {0}, {}, {}};
  // Some rows at a time: the zeros of a large matrix need not be in memory all at once.
  const hsize_t block = std::clamp((hsize_t{1} << 20) / cols, hsize_t{1}, rows);
  std::vector<double> values(block * cols);
  for (hsize_t first = 0; first < rows; first += block) {
    const hsize_t start[] = {first, 0}, count[] = {std::min(block, rows - first), cols};
    const Hdf5Space memory(H5Screate_simple(2, count, nullptr));
    if (H5Sselect_hyperslab(space.get(), H5S_SELECT_SET, start, nullptr, count, nullptr) < 0 ||
        H5Dread(dataset, H5T_NATIVE_DOUBLE, memory.get(), space.get(), H5P_DEFAULT, values.data()) < 0)
      throw InputError(where + " cannot be read: " + hdf5_reason());
    check_finite(values.data(), count[0] * cols, where, first * cols, cols);
    for (hsize_t i = 0; i < count[0]; ++i) {
      for (hsize_t j = 0; j < cols; ++j) {
        const double value = values[i * cols + j];
        if (value == 0) continue;
        matrix.columns.push_back(std::int64_t(j));
        matrix.values.push_back(value);
      }
      matrix.row_starts.push_back(std::int64_t(matrix.values.size()));
    }
    if (matrix.values.size() > most)
      throw InputError(where + " has more than 2147483647 entries that are not 0; that is the most");
  }
  return matrix;
}

/// Several programs write compressed columns under the same names, and say so in an attribute. Read as rows
/// they would be a transposed matrix.
void refuse_columns(hid_t group, const std::string& where) {
  for (const char* name : {"encoding-type", "h5sparse_format"}) {
    if (text_attribute(group, name).starts_with("csc"))
      throw InputError(where + " is stored by columns (" + name + " is csc); store it by rows (csr)");
  }
}

SparseEntries read_sparse(hid_t group, const std::string& path, const std::string& name) {
  const std::string where = place_in(path, name), below = place_in(path, name == "/" ? "" : name) + "/";
  std::string missing;
  for (const char* part : {"data", "indices", "indptr"})
    if (H5Lexists(group, part, H5P_DEFAULT) <= 0)
      missing += (missing.empty() ? "" : ", ") + std::string(part);
  if (!missing.empty())
    throw InputError(where + " is a group without " + missing +
                     "; a sparse matrix is a group with data, indices, indptr and the attribute shape");
  refuse_columns(group, where);
  std::int64_t shape[2] = {0, 0};
  const Hdf5Attribute attribute(H5Aexists(group, "shape") > 0 ? H5Aopen(group, "shape", H5P_DEFAULT)
                                                              : H5I_INVALID_HID);
  const Hdf5Space space(attribute ? H5Aget_space(attribute.get()) : H5I_INVALID_HID);
  if (!attribute || H5Sget_simple_extent_npoints(space.get()) != 2 ||
      H5Aread(attribute.get(), H5T_NATIVE_INT64, shape) < 0)
    throw InputError(where + " should have the attribute shape with two whole numbers, rows and columns");
  if (shape[0] < 1 || shape[1] < 1 || hsize_t(std::max(shape[0], shape[1])) > most)
    throw InputError(where + ": the attribute shape is (" + std::to_string(shape[0]) + ", " +
                     std::to_string(shape[1]) + "); expected 1 to 2147483647 rows and columns");

  const auto part = [&](const char* what) { return open_hdf5_object(group, path, what); };
  SparseEntries matrix{shape[0], shape[1], {}, {}, {}};
  matrix.row_starts = read_column<std::int64_t>(part("indptr").get(), below + "indptr", H5T_NATIVE_INT64);
  matrix.columns = read_column<std::int64_t>(part("indices").get(), below + "indices", H5T_NATIVE_INT64);
  matrix.values = read_column<double>(part("data").get(), below + "data", H5T_NATIVE_DOUBLE);
  const auto& starts = matrix.row_starts;
  const std::size_t count = matrix.values.size();
  if (starts.size() != std::size_t(shape[0]) + 1)
    throw InputError(below + "indptr has length " + std::to_string(starts.size()) +
                     "; expected rows + 1 = " + std::to_string(shape[0] + 1));
  if (matrix.columns.size() != count)
    throw InputError(below + "indices has length " + std::to_string(matrix.columns.size()) +
                     "; expected that of data, " + std::to_string(count));
  if (starts.front() != 0 || starts.back() != std::int64_t(count))
    throw InputError(below + "indptr goes from " + std::to_string(starts.front()) + " to " +
                     std::to_string(starts.back()) + "; expected 0 to the length of data, " +
                     std::to_string(count));
  const auto drop = std::is_sorted_until(starts.begin(), starts.end());
  if (drop != starts.end())
    throw InputError(below + "indptr should not decrease, found " + std::to_string(*drop) + " after " +
                     std::to_string(*(drop - 1)) + " at [" + std::to_string(drop - starts.begin()) + "]");
  const auto bad = std::find_if(matrix.columns.begin(), matrix.columns.end(),
                                [&](std::int64_t j) { return j < 0 || j >= shape[1]; });
  if (bad != matrix.columns.end())
    throw InputError(below + "indices holds column " + std::to_string(*bad) + " at [" +
                     std::to_string(bad - matrix.columns.begin()) + "]; expected 0 ... " +
                     std::to_string(shape[1] - 1));
  sort_rows(matrix);
  check_finite(matrix.values.data(), matrix.values.size(), below + "data, after summing equal places,", 0, 0);
  return matrix;
}

}  // namespace

SparseEntries read_hdf5_matrix(const std::string& path, const std::string& dataset) {
  const QuietHdf5 quiet;
  const Hdf5Guard guard(path);
  const Hdf5File file = open_hdf5(path);
  const Hdf5Object object = open_hdf5_object(file.get(), path, dataset);
  switch (H5Iget_type(object.get())) {
    case H5I_DATASET:
      return read_dense(object.get(), place_in(path, dataset));
    case H5I_GROUP:
      return read_sparse(object.get(), path, dataset);
    default:
      throw InputError(place_in(path, dataset) + " is neither a dataset nor a group");
  }
}

std::vector<double> read_hdf5_vector(const std::string& path, const std::string& dataset, bool infinity) {
  const QuietHdf5 quiet;
  const Hdf5Guard guard(path);
  const Hdf5File file = open_hdf5(path);
  const Hdf5Object object = open_hdf5_object(file.get(), path, dataset);
  return read_column<double>(object.get(), place_in(path, dataset), H5T_NATIVE_DOUBLE, infinity);
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

}  // namespace sweepvi
