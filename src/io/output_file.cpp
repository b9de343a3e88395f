#include "io/output_file.hpp"

#include <fcntl.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <charconv>
#include <cstdint>
#include <cstdio>
#include <optional>
#include <system_error>
#include <utility>

namespace sweepvi {

namespace fs = std::filesystem;

namespace {

[[noreturn]] void fail(int error, const fs::path& path) {
  throw std::system_error(error, std::generic_category(), path.string());
}

/// The number behind /dev/fd/ or its like; -1 if it is no such name.
int descriptor_named(const fs::path& path) {
  std::error_code failure;
  const fs::path folder = fs::weakly_canonical(fs::absolute(path, failure).parent_path(), failure);
  if (failure || folder != fs::path("/proc") / std::to_string(getpid()) / "fd") return -1;
  const std::string name = path.filename();
  int number = -1;
  const auto [end, error] = std::from_chars(name.data(), name.data() + name.size(), number);
  return error == std::errc() && end == name.data() + name.size() ? number : -1;
}

/// @return the reason if it cannot, 0 if it can
int write_all(int file, std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t written = write(file, bytes.data(), bytes.size());
    if (written < 0 && errno != EINTR) return errno;
    if (written > 0) bytes.remove_prefix(static_cast<std::size_t>(written));
  }
  return 0;
}

bool nothing_to_sync(int error) {
  return error == EINVAL || error == EROFS || error == ENOTSUP;
}

/// path.XXXXXXXX, as nobody has it.
std::string fresh_name(const fs::path& path) {
  std::uint32_t number = 0;
  if (getrandom(&number, sizeof number, 0) != sizeof number) fail(errno, path);
  std::array<char, 16> text{};
  std::snprintf(text.data(), text.size(), ".%08x", number);
  return path.string() + text.data();
}

/// Permissions of a file, if it is there.
std::optional<mode_t> mode_of(const fs::path& path) {
  struct stat about {};
  if (stat(path.c_str(), &about) != 0) return std::nullopt;
  return about.st_mode & mode_t{0777};
}

/// A file under another name that shall replace `path`. No link that somebody put there is followed, and no
/// file of another run is written on.
PosixFile fresh_file(const std::string& name, const fs::path& path) {
  PosixFile file(name, O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW, mode_of(path).value_or(0666));
  if (!file) fail(errno, path);
  return file;
}

/// Fills such a file and gives it the name of `path`; if that fails, removes it.
void replace_by(PosixFile file, const std::string& name, const fs::path& path, std::string_view bytes) {
  int code = write_all(file.get(), bytes);
  if (code == 0 && ftruncate(file.get(), static_cast<off_t>(bytes.size())) != 0) code = errno;
  // What the umask took; it may not be given back, to a confined process say, and then fewer may read it.
  if (const std::optional<mode_t> mode = mode_of(path)) static_cast<void>(fchmod(file.get(), *mode));
  if (code == 0 && fsync(file.get()) != 0 && !nothing_to_sync(errno)) code = errno;
  if (const int closing = file.close(); code == 0) code = closing;
  if (code == 0 && std::rename(name.c_str(), path.c_str()) != 0) code = errno;
  if (code != 0) {
    unlink(name.c_str());
    fail(code, path);
  }
  sync_folder_of(path);
}

void replace(const fs::path& path, std::string_view bytes, const fs::path& unfinished) {
  const std::string name = unfinished.empty() ? fresh_name(path) : unfinished.string();
  if (!unfinished.empty()) unlink(name.c_str());
  replace_by(fresh_file(name, path), name, path, bytes);
}

void flush_for(int descriptor) {
  if (descriptor == STDOUT_FILENO) std::fflush(stdout);
  if (descriptor == STDERR_FILENO) std::fflush(stderr);
}

}  // namespace

OutputTarget output_target(const fs::path& path) {
  fs::path at = path;
  constexpr int most_links = 40;
  for (int i = 0; i < most_links; ++i) {
    if (const int number = descriptor_named(at); number >= 0)
      return {OutputTarget::Kind::descriptor, at, number};
    struct stat about {};
    if (lstat(at.c_str(), &about) != 0) return {OutputTarget::Kind::regular, at, -1};
    if (!S_ISLNK(about.st_mode)) {
      const bool regular = S_ISREG(about.st_mode) || S_ISDIR(about.st_mode);  // which fails as a file does
      return {regular ? OutputTarget::Kind::regular : OutputTarget::Kind::stream, at, -1};
    }
    const fs::path next = fs::read_symlink(at);
    at = next.is_absolute() ? next : at.parent_path() / next;
  }
  fail(ELOOP, path);
}

void write_output(const fs::path& path, std::string_view bytes, const fs::path& unfinished) {
  const OutputTarget target = output_target(path);
  if (target.kind == OutputTarget::Kind::regular) return replace(target.path, bytes, unfinished);
  int code = 0;
  if (target.kind == OutputTarget::Kind::descriptor) {
    flush_for(target.descriptor);
    code = write_all(target.descriptor, bytes);
  } else {
    PosixFile file(target.path, O_WRONLY | O_NOCTTY);
    if (!file) fail(errno, path);
    code = write_all(file.get(), bytes);
    if (const int closing = file.close(); code == 0) code = closing;
  }
  if (code != 0) fail(code, path);
}

void sync_folder_of(const fs::path& path) {
  const fs::path folder = path.parent_path();
  const PosixFile file(folder.empty() ? "." : folder.string(), O_RDONLY | O_DIRECTORY);
  // Who may not look into a folder cannot, either.
  if (file && fsync(file.get()) != 0 && !nothing_to_sync(errno)) fail(errno, path);
}

void ReservedRoom::take(std::uint64_t bytes) {
  release();
  // Whatever is no file of ours is written where it leads.
  if (const OutputTarget target = output_target(path_);
      target.kind != OutputTarget::Kind::regular || target.path != path_)
    return;
  unlink(name().c_str());  // of a run that was killed
  file_ = fresh_file(name(), path_);
  const int code = posix_fallocate(file_.get(), 0, static_cast<off_t>(bytes));
  if (code == 0) return;
  release();
  fail(code, path_);
}

void ReservedRoom::write(std::string_view bytes, const fs::path& unfinished) {
  if (file_ && std::rename(name().c_str(), unfinished.c_str()) == 0)
    return replace_by(std::exchange(file_, {}), unfinished.string(), path_, bytes);
  release();
  write_output(path_, bytes, unfinished);
}

void ReservedRoom::release() noexcept {
  if (!file_) return;
  file_ = {};
  unlink(name().c_str());
}

void flush_standard_output() {
  const bool lost = std::ferror(stdout) != 0;
  if (std::fflush(stdout) != 0 || lost) fail(lost && errno == 0 ? EIO : errno, "standard output");
}

OutputLines::~OutputLines() {
  if (file_ > STDERR_FILENO) close(file_);
}

bool OutputLines::open() {
  if (file_ >= 0) return true;
  const OutputTarget target = output_target(path_);
  const bool regular = target.kind == OutputTarget::Kind::regular;
  if (target.kind == OutputTarget::Kind::descriptor)
    file_ = fcntl(target.descriptor, F_DUPFD_CLOEXEC, STDERR_FILENO + 1);
  else
    file_ = ::open(target.path.c_str(),
                   O_WRONLY | O_NOCTTY | O_CLOEXEC | (regular ? O_APPEND | O_CREAT : O_NONBLOCK), 0666);
  return file_ >= 0;
}

void OutputLines::append(std::string_view line) {
  try {
    if (!open()) return;
  } catch (const std::system_error&) {
    return;
  }
  flush_for(STDOUT_FILENO);
  std::string bytes = (torn_ ? "\n" : "") + std::string(line) + "\n";
  ssize_t written = write(file_, bytes.data(), bytes.size());
  if (written < 0 && errno == EPIPE) {  // whoever read it is gone; another one may come
    close(file_);
    file_ = -1;
  }
  if (written > 0) torn_ = static_cast<std::size_t>(written) < bytes.size();
}

}  // namespace sweepvi
