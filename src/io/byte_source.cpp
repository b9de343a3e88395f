#include "io/byte_source.hpp"

#include <zlib.h>

#include <algorithm>
#include <filesystem>
#include <limits>
#include <vector>

#include "sweepvi/error.hpp"

namespace sweepvi {

void ByteSource::exactly(void* to, std::size_t count, const std::string& what) {
  if (read(to, count) != count) throw InputError(name() + ": the file ends within " + what);
}

void require_file(const std::string& path, const std::string& needed) {
  std::error_code error;
  const std::filesystem::file_status status = std::filesystem::status(path, error);
  if (!std::filesystem::exists(status)) throw InputError(path + ": there is no such file");
  if (std::filesystem::is_directory(status))
    throw InputError(path + " is a folder; " + needed + " is needed");
  if (!std::filesystem::is_regular_file(status))
    throw InputError(path + " is not a file with a length; " + needed + " is needed");
}

FileSource::FileSource(const std::string& path) : ByteSource(path) {
  require_file(path, "a file with a matrix or a vector");
  std::error_code error;
  disk_ = std::filesystem::file_size(path, error);
  file_ = gzopen(path.c_str(), "rbe");
  if (error || file_ == nullptr)
    throw InputError(path + ": the file cannot be opened; check its permissions");
  gzbuffer(static_cast<gzFile>(file_), 1U << 18U);
  packed_ = gzdirect(static_cast<gzFile>(file_)) == 0;
}

FileSource::~FileSource() {
  if (file_ != nullptr) gzclose_r(static_cast<gzFile>(file_));
}

std::size_t FileSource::read(void* to, std::size_t most) {
  constexpr std::size_t at_once = std::numeric_limits<int>::max();
  std::size_t read = 0;
  while (read < most) {
    const auto next = static_cast<unsigned>(std::min(at_once, most - read));
    const int count = gzread(static_cast<gzFile>(file_), static_cast<char*>(to) + read, next);
    int code = Z_OK;
    if (count < static_cast<int>(next)) gzerror(static_cast<gzFile>(file_), &code);
    if (count < 0 || (code != Z_OK && code != Z_STREAM_END))
      throw InputError(name() + (packed_ ? ": the file cannot be unpacked (gzip): it is cut off or damaged"
                                         : ": the file cannot be read"));
    read += static_cast<std::size_t>(count);
    if (count < static_cast<int>(next)) break;
  }
  return read;
}

std::uint64_t FileSource::length() {
  if (!packed_) return disk_;
  if (!length_) {
    rewind();
    std::vector<char> block(1U << 18U);
    std::uint64_t total = 0;
    while (const std::size_t count = read(block.data(), block.size()))
      total += count;
    length_ = total;
    rewind();
  }
  return *length_;
}

void FileSource::rewind() {
  if (gzrewind(static_cast<gzFile>(file_)) != 0) throw InputError(name() + ": the file cannot be read again");
}

void FileSource::skip(std::uint64_t count) {
  constexpr std::uint64_t at_once = std::numeric_limits<std::int32_t>::max();
  for (; count > 0; count -= std::min(count, at_once))
    if (gzseek(static_cast<gzFile>(file_), static_cast<z_off_t>(std::min(count, at_once)), SEEK_CUR) < 0)
      throw InputError(name() + ": the file cannot be read");
}

}  // namespace sweepvi
