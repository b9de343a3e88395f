// Dense matrices and vectors in HDF5 files; groups that are sparse matrices are in hdf5_sparse.cpp.

#include <algorithm>
#include <array>
#include <fstream>
#include <string_view>

#include "io/compressed.hpp"
#include "io/hdf5_arrays.hpp"
#include "io/hdf5_guard.hpp"
#include "io/hdf5_handle.hpp"
#include "io/hdf5_input.hpp"
#include "io/matrix_file.hpp"
#include "io/printable.hpp"
#include "parallel/memory.hpp"
#include "sweepvi/error.hpp"

namespace sweepvi {

namespace {

/// Whether the file of an object begins as those of programs that have columns one after another in memory,
/// and write the axes in the other order for that.
bool of_column_major_program(hid_t object) {
  const Hdf5Object file(H5Iget_file_id(object));
  const Hdf5Properties creation(H5Fget_create_plist(file.get()));
  hsize_t block = 0;
  std::array<char, 4096> name{};
  if (H5Pget_userblock(creation.get(), &block) < 0 || block == 0 ||
      H5Fget_name(file.get(), name.data(), name.size()) <= 0)
    return false;
  std::array<char, 64> bytes{};
  std::ifstream(name.data(), std::ios::binary).read(bytes.data(), bytes.size());
  const std::string_view head(bytes.data(), bytes.size());
  for (const std::string_view program :
       {"MATLAB 7.3 MAT-file", "Julia data file (HDF5)", "HDF5-based Julia Data Format"})
    if (head.starts_with(program)) return true;
  return false;
}

/// The group that holds an object, by the name it was opened with.
Hdf5Object parent_of(hid_t object) {
  std::string name(std::size_t(std::max<ssize_t>(H5Iget_name(object, nullptr, 0), 0)) + 1, '\0');
  H5Iget_name(object, name.data(), name.size());
  const std::size_t slash = name.rfind('/');
  if (slash == std::string::npos) return {};
  name.resize(std::max<std::size_t>(slash, 1));
  return Hdf5Object(H5Oopen(object, name.c_str(), H5P_DEFAULT));
}

/// Complains about what MATLAB writes of things that are no matrices of numbers, and of empty ones.
void check_matlab_class(hid_t dataset, const std::string& where) {
  const std::string name = text_attribute(dataset, "MATLAB_class");
  const std::array<std::string_view, 11> known = {"double", "single", "logical", "int8",  "uint8", "int16",
                                                  "uint16", "int32",  "uint32",  "int64", "uint64"};
  if (std::find(known.begin(), known.end(), name) == known.end())
    throw InputError(where + " is a variable of MATLAB's class " + in_quotes(name) +
                     "; expected numbers: double, single, logical or integers");
  if (H5Aexists(dataset, "MATLAB_empty") > 0) throw InputError(where + " is an empty matrix of MATLAB's");
}

/// Whether rows and columns of a dataset are the other way round than HDF5 says.
bool has_axes_exchanged(hid_t dataset) {
  return H5Aexists(dataset, "MATLAB_class") > 0 || is_octave(parent_of(dataset).get()) ||
         of_column_major_program(dataset);
}

/// Complains about datasets that look like real numbers and are something else.
void refuse_disguised(hid_t dataset, const std::string& where) {
  if (H5Aexists(dataset, "complex") > 0)
    throw InputError(where + " is marked as complex, as PETSc does; expected real numbers");
  if (H5Aexists(dataset, "MATLAB_class") > 0) check_matlab_class(dataset, where);
  for (const char* name : {"scale_factor", "add_offset"})
    if (H5Aexists(dataset, name) > 0)
      throw InputError(where + " has the attribute " + name +
                       ": its numbers are packed as in netCDF; store them unpacked");
  const Hdf5Object parent = parent_of(dataset);
  if (is_octave(parent.get()) && H5Aexists(parent.get(), "OCTAVE_EMPTY_MATRIX") > 0)
    throw InputError(where + " is an empty matrix of Octave's");
}

}  // namespace

std::vector<double> read_vector_dataset(hid_t dataset, const std::string& where, bool infinity) {
  refuse_disguised(dataset, where);
  const Hdf5Space space(H5Dget_space(dataset));
  const auto length = vector_length(dataset, where, false);
  std::vector<double> values(length);
  read_reals(dataset, H5S_ALL, H5S_ALL, values.data(), values.size(), where);
  if (!infinity) check_finite(values.data(), values.size(), where);
  return values;
}

SparseEntries read_dense_dataset(hid_t dataset, const std::string& where) {
  const Hdf5Space space(H5Dget_space(dataset));
  const std::vector<hsize_t> shape = shape_of(space.get());
  if (shape.size() != 2)
    throw InputError(where + " has " + shape_text(shape) + "; a matrix with two axes is expected here");
  const hsize_t rows = shape[0], cols = shape[1];
  check_size(where, rows, cols);
  check_numbers(dataset, where, false);
  refuse_disguised(dataset, where);
  check_extent(dataset, shape, where);
  DenseRows dense(rows, cols, has_axes_exchanged(dataset), where);
  std::vector<double> values(dense.block_rows() * cols);
  for (hsize_t first = 0; first < rows; first += dense.block_rows()) {
    const hsize_t start[] = {first, 0}, count[] = {std::min<hsize_t>(dense.block_rows(), rows - first), cols};
    const Hdf5Space memory(H5Screate_simple(2, count, nullptr));
    if (H5Sselect_hyperslab(space.get(), H5S_SELECT_SET, start, nullptr, count, nullptr) < 0)
      throw InputError(where + " cannot be read: " + hdf5_reason());
    read_reals(dataset, memory.get(), space.get(), values.data(), count[0] * cols, where);
    dense.append(values.data(), count[0]);
  }
  return dense.finish();
}

SparseEntries read_hdf5_matrix(const std::string& path, const std::string& dataset) {
  const QuietHdf5 quiet;
  const Hdf5Guard guard(path);
  const Hdf5File file = open_hdf5(path, Chunks::whole_rows);
  const Hdf5Object object = open_hdf5_object(file.get(), path, dataset);
  switch (H5Iget_type(object.get())) {
    case H5I_DATASET:
      return read_dense_dataset(object.get(), place_in(path, dataset));
    case H5I_GROUP:
      return read_matrix_group(object.get(), path, dataset);
    default:
      throw InputError(place_in(path, dataset) + " is neither a dataset nor a group");
  }
}

std::vector<double> read_hdf5_vector(const std::string& path, const std::string& dataset, bool infinity) {
  const QuietHdf5 quiet;
  const Hdf5Guard guard(path);
  const Hdf5File file = open_hdf5(path);
  const Hdf5Object object = open_hdf5_object(file.get(), path, dataset);
  switch (H5Iget_type(object.get())) {
    case H5I_DATASET:
      return read_vector_dataset(object.get(), place_in(path, dataset), infinity);
    case H5I_GROUP:
      return read_vector_group(object.get(), path, dataset, infinity);
    default:
      throw InputError(place_in(path, dataset) + " is not a dataset; a vector is expected here");
  }
}

}  // namespace sweepvi
