#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <utility>

#include "io/posix_file.hpp"

namespace sweepvi {

/// What a name for output stands for, once links are followed.
struct OutputTarget {
  enum class Kind {
    regular,    ///< a regular file, or none yet
    stream,     ///< a device, a FIFO, ...: it is written in place
    descriptor  ///< an open file of this process: /dev/stdout, /dev/fd/3, /proc/self/fd/3
  };
  Kind kind = Kind::regular;
  std::filesystem::path path;  ///< with no link as its last part
  int descriptor = -1;
};

/// @throws std::system_error: links that lead in a circle
OutputTarget output_target(const std::filesystem::path& path);

/// The one writer of all whole files that the program makes, but for HDF5 tables. A regular file has the new
/// bytes or what it had before, whatever happens meanwhile: they go to the disk under another name beside it
/// first, and the file keeps its permissions. Links stay, and what they lead to is written; devices and pipes
/// are written in place, so /dev/null stays what it is; an open file of this process goes on where it is.
/// @param unfinished  the other name; empty: one that nobody else has
/// @throws std::system_error with the path and the reason; nothing is left behind
void write_output(const std::filesystem::path& path, std::string_view bytes,
                  const std::filesystem::path& unfinished = {});

/// Has the name of a file on the disk, where the file system can. @throws std::system_error
void sync_folder_of(const std::filesystem::path& path);

/// Room on the disk for the next bytes of a file, taken in advance as a file `path.reserve` beside it:
/// whoever fills the disk meanwhile, they can be written.
class ReservedRoom {
public:
  explicit ReservedRoom(std::filesystem::path path) : path_(std::move(path)) {}
  ReservedRoom(const ReservedRoom&) = delete;
  ReservedRoom& operator=(const ReservedRoom&) = delete;
  ~ReservedRoom() { release(); }

  /// Takes room for so many bytes, in place of what there was. @throws std::system_error, with none taken
  void take(std::uint64_t bytes);
  /// write_output() in the room that was taken, which is used up then; without any, where the disk has it.
  void write(std::string_view bytes, const std::filesystem::path& unfinished);
  void release() noexcept;

private:
  std::string name() const { return path_.string() + ".reserve"; }

  std::filesystem::path path_;
  PosixFile file_;
};

/// Has all that was printed on its way. @throws std::system_error if some of it is lost: a full device, say
void flush_standard_output();

/// Lines at the end of a file, each whole or not at all; what cannot be written now is left out. Regular
/// files are made if they are missing; a FIFO that nobody reads holds nobody up.
class OutputLines {
public:
  explicit OutputLines(std::filesystem::path path) : path_(std::move(path)) {}
  OutputLines(const OutputLines&) = delete;
  OutputLines& operator=(const OutputLines&) = delete;
  ~OutputLines();

  void append(std::string_view line);

private:
  bool open();

  std::filesystem::path path_;
  int file_ = -1;
  bool torn_ = false;  // the last line is not whole
};

}  // namespace sweepvi
