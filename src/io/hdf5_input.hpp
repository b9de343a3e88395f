#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "io/hdf5_handle.hpp"

namespace sweepvi {

// What readers of HDF5 files share. All throw Error (bad_input) with the file, the dataset, what was found
// and what was expected; none is collective.

/// "m.h5: /A", as messages name it.
std::string place_in(const std::string& path, const std::string& dataset);

/// How chunks are kept that were unpacked for a part of what they hold.
enum class Chunks {
  few,        ///< up to 1 MiB of a dataset: for what is read once, or in the order it was written
  whole_rows  ///< a row of chunks up to 2 GiB: for datasets read row by row, whose chunks may have any shape
};
/// For reading.
Hdf5File open_hdf5(const std::string& path, Chunks kept = Chunks::few);
Hdf5Object open_hdf5_object(hid_t file, const std::string& path, const std::string& name);

std::vector<hsize_t> shape_of(hid_t space);
/// An attribute of one value, the only kind for which a reader has room; empty if there is none.
Hdf5Attribute single_attribute(hid_t object, const char* name);
/// A short text; empty if there is none. Zero bytes and blanks at its end, with which texts of one length are
/// filled up, are left out.
std::string text_attribute(hid_t object, const char* name);

/// "shape 3 x 4".
std::string shape_text(const std::vector<hsize_t>& shape);

/// What the file holds: "/A, /group, /group/data", printable.
std::string content_of_hdf5(const std::string& path);

/// Complains about types that are no numbers. Truth values, as h5py (an enumeration) and PyTables or HDF5.jl
/// (a bit field) have them, are numbers.
/// @param whole  whether only integers will do
void check_numbers(hid_t dataset, const std::string& where, bool whole);

/// Reads numbers that check_numbers() let pass, as double.
/// @param memory, file  spaces as in H5Dread
/// @param count         of numbers
void read_reals(hid_t dataset, hid_t memory, hid_t file, double* to, std::size_t count,
                const std::string& where);

/// Complains about a shape that the file cannot hold. A damaged file may claim any size; and whoever makes a
/// matrix of a size, and never writes it, would wait for its zeros. Data kept in other files stay unchecked.
void check_extent(hid_t dataset, const std::vector<hsize_t>& shape, const std::string& where);

}  // namespace sweepvi
