#include "io/hdf5_attribute.hpp"

#include "io/hdf5_handle.hpp"

namespace sweepvi {
namespace {

bool write(hid_t object, const std::string& name, hid_t type, hid_t space, const void* data) {
  if (type < 0 || space < 0) return false;
  const htri_t exists = H5Aexists(object, name.c_str());
  if (exists < 0 || (exists > 0 && H5Adelete(object, name.c_str()) < 0)) return false;
  const Hdf5Attribute attribute(H5Acreate2(object, name.c_str(), type, space, H5P_DEFAULT, H5P_DEFAULT));
  return attribute && H5Awrite(attribute.get(), type, data) >= 0;
}

Hdf5Type text_type() {
  Hdf5Type type(H5Tcopy(H5T_C_S1));
  if (!type || H5Tset_size(type.get(), H5T_VARIABLE) < 0 || H5Tset_cset(type.get(), H5T_CSET_UTF8) < 0)
    return {};
  return type;
}

}  // namespace

bool write_attribute(hid_t object, const std::string& name, const std::string& value) {
  const char* text = value.c_str();
  return write(object, name, text_type().get(), Hdf5Space(H5Screate(H5S_SCALAR)).get(), &text);
}

bool write_attribute(hid_t object, const std::string& name, const std::vector<std::string>& values) {
  std::vector<const char*> texts;
  texts.reserve(values.size());
  for (const std::string& value : values)
    texts.push_back(value.c_str());
  const hsize_t size = texts.size();
  return write(object, name, text_type().get(), Hdf5Space(H5Screate_simple(1, &size, nullptr)).get(),
               texts.data());
}

bool write_attribute(hid_t object, const std::string& name, double value) {
  return write(object, name, H5T_IEEE_F64LE, Hdf5Space(H5Screate(H5S_SCALAR)).get(), &value);
}

bool write_attribute(hid_t object, const std::string& name, std::int64_t value) {
  return write(object, name, H5T_STD_I64LE, Hdf5Space(H5Screate(H5S_SCALAR)).get(), &value);
}

}  // namespace sweepvi
