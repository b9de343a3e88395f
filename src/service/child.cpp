#include "service/child.hpp"

#include <fcntl.h>
#include <poll.h>
#include <spawn.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string_view>
#include <system_error>
#include <thread>

#include "service/files.hpp"

namespace sweepvi::service {

namespace {

[[noreturn]] void fail(int error, const std::string& what) {
  throw std::system_error(error, std::generic_category(), what);
}

/// What programs need to be found, loaded and started on several ranks. What else the daemon was given, the
/// keys of somebody's cloud say, is nobody's business.
bool is_passed_on(std::string_view entry) {
  constexpr std::array names = {"PATH",   "HOME", "USER", "LOGNAME",         "SHELL",     "HOSTNAME",
                                "TMPDIR", "LANG", "TZ",   "LD_LIBRARY_PATH", "LD_PRELOAD"};
  constexpr std::array families = {"LC_",    "SWEEPVI_", "OMP_",    "OPENBLAS_", "MKL_",  "OMPI_", "OPAL_",
                                   "ORTE_",  "PMIX_",    "PRTE_",   "HWLOC_",    "UCX_",  "FI_",   "MPICH_",
                                   "HYDRA_", "SLURM_",   "SBATCH_", "ASAN_",     "LSAN_", "UBSAN_"};
  const std::string_view name = entry.substr(0, entry.find('='));
  return std::find(names.begin(), names.end(), name) != names.end() ||
         (name.find("TOKEN") == std::string_view::npos &&
          std::any_of(families.begin(), families.end(),
                      [&](const char* family) { return name.starts_with(family); }));
}

/// @param mark  NAME=value, added to it unless empty; outlives the result
std::vector<char*> passed_environment(std::string& mark) {
  std::vector<char*> entries;
  for (char** entry = environ; *entry != nullptr; ++entry)
    if (is_passed_on(*entry)) entries.push_back(*entry);
  if (!mark.empty()) entries.push_back(mark.data());
  entries.push_back(nullptr);
  return entries;
}

/// What posix_spawn takes, freed with it.
class Plan {
public:
  Plan() {
    posix_spawn_file_actions_init(&actions);
    posix_spawnattr_init(&attributes);
  }
  ~Plan() {
    posix_spawn_file_actions_destroy(&actions);
    posix_spawnattr_destroy(&attributes);
  }
  Plan(const Plan&) = delete;
  Plan& operator=(const Plan&) = delete;

  posix_spawn_file_actions_t actions{};
  posix_spawnattr_t attributes{};

  int start(const std::vector<std::string>& words, short flags, std::string mark = {}) {
    // The program begins with default signals, whatever this one ignores.
    sigset_t all;
    sigset_t none;
    sigfillset(&all);
    sigemptyset(&none);
    posix_spawnattr_setsigdefault(&attributes, &all);
    posix_spawnattr_setsigmask(&attributes, &none);
    posix_spawnattr_setflags(&attributes,
                             static_cast<short>(flags | POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETSIGMASK));
    posix_spawn_file_actions_addclosefrom_np(&actions, STDERR_FILENO + 1);
    std::vector<char*> argv;
    argv.reserve(words.size() + 1);
    for (const std::string& word : words)
      argv.push_back(const_cast<char*>(word.c_str()));  // NOLINT: what exec asks for, and leaves alone
    argv.push_back(nullptr);
    pid_t pid = 0;
    const int error =
        posix_spawnp(&pid, argv[0], &actions, &attributes, argv.data(), passed_environment(mark).data());
    if (error != 0) fail(error, words[0]);
    return pid;
  }
};

struct Pipe {
  Pipe() {
    std::array<int, 2> ends{};
    if (pipe2(ends.data(), O_CLOEXEC) != 0) fail(errno, "pipe");
    out = Descriptor(ends[0]);
    in = Descriptor(ends[1]);
  }
  Descriptor out, in;
};

/// Takes what there is; false at the end.
bool take(Descriptor& from, std::string& text, std::size_t most) {
  std::array<char, 65536> buffer{};
  const ssize_t count = read(from.get(), buffer.data(), buffer.size());
  if (count < 0) return errno == EINTR;
  if (count == 0) return false;
  const std::size_t room = most - std::min(most, text.size());
  text.append(buffer.data(), std::min(room, static_cast<std::size_t>(count)));
  return true;
}

}  // namespace

ChildResult run_child(const std::vector<std::string>& words, const std::filesystem::path& folder,
                      const ChildLimits& limits) {
  std::vector<std::string> all = {own_path().string(), "limited", std::to_string(limits.seconds),
                                  std::to_string(limits.memory)};
  all.insert(all.end(), words.begin(), words.end());
  Pipe out;
  Pipe err;
  Plan plan;
  posix_spawn_file_actions_addopen(&plan.actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_adddup2(&plan.actions, out.in.get(), STDOUT_FILENO);
  posix_spawn_file_actions_adddup2(&plan.actions, err.in.get(), STDERR_FILENO);
  posix_spawn_file_actions_addchdir_np(&plan.actions, folder.c_str());
  posix_spawnattr_setpgroup(&plan.attributes, 0);
  const int pid = plan.start(all, POSIX_SPAWN_SETPGROUP);
  out.in.close();
  err.in.close();

  ChildResult result;
  const double deadline = ticks() + limits.seconds + 1.0;
  while ((out.out || err.out) && ticks() < deadline) {
    std::array<pollfd, 2> streams{{{out.out.get(), POLLIN, 0}, {err.out.get(), POLLIN, 0}}};
    if (poll(streams.data(), streams.size(), 1000) <= 0) continue;
    if (streams[0].revents != 0 && !take(out.out, result.out, limits.output)) out.out.close();
    if (streams[1].revents != 0 && !take(err.out, result.err, limits.output)) err.out.close();
  }
  siginfo_t ended{};
  while (ticks() < deadline &&
         waitid(P_PID, static_cast<id_t>(pid), &ended, WEXITED | WNOWAIT | WNOHANG) == 0 && ended.si_pid == 0)
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  kill(-pid, SIGKILL);  // what it left behind, or itself
  int status = 0;
  while (waitpid(pid, &status, 0) < 0 && errno == EINTR) {
  }
  if (WIFEXITED(status)) result.code = WEXITSTATUS(status);
  if (WIFSIGNALED(status)) result.signal = WTERMSIG(status);
  return result;
}

int start_apart(const std::vector<std::string>& words, const std::filesystem::path& folder,
                std::string mark) {
  Plan plan;
  posix_spawn_file_actions_addopen(&plan.actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_addopen(&plan.actions, STDOUT_FILENO, "/dev/null", O_WRONLY, 0);
  posix_spawn_file_actions_addopen(&plan.actions, STDERR_FILENO, "/dev/null", O_WRONLY, 0);
  posix_spawn_file_actions_addchdir_np(&plan.actions, folder.c_str());
  return plan.start(words, POSIX_SPAWN_SETSID, std::move(mark));
}

void give_up_privileges() {
  prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0);
  const rlimit none{0, 0};
  setrlimit(RLIMIT_CORE, &none);
}

int become_limited(const std::vector<std::string>& words) {
  if (words.size() < 3) return 2;
  const auto seconds = static_cast<unsigned>(std::strtoul(words[0].c_str(), nullptr, 10));
  const auto memory = static_cast<rlim_t>(std::strtoull(words[1].c_str(), nullptr, 10));
  if (memory > 0) {
    const rlimit limit{memory, memory};
    setrlimit(RLIMIT_AS, &limit);
  }
  give_up_privileges();
  if (seconds > 0) alarm(seconds);  // survives exec
  std::vector<char*> argv;
  for (std::size_t i = 2; i < words.size(); ++i)
    argv.push_back(const_cast<char*>(words[i].c_str()));  // NOLINT: what exec asks for, and leaves alone
  argv.push_back(nullptr);
  execvp(argv[0], argv.data());
  std::fprintf(stderr, "sweepvi-serve: %s: %s\n", argv[0], std::strerror(errno));
  return 127;
}

}  // namespace sweepvi::service
