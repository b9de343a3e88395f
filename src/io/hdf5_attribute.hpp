#pragma once

#include <hdf5.h>

#include <cstdint>
#include <string>
#include <vector>

namespace sweepvi {

/// Writes an attribute of an HDF5 object, replacing one of the same name. Text is UTF-8 of variable length,
/// which h5py gives back as `str` and which may be longer than the 64 KiB an attribute holds itself.
///
/// Collective if the file was opened with MPI; every rank then passes the same value.
/// @return false if HDF5 could not do it; hdf5_reason() knows why
bool write_attribute(hid_t object, const std::string& name, const std::string& value);
bool write_attribute(hid_t object, const std::string& name, const std::vector<std::string>& values);
bool write_attribute(hid_t object, const std::string& name, double value);
bool write_attribute(hid_t object, const std::string& name, std::int64_t value);

}  // namespace sweepvi
