#include "io/matrix_file.hpp"

#include <algorithm>
#include <array>
#include <filesystem>
#include <optional>
#include <string_view>

#include "io/byte_source.hpp"
#include "io/compressed.hpp"
#include "io/hdf5_guard.hpp"
#include "io/hdf5_handle.hpp"
#include "io/hdf5_input.hpp"
#include "io/printable.hpp"
#include "sweepvi/error.hpp"

namespace sweepvi {
namespace {

using namespace std::string_view_literals;

enum class FileKind { matrix_market, numpy, numpy_archive, petsc, hdf5, unknown };

/// The first bytes of what is in the file, unpacked.
std::string head_of(FileSource& source) {
  std::array<char, 64> bytes{};
  const std::size_t count = source.read(bytes.data(), bytes.size());
  source.rewind();
  return {bytes.data(), count};
}

/// A class number of PETSc's, big-endian, in 32 or in 64 bits.
bool is_petsc(std::string_view head) {
  if (head.starts_with("\0\0\0\0"sv)) head.remove_prefix(4);
  for (const std::string_view known : {"\x00\x12\x7b\x50"sv, "\x00\x12\x7b\x4e"sv, "\x00\x12\x7b\x52"sv})
    if (head.starts_with(known)) return true;
  return false;
}

FileKind kind_of(std::string_view head) {
  std::string_view text = head;
  if (text.starts_with("\xef\xbb\xbf")) text.remove_prefix(3);
  text.remove_prefix(std::min(text.find_first_not_of(" \t\r\n"), text.size()));
  if (text.starts_with("%")) return FileKind::matrix_market;
  if (head.starts_with("\x93NUMPY")) return FileKind::numpy;
  if (head.starts_with("PK\x03\x04") || head.starts_with("PK\x05\x06")) return FileKind::numpy_archive;
  if (is_petsc(head)) return FileKind::petsc;
  if (head.starts_with("\x89HDF\r\n\x1a\n")) return FileKind::hdf5;
  return FileKind::unknown;
}

/// What else a file may be, and what to do about it.
std::string advice_for(std::string_view head) {
  constexpr std::array<std::array<std::string_view, 2>, 6> others = {{
      {"MATLAB 5.0", "a MAT-file of MATLAB's versions 5 to 7; save it with -v7.3"},
      {"BZh", "packed by bzip2; unpack it"},
      {"\xfd"
       "7zXZ",
       "packed by xz; unpack it"},
      {"\x28\xb5\x2f\xfd", "packed by zstd; unpack it"},
      {"\xff\xfe", "a text encoded in UTF-16; save it as UTF-8 or ASCII"},
      {"\xfe\xff", "a text encoded in UTF-16; save it as UTF-8 or ASCII"},
  }};
  for (const auto& [begin, words] : others)
    if (head.starts_with(begin)) return std::string(words);
  return {};
}

struct Opened {
  FileSource source;
  FileKind kind = FileKind::unknown;

  explicit Opened(const std::string& path) : source(path) {
    const std::string head = head_of(source);
    kind = kind_of(head);
    // The mark of HDF5 may stand behind a user block, as in MATLAB's files.
    const QuietHdf5 quiet;
    if (kind == FileKind::unknown && !source.packed() && H5Fis_hdf5(path.c_str()) > 0) kind = FileKind::hdf5;
    if (source.packed() && (kind == FileKind::hdf5 || kind == FileKind::numpy_archive))
      throw InputError(path + " is packed by gzip; unpack it, because " +
                       (kind == FileKind::hdf5 ? "HDF5 files" : "zip archives") +
                       " are not read from the beginning to the end");
    if (const std::string advice = advice_for(head); kind == FileKind::unknown && !advice.empty())
      throw InputError(path + " is " + advice);
  }
};

void refuse_no_dataset(const std::string& path, const std::string& dataset) {
  if (dataset.empty())
    throw InputError(
        path + " is an HDF5 file; say which of its datasets, {file = ..., dataset = \"/name\"}: it holds " +
        content_of_hdf5(path));
}

void refuse_dataset(const std::string& path, const std::string& dataset) {
  if (!dataset.empty())
    throw InputError(path + " is not an HDF5 file, nor an archive of NumPy's (.npz), and '" +
                     printable(dataset) + "' is asked for; leave dataset out");
}

}  // namespace

std::string why_no_matrix_file(const std::string& path) {
  std::error_code failure;
  if (!std::filesystem::exists(path, failure)) return "there is no file " + path;
  if (Opened(path).kind == FileKind::unknown) return path + " begins like none of these";
  return {};
}

namespace {

Opened open_matrix_file(const std::string& path, const std::string& dataset) {
  require_file(path, dataset.empty() ? "a file with a matrix or a vector" : "an HDF5 file");
  return Opened(path);
}

}  // namespace

std::optional<std::string> datasets_to_choose_from(const std::string& path) {
  std::error_code failure;
  if (!std::filesystem::exists(path, failure))
    return path.ends_with(".h5") ? std::optional("") : std::nullopt;
  if (Opened(path).kind != FileKind::hdf5) return std::nullopt;
  return "; " + path + " holds " + content_of_hdf5(path);
}

SparseEntries read_matrix_file(const std::string& path, const std::string& dataset) {
  Opened file = open_matrix_file(path, dataset);
  if (file.kind == FileKind::hdf5) {
    refuse_no_dataset(path, dataset);
    return read_hdf5_matrix(path, dataset);
  }
  if (file.kind == FileKind::numpy_archive) return read_numpy_archive_matrix(path, dataset);
  refuse_dataset(path, dataset);
  switch (file.kind) {
    case FileKind::numpy:
      return read_numpy_matrix(file.source);
    case FileKind::petsc:
      return read_petsc_matrix(file.source);
    default:
      return read_matrix_market(file.source);
  }
}

std::vector<double> read_vector_file(const std::string& path, const std::string& dataset, bool infinity) {
  Opened file = open_matrix_file(path, dataset);
  if (file.kind == FileKind::hdf5) {
    refuse_no_dataset(path, dataset);
    return read_hdf5_vector(path, dataset, infinity);
  }
  if (file.kind == FileKind::numpy_archive) return read_numpy_archive_vector(path, dataset, infinity);
  refuse_dataset(path, dataset);
  switch (file.kind) {
    case FileKind::numpy:
      return read_numpy_vector(file.source, infinity);
    case FileKind::petsc:
      return read_petsc_vector(file.source, infinity);
    default:
      return as_vector(read_matrix_market(file.source), path);
  }
}

}  // namespace sweepvi
