#include "io/hdf5_input.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>

#include "io/confinement.hpp"
#include "io/hdf5_guard.hpp"
#include "io/printable.hpp"
#include "sweepvi/error.hpp"

namespace sweepvi {

namespace {

/// What a file holds, for those who asked for something else: "/A, /group, /group/data".
std::string content_of(hid_t file) {
  std::vector<std::string> names;
  const auto note = [](hid_t, const char* name, const H5O_info_t*, void* list) -> herr_t {
    auto& found = *static_cast<std::vector<std::string>*>(list);
    constexpr std::size_t most = 200;  // of a name
    if (std::strcmp(name, ".") != 0) found.push_back("/" + printable(std::string_view(name).substr(0, most)));
    return found.size() > 20;  // enough for a message
  };
  H5Ovisit2(file, H5_INDEX_NAME, H5_ITER_INC, note, &names, H5O_INFO_BASIC);
  const bool all = names.size() <= 20;
  if (!all) names.pop_back();
  std::string list;
  for (const std::string& name : names)
    list += (list.empty() ? "" : ", ") + name;
  return list.empty() ? "nothing" : all ? list : list + ", ...";
}

/// A link to another file was met, in a process that is confined: it is not followed, for the answer would
/// tell what is there.
herr_t note_link(const char*, const char*, const char*, const char*, unsigned*, hid_t, void* met) {
  *static_cast<bool*>(met) = true;
  return -1;
}

}  // namespace

std::string content_of_hdf5(const std::string& path) {
  const QuietHdf5 quiet;
  const Hdf5Guard guard(path);
  return content_of(open_hdf5(path).get());
}

std::string place_in(const std::string& path, const std::string& dataset) {
  return path + ": " + printable(dataset);
}

Hdf5File open_hdf5(const std::string& path, Chunks kept) {
  std::error_code error;
  if (!std::filesystem::exists(path, error)) throw InputError(path + ": there is no such file");
  if (std::filesystem::is_directory(path, error))
    throw InputError(path + " is a folder; an HDF5 file is needed");
  const htri_t is_hdf5 = H5Fis_hdf5(path.c_str());
  if (is_hdf5 == 0) throw InputError(path + " is not an HDF5 file");
  // What is not used takes no memory; chunks that were read to their end go first; the number of slots is a
  // prime, as HDF5 asks.
  constexpr std::size_t slots = 100003, bytes = std::size_t{2} << 30U;
  const Hdf5Properties access(H5Pcreate(H5P_FILE_ACCESS));
  if (kept == Chunks::whole_rows) H5Pset_cache(access.get(), 0, slots, bytes, 1.0);
  if (files_are_confined()) H5PLset_loading_state(0);  // no filter from a folder of plugins
  Hdf5File file(H5Fopen(path.c_str(), H5F_ACC_RDONLY, access.get()));
  if (!file) throw InputError(path + ": the HDF5 file cannot be opened: " + hdf5_reason());
  return file;
}

Hdf5Object open_hdf5_object(hid_t file, const std::string& path, const std::string& name) {
  bool leads_elsewhere = false;
  const Hdf5Properties links(H5Pcreate(H5P_LINK_ACCESS));
  if (files_are_confined()) H5Pset_elink_cb(links.get(), note_link, &leads_elsewhere);
  Hdf5Object object(H5Oopen(file, name.c_str(), links.get()));
  if (leads_elsewhere)
    throw InputError(place_in(path, name) + " is a link to another file; store the data themselves");
  if (!object)
    throw InputError(place_in(path, name) + " is not in the file, which holds " + content_of(file) +
                     "; name one of these as dataset");
  if (files_are_confined() && H5Iget_type(object.get()) == H5I_DATASET) {
    const Hdf5Properties creation(H5Dget_create_plist(object.get()));
    if (H5Pget_layout(creation.get()) == H5D_VIRTUAL || H5Pget_external_count(creation.get()) != 0)
      throw InputError(place_in(path, name) + " keeps its data in other files; store the data themselves");
  }
  return object;
}

Hdf5Attribute single_attribute(hid_t object, const char* name) {
  if (H5Aexists(object, name) <= 0) return {};
  Hdf5Attribute attribute(H5Aopen(object, name, H5P_DEFAULT));
  const Hdf5Space space(attribute ? H5Aget_space(attribute.get()) : H5I_INVALID_HID);
  if (!space || H5Sget_simple_extent_npoints(space.get()) != 1) return {};
  return attribute;
}

std::string text_attribute(hid_t object, const char* name) {
  const Hdf5Attribute attribute = single_attribute(object, name);
  if (!attribute) return {};
  const Hdf5Type type(H5Aget_type(attribute.get()));
  std::string text;
  if (H5Tis_variable_str(type.get()) > 0) {
    char* found = nullptr;
    if (H5Aread(attribute.get(), type.get(), &found) >= 0 && found) text = found;
    H5free_memory(found);
  } else if (H5Tget_class(type.get()) == H5T_STRING && H5Aget_storage_size(attribute.get()) < 100) {
    text.resize(H5Aget_storage_size(attribute.get()));
    H5Aread(attribute.get(), type.get(), text.data());
  }
  text.resize(std::min(text.find('\0'), text.size()));
  text.resize(text.find_last_not_of(' ') + 1);
  return text;
}

std::vector<hsize_t> shape_of(hid_t space) {
  std::vector<hsize_t> shape(std::size_t(std::max(H5Sget_simple_extent_ndims(space), 0)));
  H5Sget_simple_extent_dims(space, shape.data(), nullptr);
  return shape;
}

std::string shape_text(const std::vector<hsize_t>& shape) {
  std::string result;
  for (const hsize_t extent : shape)
    result += (result.empty() ? "" : " x ") + std::to_string(extent);
  return result.empty() ? "a single value" : "shape " + result;
}

namespace {

/// An enumeration of whole numbers none of which is but 0 and 1.
bool is_truth(hid_t type) {
  const Hdf5Type base(H5Tget_super(type));
  if (!base || H5Tget_class(base.get()) != H5T_INTEGER || H5Tget_size(base.get()) > sizeof(std::int64_t))
    return false;
  const int members = H5Tget_nmembers(type);
  for (int i = 0; i < members; ++i) {
    std::int64_t value = 0;
    if (H5Tget_member_value(type, unsigned(i), &value) < 0 ||
        H5Tconvert(base.get(), H5T_NATIVE_INT64, 1, &value, nullptr, H5P_DEFAULT) < 0 ||
        (value != 0 && value != 1))
      return false;
  }
  return members >= 1 && members <= 2;
}

}  // namespace

void check_numbers(hid_t dataset, const std::string& where, bool whole) {
  const Hdf5Type type(H5Dget_type(dataset));
  const H5T_class_t kind = H5Tget_class(type.get());
  if (kind == H5T_INTEGER || (!whole && kind == H5T_FLOAT)) return;
  if (!whole && kind == H5T_ENUM && is_truth(type.get())) return;
  if (!whole && kind == H5T_BITFIELD && H5Tget_size(type.get()) == 1) return;
  throw InputError(where + (whole ? " should hold whole numbers" : " should hold real numbers") +
                   ", found another type (" +
                   (kind == H5T_FLOAT      ? "floating point"
                    : kind == H5T_COMPOUND ? "compound, as complex numbers are"
                    : kind == H5T_STRING   ? "text"
                                           : "neither integer nor floating point") +
                   ")");
}

void read_reals(hid_t dataset, hid_t memory, hid_t file, double* to, std::size_t count,
                const std::string& where) {
  const Hdf5Type type(H5Dget_type(dataset));
  const bool bits = H5Tget_class(type.get()) == H5T_BITFIELD;  // HDF5 makes no numbers of them
  std::vector<unsigned char> bytes(bits ? count : 0);
  void* place = bits ? static_cast<void*>(bytes.data()) : to;
  if (H5Dread(dataset, bits ? H5T_NATIVE_B8 : H5T_NATIVE_DOUBLE, memory, file, H5P_DEFAULT, place) < 0)
    throw InputError(where + " cannot be read: " + hdf5_reason());
  if (!bits) return;
  const auto bad = std::find_if(bytes.begin(), bytes.end(), [](unsigned char b) { return b > 1; });
  if (bad != bytes.end())
    throw InputError(where + " should hold truth values, 0 and 1, found bits " + std::to_string(*bad));
  std::copy(bytes.begin(), bytes.end(), to);
}

void check_extent(hid_t dataset, const std::vector<hsize_t>& shape, const std::string& where) {
  const Hdf5Properties creation(H5Dget_create_plist(dataset));
  if (H5Pget_layout(creation.get()) == H5D_VIRTUAL || H5Pget_external_count(creation.get()) != 0) return;
  constexpr double best_compression = 2000.0;  // deflate: 1032
  hsize_t file_bytes = 0;
  H5Fget_filesize(Hdf5Object(H5Iget_file_id(dataset)).get(), &file_bytes);
  double bytes = sizeof(double);
  for (const hsize_t extent : shape)
    bytes *= double(extent);
  if (bytes > best_compression * double(file_bytes))
    throw InputError(where + " has " + shape_text(shape) + ", which a file of " + std::to_string(file_bytes) +
                     " bytes cannot hold; store a matrix of few entries as a sparse one");
}

}  // namespace sweepvi
