#include "app/sandbox.hpp"

#include <fmt/format.h>
#include <seccomp.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <memory>
#include <set>

#include "io/posix_file.hpp"
#include "sweepvi/error.hpp"

namespace sweepvi::app {

namespace fs = std::filesystem;

namespace {

[[noreturn]] void fail(const std::string& what, int error) {
  throw Error(ExitCode::internal, fmt::format("--confine: {}: {}", what, std::strerror(error)));
}

// ---- Landlock, as Documentation/userspace-api/landlock.rst of Linux 6.12 has it; older headers know less of
// it
namespace landlock {

constexpr long create_ruleset = 444, add_rule = 445,
               restrict_self = 446;  // system calls, the same everywhere

constexpr std::uint64_t execute = 1U << 0U, write_file = 1U << 1U, read_file = 1U << 2U, read_dir = 1U << 3U,
                        remove_dir = 1U << 4U, remove_file = 1U << 5U, make_regular = 1U << 8U,
                        truncate = 1U << 14U, device_control = 1U << 15U;
constexpr std::uint64_t of_files = execute | write_file | read_file | truncate | device_control;
constexpr std::uint64_t reading = read_file | read_dir;
constexpr std::uint64_t writing = reading | write_file | truncate | remove_file | make_regular;

struct Attributes {
  std::uint64_t files = 0;    // what is forbidden unless a rule allows it
  std::uint64_t network = 0;  // bind 1, connect 2
  std::uint64_t scope = 0;    // not beyond this process: abstract sockets 1, signals 2
};

struct __attribute__((packed)) Beneath {
  std::uint64_t allowed;
  std::int32_t folder;
};

/// The version of the kernel's interface; 0: it has none, or it is switched off.
int version() {
  const long found = syscall(create_ruleset, nullptr, 0, 1);
  return found > 0 ? static_cast<int>(found) : 0;
}

/// All that this kernel can forbid.
Attributes all(int version) {
  std::uint64_t files = (1U << 13U) - 1U;  // version 1: execute to make_symlink
  if (version >= 2) files |= 1U << 13U;    // to move between folders
  if (version >= 3) files |= truncate;
  if (version >= 5) files |= device_control;
  return {files, version >= 4 ? std::uint64_t{3} : 0, version >= 6 ? std::uint64_t{3} : 0};
}

class Rules {
public:
  explicit Rules(const Attributes& forbidden) : forbidden_(forbidden.files) {
    const int version = landlock::version();
    const std::size_t size = version >= 6 ? 24 : version >= 4 ? 16 : 8;
    descriptor_ = static_cast<int>(syscall(create_ruleset, &forbidden, size, 0));
    if (descriptor_ < 0) fail("Landlock", errno);
  }
  ~Rules() { ::close(descriptor_); }
  Rules(const Rules&) = delete;
  Rules& operator=(const Rules&) = delete;

  /// A path that is not there is not allowed either.
  void allow(const fs::path& path, std::uint64_t rights) {
    const PosixFile place(path, O_PATH);
    if (!place) return;
    std::error_code none;
    if (!fs::is_directory(path, none)) rights &= of_files;
    const Beneath rule{rights & forbidden_, place.get()};
    if (rule.allowed != 0 && syscall(add_rule, descriptor_, 1, &rule, 0) != 0)
      fail("Landlock: " + path.string(), errno);
  }

  void enforce() const {
    if (syscall(restrict_self, descriptor_, 0) != 0) fail("Landlock", errno);
  }

private:
  std::uint64_t forbidden_;
  int descriptor_ = -1;
};

}  // namespace landlock

// ---- what a process needs

/// Folders of the libraries that are in use: parts of theirs may still be loaded.
std::set<fs::path> library_folders() {
  std::set<fs::path> folders;
  std::ifstream maps("/proc/self/maps");
  for (std::string line; std::getline(maps, line);) {
    const std::size_t path = line.find('/');
    if (path != std::string::npos && line.find(".so", path) != std::string::npos)
      folders.insert(fs::path(line.substr(path)).parent_path());
  }
  return folders;
}

void allow_paths(landlock::Rules& rules, const SandboxPaths& paths) {
  for (const fs::path& path : paths.read)
    rules.allow(path, landlock::reading);
  for (const fs::path& path : paths.write)
    rules.allow(path, landlock::writing);
  for (const fs::path& folder : library_folders())
    rules.allow(folder, landlock::reading);
}

std::string environment(const char* name, const std::string& otherwise) {
  const char* value = std::getenv(name);
  return value != nullptr && *value != '\0' ? value : otherwise;
}

/// Where MPI keeps what its processes of one machine share.
fs::path session_folder() {
  return environment("OMPI_MCA_orte_tmpdir_base", environment("TMPDIR", "/tmp"));
}

constexpr const char* folder_name = "sweepvi-";
constexpr const char* shared_memory = "OMPI_MCA_btl_vader_backing_directory";

/// Open MPI makes some of what it needs when first it needs it; here that is too late.
/// @return a folder of this process for its shared memory; none if one was chosen already, or there can be
/// none
LockedFolder prepare_mpi() {
  setenv("OMPI_MCA_mpi_preconnect_mpi", "1", 1);
  setenv("OMPI_MCA_btl_vader_single_copy_mechanism", "none", 1);  // no process reads another's memory
  setenv("OMPI_MCA_pml", "ob1", 0);                               // UCX connects later
  setenv("OMPI_MCA_sharedfp", "individual", 1);  // no semaphores for pointers that files share
  if (std::getenv(shared_memory) != nullptr) return {};
  LockedFolder folder = LockedFolder::make();
  if (!folder.path().empty()) setenv(shared_memory, folder.path().c_str(), 1);
  return folder;
}

// ---- seccomp

/// Refuses what no solver does. Names that a kernel or an architecture does not have are passed over.
class Filter {
public:
  Filter() : context_(seccomp_init(SCMP_ACT_ALLOW), seccomp_release) {
    if (!context_) fail("seccomp", ENOMEM);
    seccomp_attr_set(context_.get(), SCMP_FLTATR_CTL_TSYNC, 1);     // MPI has threads, too
    seccomp_attr_set(context_.get(), SCMP_FLTATR_API_SYSRAWRC, 1);  // what the kernel says
    seccomp_attr_set(context_.get(), SCMP_FLTATR_CTL_OPTIMIZE, 2);
  }
  void refuse(const char* name, int error = EPERM) { add(name, error, 0, {}); }
  void refuse_if(const char* name, scmp_arg_cmp argument) { add(name, EPERM, 1, argument); }
  void load() {
    const int code = seccomp_load(context_.get());
    const bool has_none = code == -EINVAL || code == -ENOSYS || code == -EOPNOTSUPP;
    if (code != 0 && !has_none) fail("seccomp", -code);
  }

private:
  void add(const char* name, int error, unsigned count, scmp_arg_cmp argument) {
    const int number = seccomp_syscall_resolve_name(name);
    if (number == __NR_SCMP_ERROR) return;
    const int code = seccomp_rule_add_array(context_.get(), SCMP_ACT_ERRNO(static_cast<std::uint32_t>(error)),
                                            number, count, &argument);
    if (code != 0 && code != -EDOM) fail(std::string("seccomp: ") + name, -code);
  }

  std::unique_ptr<void, void (*)(scmp_filter_ctx)> context_;
};

constexpr std::array refused = {
    // programs and processes; a thread is made by clone, see below
    "execve", "execveat", "fork", "vfork",
    // connections
    "socket", "socketpair", "connect", "bind", "listen", "accept", "accept4", "io_uring_setup",
    "io_uring_enter", "io_uring_register", "mq_open", "msgget", "semget", "shmget",
    // other processes
    "process_vm_readv", "process_vm_writev", "process_madvise", "pidfd_open", "pidfd_getfd",
    "pidfd_send_signal", "kcmp", "rt_sigqueueinfo", "rt_tgsigqueueinfo", "perf_event_open", "userfaultfd",
    "setpriority", "ioprio_set", "migrate_pages", "move_pages",
    // the machine and its names
    "mount", "umount2", "pivot_root", "chroot", "unshare", "setns", "open_tree", "move_mount", "fsopen",
    "fsmount", "fsconfig", "fspick", "mount_setattr", "swapon", "swapoff", "reboot", "kexec_load",
    "kexec_file_load", "init_module", "finit_module", "delete_module", "bpf", "syslog", "acct", "quotactl",
    "quotactl_fd", "settimeofday", "clock_settime", "clock_adjtime", "adjtimex", "sethostname",
    "setdomainname", "iopl", "ioperm", "personality", "keyctl", "add_key", "request_key", "open_by_handle_at",
    "name_to_handle_at", "fanotify_init", "vhangup", "lookup_dcookie", "nfsservctl", "mknod", "mknodat",
    "modify_ldt",
    // other users; what Landlock, or an early version of it, leaves open of files: sizes, modes, owners
    "truncate", "truncate64", "setuid", "setgid", "setreuid", "setregid", "setresuid", "setresgid",
    "setfsuid", "setfsgid", "setgroups", "capset", "chmod", "fchmod", "fchmodat", "fchmodat2", "chown",
    "fchown", "lchown", "fchownat", "setxattr", "lsetxattr", "fsetxattr", "removexattr", "lremovexattr",
    "fremovexattr"};

void refuse_system_calls() {
  Filter filter;
  for (const char* name : refused)
    filter.refuse(name);
#if !defined(__SANITIZE_ADDRESS__)  // which looks for leaks from a process that traces this one
  filter.refuse("ptrace");
  constexpr std::uint64_t thread = 0x00010000;  // CLONE_THREAD
  filter.refuse_if("clone", SCMP_A0(SCMP_CMP_MASKED_EQ, thread, 0));
#endif
  filter.refuse("clone3", ENOSYS);  // its flags are out of sight; the C library goes on to clone
  const auto self = static_cast<scmp_datum_t>(getpid());
  for (const char* name : {"kill", "tgkill"})
    filter.refuse_if(name, SCMP_A0(SCMP_CMP_NE, self));
  filter.refuse("tkill");
  for (const char* name :
       {"prlimit64", "sched_setaffinity", "sched_setscheduler", "sched_setparam", "sched_setattr"})
    filter.refuse_if(name, SCMP_A0(SCMP_CMP_NE, 0));
  filter.refuse_if("ioctl", SCMP_A1(SCMP_CMP_MASKED_EQ, 0xffffffffU, TIOCSTI));
  filter.load();
}

// ---- before MPI

void give_up_privileges() {
  if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0) fail("no new privileges", errno);
  const rlimit none{0, 0};
  setrlimit(RLIMIT_CORE, &none);
  struct {
    std::uint32_t version = 0x20080522;  // 3: 64 bits
    int process = 0;
  } header;
  const std::array<std::uint32_t, 6> nothing{};
  if (syscall(SYS_capset, &header, nothing.data()) == 0) return;
  const int error = errno;  // a service manager's filter may refuse the call, having taken them itself
  std::array<std::uint32_t, 6> left{};
  if (syscall(SYS_capget, &header, left.data()) != 0 || left != nothing) fail("capabilities", error);
}

}  // namespace

SandboxPaths paths_of(const CommandLine& line, const std::vector<std::string>& listed) {
  SandboxPaths paths;
  const auto read = [&](const std::optional<std::string>& path) {
    if (path && !path->empty()) paths.read.emplace_back(*path);
  };
  const auto write = [&](const std::optional<std::string>& path) {
    if (!path) return;
    std::error_code none;
    const fs::file_status status = fs::status(*path, none);
    const bool special = fs::exists(status) && !fs::is_regular_file(status);
    const fs::path target = special ? fs::path(*path) : fs::weakly_canonical(*path, none).parent_path();
    paths.write.push_back(target.empty() ? fs::path(".") : target);
  };
  read(line.scene);
  read(line.other);
  read(line.confine);
  read(line.settings);
  read(line.reference);
  for (const std::string& path : listed)
    read(path);
  for (const auto& path : {line.output, line.summary, line.csv, line.progress, line.restart})
    write(path);
  if (line.verb == Verb::run && !line.output) paths.write.emplace_back(".");
  return paths;
}

LockedFolder LockedFolder::make() {
  const fs::path base = "/dev/shm";
  std::error_code none;
  for (const fs::directory_entry& entry : fs::directory_iterator(base, none)) {
    if (!entry.path().filename().string().starts_with(folder_name)) continue;
    const PosixFile old(entry.path(), O_RDONLY | O_DIRECTORY | O_NOFOLLOW);
    if (old && flock(old.get(), LOCK_EX | LOCK_NB) == 0) fs::remove_all(entry.path(), none);
  }
  LockedFolder made;
  constexpr int most_attempts = 100;
  for (int attempt = 0; attempt < most_attempts; ++attempt) {
    std::string path = (base / folder_name).string() + "XXXXXX";
    if (mkdtemp(path.data()) == nullptr) return made;
    made.lock_ = PosixFile(path, O_RDONLY | O_DIRECTORY);
    if (made.lock_ && flock(made.lock_.get(), LOCK_EX | LOCK_NB) == 0 && fs::exists(path, none)) {
      made.path_ = path;
      return made;
    }
    rmdir(path.c_str());  // somebody who looked for old ones just then had it first
  }
  return made;
}

LockedFolder::~LockedFolder() {
  if (!path_.empty()) rmdir(path_.c_str());
}

Sandbox::Sandbox(SandboxPaths paths) : paths_(std::move(paths)), shared_memory_(prepare_mpi()) {
  give_up_privileges();
  const int version = landlock::version();
  if (version == 0) return;
  landlock::Attributes forbidden;
  forbidden.files = landlock::all(version).files & ~(landlock::execute | landlock::device_control);
  landlock::Rules rules(forbidden);
  allow_paths(rules, paths_);
  for (const char* folder : {"/usr", "/opt", "/lib", "/lib64", "/bin", "/etc", "/proc", "/sys"})
    rules.allow(folder, landlock::reading);
  for (const fs::path& folder : library_folders())  // Open MPI's settings, where it is not the system's
    for (const char* beside : {"etc", "share"})
      rules.allow(folder / ".." / beside, landlock::reading);
  constexpr std::uint64_t making =
      landlock::writing | (1U << 7U) | (1U << 9U) | landlock::remove_dir;  // folders, sockets
  for (const fs::path& folder : {session_folder(), fs::path("/dev")})
    rules.allow(folder, making);
  rules.enforce();
}

void Sandbox::close() const {
  if (const int version = landlock::version(); version > 0) {
    landlock::Rules rules(landlock::all(version));
    allow_paths(rules, paths_);
    for (const char* path :
         {"/proc/self", "/proc/meminfo", "/proc/cpuinfo", "/sys/fs/cgroup", "/dev/urandom", "/dev/zero"})
      rules.allow(path, landlock::reading);
    rules.allow("/dev/null", landlock::reading | landlock::write_file);
    for (const char* name : {shared_memory, "OMPI_MCA_orte_tmpdir_base", "PMIX_SERVER_TMPDIR"})
      if (const std::string folder = environment(name, ""); !folder.empty())
        rules.allow(folder, landlock::writing | landlock::remove_dir);
    rules.allow(shared_memory_.path().parent_path(), landlock::remove_dir);
    rules.enforce();
  }
  refuse_system_calls();
}

std::string Sandbox::describe() {
  const int version = landlock::version();
  const bool filters = prctl(PR_GET_SECCOMP, 0, 0, 0, 0) >= 0;
  return fmt::format("{}, {}", version > 0 ? fmt::format("Landlock {}", version) : "no Landlock",
                     filters ? "seccomp" : "no seccomp");
}

}  // namespace sweepvi::app
