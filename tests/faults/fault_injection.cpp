// Fails the N-th call of a program that changes files below a folder, for tests/faults/injection.py. To be
// loaded before the C library (LD_PRELOAD), whose functions it stands for.
//
//   SWEEPVI_INJECT_CONTROL   the file of Control, which injection.py makes: all processes that have it count
//   together SWEEPVI_INJECT_FOLDER    an absolute path without links: calls on it and on what is below count
//   SWEEPVI_INJECT_PROGRAMS  whose calls count, "sweepvi-serve:supervise,sweepvi": names of programs, a colon
//   and the first
//                            word behind it where only those are meant; none: all programs
//
// What counts: opening to write, writing, synchronising, cutting, reserving, closing what was written;
// making, naming and removing files, links and folders. Pages that are mapped do not.

#include <dlfcn.h>
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <climits>
#include <cstdarg>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>

namespace {

/// As injection.py has it, in the same order. All zero: everything is counted and nothing fails.
struct Control {
  std::atomic<std::uint64_t> calls;   ///< so far
  std::atomic<std::uint64_t> failed;  ///< of them, by us
  std::uint64_t number;               ///< of the call that fails, from 1; 0: none
  std::uint64_t all_later;            ///< 1: and all after it
  std::int64_t error;  ///< errno; 0: half of what is written is not, and later calls find no room
  char what[256];      ///< the first that failed, with its file
};

class Injection {
public:
  static Injection& get() {
    static Injection& injection = *new Injection;  // files are closed after the last destructor, too
    return injection;
  }

  /// Whether a call on a path fails now; errno is set then.
  bool fails(const char* call, int folder, const char* path) {
    return control_ != nullptr && path != nullptr && concerns(absolute(folder, path)) &&
           next(call, absolute(folder, path), false) != Verdict::passes;
  }
  bool fails(const char* call, int file) {
    return control_ != nullptr && concerns(name_of(file)) &&
           next(call, name_of(file), false) != Verdict::passes;
  }
  enum class Verdict { passes, fails, shortened };
  Verdict writing(const char* call, int file) {
    if (control_ == nullptr || !concerns(name_of(file))) return Verdict::passes;
    return next(call, name_of(file), true);
  }

private:
  Injection() {
    const int kept = errno;
    const char* control = std::getenv("SWEEPVI_INJECT_CONTROL");
    const char* folder = std::getenv("SWEEPVI_INJECT_FOLDER");
    if (control == nullptr || folder == nullptr || !is_meant(std::getenv("SWEEPVI_INJECT_PROGRAMS"))) return;
    folder_ = folder;
    const auto file = static_cast<int>(syscall(SYS_openat, AT_FDCWD, control, O_RDWR | O_CLOEXEC));
    if (file < 0) return;
    void* mapped = mmap(nullptr, sizeof(Control), PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    syscall(SYS_close, file);
    if (mapped != MAP_FAILED) control_ = static_cast<Control*>(mapped);
    errno = kept;
  }

  /// By the words that this process was started with.
  static bool is_meant(const char* programs) {
    if (programs == nullptr || *programs == '\0') return true;
    char words[4096] = {};
    const auto file = static_cast<int>(syscall(SYS_openat, AT_FDCWD, "/proc/self/cmdline", O_RDONLY));
    const long count = syscall(SYS_read, file, words, sizeof words - 2);
    syscall(SYS_close, file);
    if (count <= 0) return false;
    const std::string first = words;
    const std::string name = first.substr(first.rfind('/') + 1);
    const std::string verb = words + first.size() + 1;
    const std::string all = std::string(",") + programs + ",";
    return all.find("," + name + ",") != std::string::npos ||
           all.find("," + name + ":" + verb + ",") != std::string::npos;
  }

  static std::string link_at(const std::string& path) {
    char target[PATH_MAX];
    const ssize_t size = readlink(path.c_str(), target, sizeof target);
    return size < 0 ? std::string() : std::string(target, static_cast<std::size_t>(size));
  }
  static std::string name_of(int file) {
    const int kept = errno;
    std::string name = link_at("/proc/self/fd/" + std::to_string(file));
    errno = kept;
    return name;
  }
  static std::string absolute(int folder, const char* path) {
    if (*path == '/') return path;
    const int kept = errno;
    std::string name = folder == AT_FDCWD ? link_at("/proc/self/cwd") : name_of(folder);
    errno = kept;
    return name + "/" + path;
  }
  bool concerns(const std::string& path) const {
    return path.compare(0, folder_.size(), folder_) == 0 &&
           (path.size() == folder_.size() || path[folder_.size()] == '/');
  }

  /// What works on a full disk, too.
  static bool gives_back(const std::string& call) {
    return call.rfind("unlink", 0) == 0 || call == "remove" || call == "rmdir";
  }

  Verdict next(const char* call, const std::string& path, bool writes) {
    const std::uint64_t number = ++control_->calls;
    if (control_->number == 0 || number < control_->number) return Verdict::passes;
    if (number > control_->number && control_->all_later == 0) return Verdict::passes;
    const bool full = control_->error == 0 || control_->error == ENOSPC;
    if (full && gives_back(call)) return Verdict::passes;
    const bool shortened = control_->error == 0 && number == control_->number;
    if (shortened && !writes) return Verdict::passes;
    if (control_->failed++ == 0)
      std::snprintf(control_->what, sizeof control_->what, "%s %s", call,
                    path.c_str() + std::min(path.size(), folder_.size()));
    errno = control_->error == 0 ? ENOSPC : static_cast<int>(control_->error);
    return shortened ? Verdict::shortened : Verdict::fails;
  }

  std::string folder_;
  Control* control_ = nullptr;
};

/// The C library's own.
template <class Function>
Function real(Function, const char* name) {
  return reinterpret_cast<Function>(dlsym(RTLD_NEXT, name));
}

bool writes(int flags) {
  return (flags & (O_WRONLY | O_RDWR | O_CREAT | O_TRUNC)) != 0;
}

bool writes(const char* mode) {
  return std::strpbrk(mode, "wa+") != nullptr;
}

/// The first half of some pieces.
int halve(const iovec* pieces, int count, iovec* half) {
  std::size_t all = 0;
  for (int i = 0; i < count; ++i)
    all += pieces[i].iov_len;
  std::size_t left = all / 2;
  int used = 0;
  for (; used < count && left > 0; ++used) {
    half[used] = {pieces[used].iov_base, std::min(left, pieces[used].iov_len)};
    left -= half[used].iov_len;
  }
  return used;
}

using Verdict = Injection::Verdict;

}  // namespace

#define SWEEPVI_REAL(name) static const auto original = real(&name, #name)

#define SWEEPVI_OPEN(name)                                                         \
  int name(const char* path, int flags, ...) {                                     \
    SWEEPVI_REAL(name);                                                            \
    va_list rest;                                                                  \
    va_start(rest, flags);                                                         \
    const mode_t mode = va_arg(rest, mode_t);                                      \
    va_end(rest);                                                                  \
    if (writes(flags) && Injection::get().fails(#name, AT_FDCWD, path)) return -1; \
    return original(path, flags, mode);                                            \
  }

#define SWEEPVI_OPENAT(name)                                                     \
  int name(int folder, const char* path, int flags, ...) {                       \
    SWEEPVI_REAL(name);                                                          \
    va_list rest;                                                                \
    va_start(rest, flags);                                                       \
    const mode_t mode = va_arg(rest, mode_t);                                    \
    va_end(rest);                                                                \
    if (writes(flags) && Injection::get().fails(#name, folder, path)) return -1; \
    return original(folder, path, flags, mode);                                  \
  }

#define SWEEPVI_FOPEN(name)                                                            \
  FILE* name(const char* path, const char* mode) {                                     \
    SWEEPVI_REAL(name);                                                                \
    if (writes(mode) && Injection::get().fails(#name, AT_FDCWD, path)) return nullptr; \
    return original(path, mode);                                                       \
  }

#define SWEEPVI_WRITE(name, declared, passed)                                               \
  ssize_t name(int file, const void* bytes, size_t count declared) {                        \
    SWEEPVI_REAL(name);                                                                     \
    const Verdict verdict = Injection::get().writing(#name, file);                          \
    if (verdict == Verdict::fails) return -1;                                               \
    return original(file, bytes, verdict == Verdict::shortened ? count / 2 : count passed); \
  }

#define SWEEPVI_WRITEV(name, declared, passed)                                                      \
  ssize_t name(int file, const iovec* pieces, int count declared) {                                 \
    SWEEPVI_REAL(name);                                                                             \
    const Verdict verdict = Injection::get().writing(#name, file);                                  \
    if (verdict == Verdict::fails) return -1;                                                       \
    if (verdict == Verdict::passes || count > IOV_MAX) return original(file, pieces, count passed); \
    iovec half[IOV_MAX];                                                                            \
    const int used = halve(pieces, count, half);                                                    \
    return original(file, half, used passed);                                                       \
  }

#define SWEEPVI_OF_FILE(name, declared, passed)         \
  int name(int file declared) {                         \
    SWEEPVI_REAL(name);                                 \
    if (Injection::get().fails(#name, file)) return -1; \
    return original(file passed);                       \
  }

#define SWEEPVI_OF_PATH(name, declared, passed)                   \
  int name(const char* path declared) {                           \
    SWEEPVI_REAL(name);                                           \
    if (Injection::get().fails(#name, AT_FDCWD, path)) return -1; \
    return original(path passed);                                 \
  }

#define SWEEPVI_OF_PATH_AT(name, declared, passed)              \
  int name(int folder, const char* path declared) {             \
    SWEEPVI_REAL(name);                                         \
    if (Injection::get().fails(#name, folder, path)) return -1; \
    return original(folder, path passed);                       \
  }

// Those that give the reason as their result.
#define SWEEPVI_RESERVE(name)                              \
  int name(int file, off_t from, off_t bytes) {            \
    SWEEPVI_REAL(name);                                    \
    if (Injection::get().fails(#name, file)) return errno; \
    return original(file, from, bytes);                    \
  }

#define SWEEPVI_COMMA ,

extern "C" {

SWEEPVI_OPEN(open)
SWEEPVI_OPEN(open64)
SWEEPVI_OPENAT(openat)
SWEEPVI_OPENAT(openat64)
SWEEPVI_OF_PATH(creat, SWEEPVI_COMMA mode_t mode, SWEEPVI_COMMA mode)
SWEEPVI_OF_PATH(creat64, SWEEPVI_COMMA mode_t mode, SWEEPVI_COMMA mode)
SWEEPVI_FOPEN(fopen)
SWEEPVI_FOPEN(fopen64)

SWEEPVI_WRITE(write, , )
SWEEPVI_WRITE(pwrite, SWEEPVI_COMMA off_t at, SWEEPVI_COMMA at)
SWEEPVI_WRITE(pwrite64, SWEEPVI_COMMA off64_t at, SWEEPVI_COMMA at)
SWEEPVI_WRITEV(writev, , )
SWEEPVI_WRITEV(pwritev, SWEEPVI_COMMA off_t at, SWEEPVI_COMMA at)
SWEEPVI_WRITEV(pwritev64, SWEEPVI_COMMA off64_t at, SWEEPVI_COMMA at)

SWEEPVI_OF_FILE(fsync, , )
SWEEPVI_OF_FILE(fdatasync, , )
SWEEPVI_OF_FILE(ftruncate, SWEEPVI_COMMA off_t size, SWEEPVI_COMMA size)
SWEEPVI_OF_FILE(ftruncate64, SWEEPVI_COMMA off64_t size, SWEEPVI_COMMA size)
SWEEPVI_OF_FILE(fallocate, SWEEPVI_COMMA int mode SWEEPVI_COMMA off_t from SWEEPVI_COMMA off_t bytes,
                SWEEPVI_COMMA mode SWEEPVI_COMMA from SWEEPVI_COMMA bytes)
SWEEPVI_OF_FILE(fallocate64, SWEEPVI_COMMA int mode SWEEPVI_COMMA off64_t from SWEEPVI_COMMA off64_t bytes,
                SWEEPVI_COMMA mode SWEEPVI_COMMA from SWEEPVI_COMMA bytes)
SWEEPVI_OF_FILE(fchmod, SWEEPVI_COMMA mode_t mode, SWEEPVI_COMMA mode)
SWEEPVI_RESERVE(posix_fallocate)
SWEEPVI_RESERVE(posix_fallocate64)

SWEEPVI_OF_PATH(truncate, SWEEPVI_COMMA off_t size, SWEEPVI_COMMA size)
SWEEPVI_OF_PATH(truncate64, SWEEPVI_COMMA off64_t size, SWEEPVI_COMMA size)
SWEEPVI_OF_PATH(mkdir, SWEEPVI_COMMA mode_t mode, SWEEPVI_COMMA mode)
SWEEPVI_OF_PATH(rmdir, , )
SWEEPVI_OF_PATH(remove, , )
SWEEPVI_OF_PATH(unlink, , )
SWEEPVI_OF_PATH(rename, SWEEPVI_COMMA const char* to, SWEEPVI_COMMA to)
SWEEPVI_OF_PATH_AT(mkdirat, SWEEPVI_COMMA mode_t mode, SWEEPVI_COMMA mode)
SWEEPVI_OF_PATH_AT(unlinkat, SWEEPVI_COMMA int flags, SWEEPVI_COMMA flags)
SWEEPVI_OF_PATH_AT(renameat, SWEEPVI_COMMA int there SWEEPVI_COMMA const char* to,
                   SWEEPVI_COMMA there SWEEPVI_COMMA to)

// What is made is what counts, and stands last.
int link(const char* from, const char* to) {
  SWEEPVI_REAL(link);
  if (Injection::get().fails("link", AT_FDCWD, to)) return -1;
  return original(from, to);
}

int symlink(const char* to, const char* path) {
  SWEEPVI_REAL(symlink);
  if (Injection::get().fails("symlink", AT_FDCWD, path)) return -1;
  return original(to, path);
}

// The file is closed in any case, as systems do that lose what was written.
int close(int file) {
  SWEEPVI_REAL(close);
  const int kept = errno;
  const int flags = fcntl(file, F_GETFL);
  const bool written = flags >= 0 && (flags & O_ACCMODE) != O_RDONLY;
  errno = kept;
  if (!written || !Injection::get().fails("close", file)) return original(file);
  const int reason = errno;
  original(file);
  errno = reason;
  return -1;
}
}
