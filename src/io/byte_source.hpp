#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

namespace sweepvi {

/// Bytes one after another: of a file, of what a gzip file unpacks to, of a member of a zip archive. Nothing
/// is kept, so that what a small file unpacks to takes time, not memory. All throw Error (bad_input) that
/// names the file; none is collective.
class ByteSource {
public:
  virtual ~ByteSource() = default;
  /// Up to `most` bytes; fewer only at the end. What was packed is then checked to its last byte.
  virtual std::size_t read(void* to, std::size_t most) = 0;

  const std::string& name() const { return name_; }  ///< as messages have it
  /// Exactly `count` bytes. @param what  of a complaint: "the file ends within WHAT"
  void exactly(void* to, std::size_t count, const std::string& what);

protected:
  explicit ByteSource(std::string name) : name_(std::move(name)) {}

private:
  std::string name_;
};

/// A regular file, plain or packed by gzip (told by its first bytes; several gzip files in one are one).
class FileSource final : public ByteSource {
public:
  explicit FileSource(const std::string& path);
  ~FileSource() override;
  FileSource(const FileSource&) = delete;
  FileSource& operator=(const FileSource&) = delete;

  std::size_t read(void* to, std::size_t most) override;
  bool packed() const { return packed_; }
  /// Of the file itself.
  std::uint64_t bytes_on_disk() const { return disk_; }
  /// Bytes that read() gives in all. Of a packed file found by unpacking it once; then at its beginning.
  std::uint64_t length();
  void rewind();
  /// Goes on `count` bytes; beyond the end is at the end.
  void skip(std::uint64_t count);

private:
  void* file_ = nullptr;  // gzFile
  bool packed_ = false;
  std::uint64_t disk_ = 0;
  std::optional<std::uint64_t> length_;
};

/// Throws where `path` is missing, a folder or no regular file.
/// @param needed  what it should be, as in "m.mtx is a folder; a MatrixMarket file is needed"
void require_file(const std::string& path, const std::string& needed);

}  // namespace sweepvi
