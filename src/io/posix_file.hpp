#pragma once

#include <fcntl.h>
#include <unistd.h>

#include <string>
#include <utility>

namespace sweepvi {

/// Owns a file descriptor. Move-only.
class PosixFile {
public:
  PosixFile() = default;
  /// Opens `path`; empty if that fails (see errno).
  PosixFile(const std::string& path, int flags)
      : descriptor_(::open(path.c_str(), flags | O_CLOEXEC, 0666)) {}
  PosixFile(PosixFile&& other) noexcept : descriptor_(std::exchange(other.descriptor_, -1)) {}
  PosixFile& operator=(PosixFile&& other) noexcept {
    std::swap(descriptor_, other.descriptor_);
    return *this;
  }
  ~PosixFile() {
    if (descriptor_ >= 0) ::close(descriptor_);
  }

  int get() const noexcept { return descriptor_; }
  explicit operator bool() const noexcept { return descriptor_ >= 0; }

private:
  int descriptor_ = -1;
};

}  // namespace sweepvi
