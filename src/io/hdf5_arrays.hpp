#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "io/hdf5_handle.hpp"
#include "io/sparse_entries.hpp"

namespace sweepvi {

// Parts of the reader of HDF5 matrices: an open dataset or group, and its name in messages. All throw Error
// (bad_input); none is collective.

SparseEntries read_dense_dataset(hid_t dataset, const std::string& where);
std::vector<double> read_vector_dataset(hid_t dataset, const std::string& where, bool infinity);

/// A group that is a matrix, see read_hdf5_matrix(). @param name  in the file, as the scene has it
SparseEntries read_matrix_group(hid_t group, const std::string& path, const std::string& name);
std::vector<double> read_vector_group(hid_t group, const std::string& path, const std::string& name,
                                      bool infinity);

/// Whether a group is what Octave's `save -hdf5` writes of a variable.
bool is_octave(hid_t group);

/// Length of a dataset of numbers with one axis, or two of which one has length 1, that can be read as a
/// whole.
/// @param whole  whether only integers will do
std::size_t vector_length(hid_t dataset, const std::string& where, bool whole);

}  // namespace sweepvi
