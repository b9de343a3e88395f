// Groups of an HDF5 file that are matrices, as the programs that write them name their parts.

#include <algorithm>
#include <cctype>
#include <initializer_list>
#include <limits>
#include <optional>
#include <string_view>

#include "io/compressed.hpp"
#include "io/hdf5_arrays.hpp"
#include "io/hdf5_handle.hpp"
#include "io/hdf5_input.hpp"
#include "io/printable.hpp"
#include "parallel/memory.hpp"
#include "sweepvi/error.hpp"

namespace sweepvi {

bool is_octave(hid_t group) {
  return group >= 0 && H5Aexists(group, "OCTAVE_NEW_FORMAT") > 0;
}

std::size_t vector_length(hid_t dataset, const std::string& where, bool whole) {
  if (H5Iget_type(dataset) != H5I_DATASET)
    throw InputError(where + " is not a dataset; a vector is expected here");
  const Hdf5Space space(H5Dget_space(dataset));
  const std::vector<hsize_t> shape = shape_of(space.get());
  const bool flat = shape.size() == 1 || (shape.size() == 2 && std::min(shape[0], shape[1]) == 1);
  if (!flat) throw InputError(where + " has " + shape_text(shape) + "; a vector is expected here");
  check_numbers(dataset, where, whole);
  check_extent(dataset, shape, where);
  const hsize_t length = shape.size() == 1 ? shape[0] : std::max(shape[0], shape[1]);
  if (length > hsize_t(most_entries) + 1)
    throw InputError(where + " has " + shape_text(shape) + "; expected at most 2147483647 entries");
  require_memory(8.0 * double(length), where + ": " + shape_text(shape) + " takes");
  return static_cast<std::size_t>(length);
}

namespace {

/// A group with the names of its parts.
class Group {
public:
  Group(hid_t group, const std::string& path, const std::string& name)
      : group_(group),
        path_(path),
        where_(place_in(path, name)),
        below_(place_in(path, name == "/" ? "" : name) + "/") {}

  const std::string& where() const { return where_; }
  std::string place(const char* part) const { return below_ + part; }
  hid_t get() const { return group_; }
  Hdf5Object open(const char* part) const { return open_hdf5_object(group_, path_, part); }
  bool has(const char* part) const { return H5Lexists(group_, part, H5P_DEFAULT) > 0; }
  bool has_attribute(const char* name) const { return H5Aexists(group_, name) > 0; }
  bool has_all(std::initializer_list<const char*> parts) const {
    return std::all_of(parts.begin(), parts.end(), [&](const char* part) { return has(part); });
  }
  void expect_all(std::initializer_list<const char*> parts, const std::string& what) const {
    std::string missing, list;
    for (const char* part : parts) {
      if (!has(part)) missing += (missing.empty() ? "" : ", ") + std::string(part);
      list += (list.empty() ? "" : ", ") + std::string(part);
    }
    if (!missing.empty())
      throw InputError(where_ + " is a group without " + missing + "; " + what + " is a group with " + list);
  }
  [[noreturn]] void refuse(const std::string& what) const { throw InputError(where_ + what); }

  std::vector<std::int64_t> integers(const char* part) const {
    const Hdf5Object dataset = open(part);
    std::vector<std::int64_t> values(vector_length(dataset.get(), place(part), true));
    if (H5Dread(dataset.get(), H5T_NATIVE_INT64, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()) < 0)
      throw InputError(place(part) + " cannot be read: " + hdf5_reason());
    return values;
  }
  std::vector<double> reals(const char* part) const {
    const Hdf5Object dataset = open(part);
    if (H5Iget_type(dataset.get()) != H5I_DATASET) throw InputError(place(part) + " is not a dataset");
    return read_vector_dataset(dataset.get(), place(part), false);
  }
  /// A single integer, in a dataset or an attribute of this name.
  std::int64_t integer(const char* part) const {
    std::int64_t value = 0;
    bool good = false;
    if (has(part)) {
      const Hdf5Object dataset = open(part);
      good = H5Iget_type(dataset.get()) == H5I_DATASET;
      if (good) {
        check_numbers(dataset.get(), place(part), true);
        const Hdf5Space space(H5Dget_space(dataset.get()));
        good = H5Sget_simple_extent_npoints(space.get()) == 1 &&
               H5Dread(dataset.get(), H5T_NATIVE_INT64, H5S_ALL, H5S_ALL, H5P_DEFAULT, &value) >= 0;
      }
    } else if (const Hdf5Attribute attribute = single_attribute(group_, part)) {
      good = is_whole(attribute.get()) && H5Aread(attribute.get(), H5T_NATIVE_INT64, &value) >= 0;
    }
    if (!good) throw InputError(place(part) + " should be a single whole number");
    return value;
  }
  /// Two integers, in an attribute of this name.
  std::optional<std::vector<std::int64_t>> pair_attribute(const char* name) const {
    if (!has_attribute(name)) return std::nullopt;
    const Hdf5Attribute attribute(H5Aopen(group_, name, H5P_DEFAULT));
    const Hdf5Space space(attribute ? H5Aget_space(attribute.get()) : H5I_INVALID_HID);
    double numbers[2] = {0, 0};
    std::vector<std::int64_t> values(2);
    if (!space || H5Sget_simple_extent_npoints(space.get()) != 2 ||
        H5Aread(attribute.get(), H5T_NATIVE_DOUBLE, numbers) < 0 ||
        H5Aread(attribute.get(), H5T_NATIVE_INT64, values.data()) < 0 || double(values[0]) != numbers[0] ||
        double(values[1]) != numbers[1])
      return std::nullopt;
    return values;
  }
  /// A single text in a dataset of this name; empty if it is none.
  std::string text(const char* part) const {
    const Hdf5Object dataset = open(part);
    if (H5Iget_type(dataset.get()) != H5I_DATASET) return {};
    const Hdf5Space space(H5Dget_space(dataset.get()));
    const Hdf5Type type(H5Dget_type(dataset.get()));
    if (H5Tget_class(type.get()) != H5T_STRING || H5Sget_simple_extent_npoints(space.get()) != 1) return {};
    std::string found;
    if (H5Tis_variable_str(type.get()) > 0) {
      char* bytes = nullptr;
      if (H5Dread(dataset.get(), type.get(), H5S_ALL, H5S_ALL, H5P_DEFAULT, &bytes) >= 0 && bytes != nullptr)
        found = bytes;
      H5free_memory(bytes);
    } else if (H5Tget_size(type.get()) < 100) {
      found.resize(H5Tget_size(type.get()));
      H5Dread(dataset.get(), type.get(), H5S_ALL, H5S_ALL, H5P_DEFAULT, found.data());
    }
    found.resize(std::min(found.find('\0'), found.size()));
    return found;
  }

  Compressed arrays(std::int64_t rows, std::int64_t cols, const char* starts, const char* indices,
                    const char* values) const {
    check_size(where_, std::uint64_t(rows), std::uint64_t(cols));
    return {.rows = rows,
            .cols = cols,
            .starts = integers(starts),
            .indices = has(indices) ? integers(indices) : std::vector<std::int64_t>(),
            .values = has(values) ? reals(values) : std::vector<double>(),
            .starts_name = place(starts),
            .indices_name = place(indices),
            .values_name = place(values)};
  }

private:
  static bool is_whole(hid_t attribute) {
    const Hdf5Type type(H5Aget_type(attribute));
    return H5Tget_class(type.get()) == H5T_INTEGER;
  }

  hid_t group_;
  const std::string& path_;
  std::string where_, below_;
};

/// MATLAB -v7.3, which leaves ir and data out where there are no entries.
SparseEntries read_matlab(const Group& group) {
  if (group.has("ir") != group.has("data") || !group.has("jc"))
    group.expect_all({"data", "ir", "jc"}, "a sparse matrix of MATLAB's");
  const std::string kind = text_attribute(group.get(), "MATLAB_class");
  if (!kind.empty() && kind != "double" && kind != "logical" && kind != "single")
    group.refuse(" is a sparse variable of MATLAB's class " + in_quotes(kind) +
                 "; expected double, single or logical");
  const std::int64_t rows = group.integer("MATLAB_sparse");
  const Hdf5Object starts = group.open("jc");
  const auto cols = std::int64_t(vector_length(starts.get(), group.place("jc"), true)) - 1;
  Compressed arrays = group.arrays(rows, cols, "jc", "ir", "data");
  arrays.by_columns = true;
  return checked(std::move(arrays));
}

SparseEntries read_julia(const Group& group) {
  for (const char* part : {"m", "n"})
    if (!group.has(part) && !group.has_attribute(part))
      group.refuse(" is a group with colptr, rowval and nzval, but without " + std::string(part) +
                   "; a SparseMatrixCSC of Julia's has m rows and n columns");
  Compressed arrays = group.arrays(group.integer("m"), group.integer("n"), "colptr", "rowval", "nzval");
  arrays.by_columns = true;
  arrays.base = 1;
  return checked(std::move(arrays));
}

/// Types of Octave's that are dense matrices of numbers: "matrix", "float matrix", "int32 matrix", "bool
/// matrix".
bool is_octave_dense(std::string_view type) {
  if (!type.ends_with("matrix")) return false;
  type.remove_suffix(6);
  return type.empty() || type == "bool " || type == "float " || type.starts_with("int") ||
         type.starts_with("uint");
}

SparseEntries read_octave_sparse(hid_t value, const std::string& path, const std::string& name) {
  const Group group(value, path, name);
  group.expect_all({"nr", "nc", "cidx"}, "a sparse matrix of Octave's");
  Compressed arrays = group.arrays(group.integer("nr"), group.integer("nc"), "cidx", "ridx", "data");
  arrays.by_columns = true;
  return checked(std::move(arrays));
}

/// A variable of Octave's: a text and a value.
template <class Dense, class Sparse>
auto read_octave(const Group& group, Dense&& dense, Sparse&& sparse) {
  group.expect_all({"type", "value"}, "a variable of Octave's");
  const std::string type = group.text("type");
  const Hdf5Object value = group.open("value");
  if (group.has_attribute("OCTAVE_EMPTY_MATRIX")) group.refuse(" is an empty matrix of Octave's");
  const bool is_dataset = H5Iget_type(value.get()) == H5I_DATASET;
  if (is_octave_dense(type) && is_dataset) return dense(value.get());
  if (type.starts_with("sparse") && type.ends_with("matrix") && !is_dataset &&
      type.find("complex") == std::string::npos)
    return sparse(value.get());
  group.refuse(" is a variable of Octave's type " + in_quotes(type) + "; expected a real matrix");
}

/// How the entries of a group with data and shape are laid out.
enum class Layout { rows, columns, coordinates };

/// Whole words of a text, in small letters: "csc_matrix" has csc and matrix.
std::vector<std::string> words_of(std::string_view text) {
  std::vector<std::string> words(1);
  for (const char c : text) {
    if (std::isalnum(static_cast<unsigned char>(c)) != 0)
      words.back() += char(std::tolower(static_cast<unsigned char>(c)));
    else if (!words.back().empty())
      words.emplace_back();
  }
  return words;
}

/// What a text says about it; nothing if it does not speak of that.
/// @param must  whether it should
std::optional<Layout> layout_in(const Group& group, const std::string& name, const std::string& text,
                                bool must) {
  const std::string found = printable(name) + " is " + (text.empty() ? "no single text" : in_quotes(text));
  std::optional<Layout> layout;
  for (const std::string& word : words_of(text)) {
    const std::optional<Layout> said = word == "csr"   ? std::optional(Layout::rows)
                                       : word == "csc" ? std::optional(Layout::columns)
                                       : word == "coo" ? std::optional(Layout::coordinates)
                                                       : std::nullopt;
    if (said && layout && said != layout) group.refuse(" says in two ways how it is stored: " + found);
    if (said) layout = said;
  }
  if (!layout && must) group.refuse(": " + found + "; expected csr, csc or coo");
  return layout;
}

/// Several programs write compressed columns under the names of compressed rows, and say so in an attribute,
/// or in a dataset `format` as that of save_npz. Read as rows they would be a transposed matrix.
std::optional<Layout> layout_of(const Group& group) {
  std::optional<Layout> layout;
  const auto note = [&](const std::string& name, const std::string& text, bool must) {
    const std::optional<Layout> found = layout_in(group, name, text, must);
    if (found && layout && found != layout)
      group.refuse(" says in two ways how it is stored: " + printable(name) + " = " + in_quotes(text) +
                   " contradicts another");
    if (found) layout = found;
  };
  std::vector<std::string> names;
  const auto collect = [](hid_t, const char* name, const H5A_info_t*, void* list) -> herr_t {
    static_cast<std::vector<std::string>*>(list)->emplace_back(name);
    return 0;
  };
  H5Aiterate2(group.get(), H5_INDEX_NAME, H5_ITER_INC, nullptr, collect, &names);
  for (const std::string& name : names)
    note(name, text_attribute(group.get(), name.c_str()),
         name == "format" || name == "encoding-type" || name == "h5sparse_format");
  if (group.has("format")) note("format", group.text("format"), true);
  return layout;
}

std::vector<std::int64_t> shape_of_group(const Group& group, bool marked) {
  std::vector<std::vector<std::int64_t>> found;
  for (const char* name : {"shape", "h5sparse_shape"})
    if (const auto shape = group.pair_attribute(name)) found.push_back(*shape);
  // Without a mark, a dataset in its place is 10x Genomics' compressed columns or somebody else's rows.
  if (found.empty() && marked && group.has("shape")) found.push_back(group.integers("shape"));
  if (found.empty() || found.front().size() != 2)
    group.refuse(" should have the attribute shape with two whole numbers, rows and columns" +
                 std::string(group.has("shape") && !marked
                                 ? ", or beside the dataset shape an attribute format that is csr or csc"
                                 : ""));
  if (found.back() != found.front())
    group.refuse(" has the attributes shape and h5sparse_shape, which differ");
  const std::vector<std::int64_t>& shape = found.front();
  if (std::min(shape[0], shape[1]) < 1 || std::max(shape[0], shape[1]) > most_entries)
    group.refuse(": the attribute shape is (" + std::to_string(shape[0]) + ", " + std::to_string(shape[1]) +
                 "); expected 1 to 2147483647 rows and columns");
  return shape;
}

SparseEntries read_scipy(const Group& group) {
  const std::optional<Layout> layout = layout_of(group);
  if (layout == Layout::coordinates)
    group.expect_all({"data", "row", "col"}, "a sparse matrix in coordinates");
  else
    group.expect_all({"data", "indices", "indptr"}, "a sparse matrix, beside its attribute shape,");
  const std::vector<std::int64_t> shape = shape_of_group(group, layout.has_value());
  if (layout == Layout::coordinates)
    return from_coordinates(group.integers("row"), group.integers("col"), group.reals("data"), shape[0],
                            shape[1], group.where());
  Compressed arrays = group.arrays(shape[0], shape[1], "indptr", "indices", "data");
  arrays.by_columns = layout == Layout::columns;
  return checked(std::move(arrays));
}

SparseEntries read_group(const Group& group) {
  if (group.has_attribute("MATLAB_sparse")) return read_matlab(group);
  if (group.has_all({"ir", "jc", "data"}))
    group.refuse(" has ir, jc and data, but no attribute MATLAB_sparse with the number of rows");
  if (group.has_all({"colptr", "rowval", "nzval"})) return read_julia(group);
  return read_scipy(group);
}

}  // namespace

SparseEntries read_matrix_group(hid_t id, const std::string& path, const std::string& name) {
  const Group group(id, path, name);
  if (!is_octave(id)) return read_group(group);
  return read_octave(
      group, [&](hid_t value) { return read_dense_dataset(value, group.where()); },
      [&](hid_t value) { return read_octave_sparse(value, path, name + "/value"); });
}

std::vector<double> read_vector_group(hid_t id, const std::string& path, const std::string& name,
                                      bool infinity) {
  const Group group(id, path, name);
  if (!is_octave(id)) return as_vector(read_group(group), group.where());
  return read_octave(
      group, [&](hid_t value) { return read_vector_dataset(value, group.where(), infinity); },
      [&](hid_t value) {
        return as_vector(read_octave_sparse(value, path, name + "/value"), group.where());
      });
}

}  // namespace sweepvi
