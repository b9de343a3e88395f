#include "io/checkpoint.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <string_view>
#include <system_error>

#include "io/checksum.hpp"
#include "io/hdf5_handle.hpp"
#include "sweepvi/error.hpp"

namespace sweepvi {

static_assert(std::endian::native == std::endian::little);

namespace {

namespace fs = std::filesystem;

constexpr std::string_view magic = "sweepvi checkpoint ";
constexpr std::string_view first_line = "sweepvi checkpoint 1\n";
constexpr std::string_view hdf5_magic = "\x89HDF\r\n\x1a\n";
constexpr const char* dataset = "/checkpoint";

/// Entries of four bytes, the last one filled up.
std::uint64_t checksum_of(std::span<const std::byte> bytes) {
  const std::uint64_t whole = bytes.size() / 4;
  std::uint64_t sum = checksum(bytes.data(), whole, 4, 0);
  std::array<std::byte, 4> rest{};
  std::copy(bytes.begin() + static_cast<std::ptrdiff_t>(4 * whole), bytes.end(), rest.begin());
  return sum + checksum(rest.data(), 1, 4, whole) + bytes.size();
}

template <class T>
void append(std::vector<std::byte>& bytes, const T* values, std::size_t count) {
  const auto* first = reinterpret_cast<const std::byte*>(values);
  bytes.insert(bytes.end(), first, first + count * sizeof(T));
}

/// Reads from the front of what is left.
class Reader {
public:
  Reader(std::span<const std::byte> bytes, const std::string& name) : bytes_(bytes), name_(name) {}

  std::span<const std::byte> take(std::uint64_t count) {
    if (count > bytes_.size()) damaged("it ends too early");
    const auto taken = bytes_.first(count);
    bytes_ = bytes_.subspan(count);
    return taken;
  }
  template <class T>
  std::vector<T> take_array(std::uint64_t count) {
    if (count > bytes_.size() / sizeof(T)) damaged("it ends too early");
    std::vector<T> values(count);
    if (count > 0) std::memcpy(values.data(), take(count * sizeof(T)).data(), count * sizeof(T));
    return values;
  }
  bool at_end() const { return bytes_.empty(); }
  [[noreturn]] void damaged(const std::string& why) const {
    throw InputError(fmt::format(
        "{}: the checkpoint is damaged: {}; go on from another one, or start the scene anew", name_, why));
  }

private:
  std::span<const std::byte> bytes_;
  const std::string& name_;
};

void expect_format(std::span<const std::byte> bytes, const std::string& name) {
  const std::string_view start(reinterpret_cast<const char*>(bytes.data()),
                               std::min(bytes.size(), first_line.size()));
  if (start == first_line) return;
  if (start.size() < first_line.size() && first_line.starts_with(start))
    throw InputError(fmt::format("{}: the checkpoint is cut short, after {} bytes", name, bytes.size()));
  if (start.starts_with(magic))
    throw InputError(
        fmt::format("{}: the checkpoint has the format '{}', this program reads '{}'; go on with the "
                    "version of sweepvi that wrote it",
                    name, start.substr(0, start.find('\n')), first_line.substr(0, first_line.size() - 1)));
  throw InputError(fmt::format(
      "{}: neither a checkpoint nor an output file of a stopped run; expected FILE.h5.checkpoint or FILE.h5",
      name));
}

std::vector<std::byte> bytes_of_file(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::error_code failure;
  const std::uintmax_t size = fs::is_regular_file(path, failure) ? fs::file_size(path, failure) : 0;
  if (!file || failure || !fs::is_regular_file(path, failure))
    throw InputError(fmt::format("{}: cannot be read: {}", path, std::strerror(errno != 0 ? errno : ENOENT)));
  std::vector<std::byte> bytes(size);
  file.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(size));
  if (file.gcount() != static_cast<std::streamsize>(size))
    throw InputError(fmt::format("{}: cannot be read to its end", path));
  return bytes;
}

bool starts_with(const std::string& path, std::string_view text) {
  std::ifstream file(path, std::ios::binary);
  std::string start(text.size(), '\0');
  file.read(start.data(), static_cast<std::streamsize>(start.size()));
  return file && start == text;
}

std::vector<std::byte> bytes_in_output(const std::string& path) {
  const QuietHdf5 quiet;
  const Hdf5File file(H5Fopen(path.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT));
  if (!file)
    throw InputError(fmt::format(
        "{}: this HDF5 file cannot be read: {}; if its run was killed, go on from its .checkpoint", path,
        hdf5_reason()));
  if (H5Lexists(file.get(), dataset, H5P_DEFAULT) <= 0)
    throw InputError(
        fmt::format("{}: nothing to go on from: the file holds no checkpoint, as only those of "
                    "stopped or failed runs do",
                    path));
  const Hdf5Dataset data(H5Dopen2(file.get(), dataset, H5P_DEFAULT));
  const Hdf5Space space(H5Dget_space(data.get()));
  const hssize_t size = data ? H5Sget_simple_extent_npoints(space.get()) : -1;
  std::error_code failure;
  const bool plausible = size >= 0 && static_cast<std::uintmax_t>(size) <= fs::file_size(path, failure);
  std::vector<std::byte> bytes(plausible ? static_cast<std::size_t>(size) : 0);
  if (!plausible || H5Dread(data.get(), H5T_NATIVE_UINT8, H5S_ALL, H5S_ALL, H5P_DEFAULT, bytes.data()) < 0)
    throw InputError(fmt::format("{}: its checkpoint cannot be read: {}", path, hdf5_reason()));
  return bytes;
}

}  // namespace

void CheckpointData::put(const TableMark& mark) {
  nlohmann::json fields = nlohmann::json::array();
  for (const TableMark::Field& field : mark.fields) {
    fields.push_back({{"name", field.name},
                      {"entry_bytes", field.entry_bytes},
                      {"extents", field.extents},
                      {"chunk", field.chunk},
                      {"checksum", field.checksum}});
    integers["chunks of " + field.name] = field.addresses;
  }
  facts["rows"] = {{"file", mark.file}, {"rows", mark.rows}, {"events", mark.events}, {"fields", fields}};
}

TableMark CheckpointData::mark() const {
  const nlohmann::json& rows = facts.at("rows");
  TableMark mark;
  mark.file = rows.at("file").get<std::string>();
  mark.rows = rows.at("rows").get<std::uint64_t>();
  mark.events = rows.at("events").get<std::uint64_t>();
  for (const nlohmann::json& entry : rows.at("fields")) {
    TableMark::Field field{entry.at("name").get<std::string>(), entry.at("entry_bytes").get<std::uint64_t>()};
    field.extents = entry.at("extents").get<std::vector<std::uint64_t>>();
    field.chunk = entry.at("chunk").get<std::vector<std::uint64_t>>();
    field.checksum = entry.at("checksum").get<std::uint64_t>();
    field.addresses = integers.at("chunks of " + field.name);
    mark.fields.push_back(std::move(field));
  }
  return mark;
}

std::vector<std::byte> encode(const CheckpointData& data) {
  nlohmann::json header = {
      {"facts", data.facts}, {"numbers", nlohmann::json::array()}, {"integers", nlohmann::json::array()}};
  for (const auto& [name, values] : data.numbers)
    header["numbers"].push_back({name, values.size()});
  for (const auto& [name, values] : data.integers)
    header["integers"].push_back({name, values.size()});
  // Names of files need not be UTF-8; one that is not is found again beside the checkpoint (RowSource).
  const std::string text = header.dump(1, ' ', false, nlohmann::json::error_handler_t::replace) + "\n";
  const std::uint64_t length = text.size();

  std::vector<std::byte> bytes;
  append(bytes, first_line.data(), first_line.size());
  append(bytes, &length, 1);
  append(bytes, text.data(), text.size());
  for (const auto& [name, values] : data.numbers)
    append(bytes, values.data(), values.size());
  for (const auto& [name, values] : data.integers)
    append(bytes, values.data(), values.size());
  const std::uint64_t sum = checksum_of(bytes);
  append(bytes, &sum, 1);
  return bytes;
}

CheckpointData decode(std::span<const std::byte> bytes, const std::string& name) {
  expect_format(bytes, name);
  Reader reader(bytes, name);
  if (bytes.size() < first_line.size() + 2 * sizeof(std::uint64_t)) reader.damaged("it ends too early");
  std::uint64_t sum = 0;
  std::memcpy(&sum, bytes.data() + bytes.size() - sizeof sum, sizeof sum);
  if (sum != checksum_of(bytes.first(bytes.size() - sizeof sum)))
    reader.damaged("its checksum does not fit, bytes are missing or changed");

  CheckpointData data;
  try {
    reader.take(first_line.size());
    const std::uint64_t length = reader.take_array<std::uint64_t>(1).front();
    const auto text = reader.take(length);
    const auto* characters = reinterpret_cast<const char*>(text.data());
    const nlohmann::json header = nlohmann::json::parse(characters, characters + text.size());
    data.facts = header.at("facts");
    for (const nlohmann::json& entry : header.at("numbers"))
      data.numbers[entry.at(0).get<std::string>()] =
          reader.take_array<double>(entry.at(1).get<std::uint64_t>());
    for (const nlohmann::json& entry : header.at("integers"))
      data.integers[entry.at(0).get<std::string>()] =
          reader.take_array<std::uint64_t>(entry.at(1).get<std::uint64_t>());
  } catch (const nlohmann::json::exception& error) {
    reader.damaged(error.what());
  }
  return data;
}

namespace {

// Later ones list more chunks of rows.
std::uint64_t with_growth(std::uint64_t bytes) {
  return bytes + bytes / 4 + (std::uint64_t{1} << 18);
}

}  // namespace

void CheckpointFile::reserve(std::uint64_t bytes) {
  try {
    room_.take(with_growth(bytes));
  } catch (const std::system_error& error) {
    throw Error(ExitCode::output, fmt::format("no room for {}, which takes {} bytes: {}; make room, or write "
                                              "elsewhere (-o)",
                                              path_, with_growth(bytes), error.code().message()));
  }
}

void CheckpointFile::write(std::span<const std::byte> bytes) {
  try {
    room_.write({reinterpret_cast<const char*>(bytes.data()), bytes.size()}, unfinished());
  } catch (const std::system_error& error) {
    throw Error(ExitCode::output,
                fmt::format("{} cannot be written: {}; check the space and permissions there", path_,
                            error.code().message()));
  }
  // On a full disk there is what the older one had, at least. Else the next one is written where there is
  // room.
  for (const std::uint64_t size : {with_growth(bytes.size()), std::uint64_t{bytes.size()}}) {
    try {
      return room_.take(size);
    } catch (const std::system_error&) {
      continue;
    }
  }
}

void CheckpointFile::remove() const {
  std::error_code failure;
  fs::remove(unfinished(), failure);
  fs::remove(path_, failure);
  if (failure)
    throw Error(ExitCode::output,
                fmt::format("{} cannot be removed: {}; remove it by hand", path_, failure.message()));
}

CheckpointData read_checkpoint(const std::string& path) {
  std::error_code failure;
  if (!fs::exists(path, failure)) throw InputError(path + ": there is no such file to go on from");
  return decode(starts_with(path, hdf5_magic) ? bytes_in_output(path) : bytes_of_file(path), path);
}

}  // namespace sweepvi
