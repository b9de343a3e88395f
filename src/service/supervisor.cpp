#include "service/supervisor.hpp"

#include <fcntl.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <system_error>
#include <vector>

#include "io/output_file.hpp"
#include "service/attempt.hpp"
#include "service/child.hpp"
#include "service/digest.hpp"
#include "service/files.hpp"

namespace sweepvi::service {

namespace {

constexpr int look_around = 50;  // ms between looks at the folder

volatile std::sig_atomic_t stop_signal = 0;

extern "C" void note_stop(int signal) {
  stop_signal = signal;
}

void set_limit(int resource, std::int64_t bytes) {
  const rlimit limit{static_cast<rlim_t>(bytes), static_cast<rlim_t>(bytes)};
  setrlimit(static_cast<__rlimit_resource>(resource), &limit);
}

/// Where MPI keeps its own files: short, for sockets have short names, and gone afterwards.
class Scratch {
public:
  explicit Scratch(const Attempt& attempt) : attempt_(attempt) {
    const char* base = std::getenv("TMPDIR");
    std::string path =
        (base != nullptr && std::strlen(base) < 40 ? std::string(base) : "/tmp") + "/sweepvi-XXXXXX";
    if (mkdtemp(path.data()) == nullptr) throw std::system_error(errno, std::generic_category(), path);
    attempt_.note_scratch(path);
    setenv("OMPI_MCA_orte_tmpdir_base", path.c_str(), 1);
  }
  ~Scratch() { attempt_.remove_scratch(); }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;

private:
  const Attempt& attempt_;
};

/// Says now and then that this process is there.
class Pulse {
public:
  explicit Pulse(const Descriptor& claim) : claim_(claim) {}
  void beat() {
    constexpr double interval = 1.0;  // s
    if (ticks() - last_ < interval) return;
    last_ = ticks();
    Attempt::beat(claim_);
  }

private:
  const Descriptor& claim_;
  double last_ = 0.0;
};

class Supervisor {
public:
  Supervisor(const std::filesystem::path& folder, Pulse& pulse)
      : attempt_(folder), order_(attempt_.order()), pulse_(pulse) {}

  Ending run() {
    if (attempt_.asked_to_stop()) {
      ending_.started = false;
      ending_.asked = true;
      return ending_;
    }
    const Scratch scratch(attempt_);
    start();
    int status = 0;
    while (true) {
      pulse_.beat();
      copy_output(look_around);
      const pid_t ended = waitpid(pid_, &status, WNOHANG);
      if (ended == pid_ || (ended < 0 && errno != EINTR)) break;
      stop_if_asked();
    }
    end_processes_with(attempt_mark, attempt_.folder().string());
    while (waitpid(-1, nullptr, WNOHANG) > 0) {
    }
    while (output_ && copy_output(0)) {
    }
    if (WIFEXITED(status)) ending_.code = WEXITSTATUS(status);
    if (WIFSIGNALED(status)) ending_.signal = WTERMSIG(status);
    return ending_;
  }

private:
  void start() {
    std::array<int, 2> ends{};
    if (pipe2(ends.data(), O_CLOEXEC) != 0) throw std::system_error(errno, std::generic_category(), "pipe");
    output_ = Descriptor(ends[0]);
    Descriptor input(ends[1]);
    log_ =
        Descriptor(open((attempt_.job() / "log").c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600));
    logged_ = lseek(log_.get(), 0, SEEK_END);
    ending_.log_from = logged_;
    prctl(PR_SET_CHILD_SUBREAPER, 1);  // ranks whose mpirun is gone come here
    setenv(attempt_mark, attempt_.folder().c_str(), 1);
    began_ = ticks();
    const pid_t parent = getpid();
    pid_ = fork();
    if (pid_ < 0) throw std::system_error(errno, std::generic_category(), "fork");
    if (pid_ == 0) become_program(input.get(), parent);
  }

  [[noreturn]] void become_program(int output, pid_t parent) {
    setpgid(0, 0);
    prctl(PR_SET_PDEATHSIG, SIGTERM);  // a supervisor that is killed leaves no ranks behind
    if (getppid() != parent) _exit(127);
    give_up_privileges();
    if (order_.file_bytes > 0) set_limit(RLIMIT_FSIZE, order_.file_bytes);
    signal(SIGXFSZ, SIG_IGN);
    signal(SIGUSR1, SIG_DFL);
    signal(SIGTERM, SIG_DFL);
    dup2(open("/dev/null", O_RDONLY | O_CLOEXEC), STDIN_FILENO);
    dup2(output, STDOUT_FILENO);
    dup2(output, STDERR_FILENO);
    std::vector<char*> argv;
    for (std::string& word : order_.words)
      argv.push_back(word.data());
    argv.push_back(nullptr);
    if (chdir(attempt_.job().c_str()) == 0) execvp(argv[0], argv.data());
    std::fprintf(stderr, "sweepvi-serve: %s: %s\n", argv[0], std::strerror(errno));
    _exit(127);
  }

  /// One piece of what the program prints, if some comes in time; false if there was none.
  bool copy_output(int milliseconds) {
    pollfd stream{output_.get(), POLLIN, 0};
    if (poll(&stream, 1, milliseconds) <= 0) return false;
    std::array<char, 65536> buffer{};
    const ssize_t count = read(output_.get(), buffer.data(), buffer.size());
    if (count < 0) return errno == EINTR;
    if (count == 0) {
      output_.close();
      return false;
    }
    const std::int64_t room = order_.log_bytes - logged_;
    const auto kept = std::min<std::int64_t>(count, std::max<std::int64_t>(room, 0));
    put(std::string_view(buffer.data(), static_cast<std::size_t>(kept)));
    if (kept < count && !cut_) put("\n[the log ends here: it has reached its limit]\n");
    cut_ = cut_ || kept < count;
    return true;
  }

  void put(std::string_view text) {
    const ssize_t written = write(log_.get(), text.data(), text.size());  // a full disk costs the log
    if (written > 0) logged_ += written;
  }

  // SIGUSR1 writes a checkpoint and ends in order; who does not react is asked less kindly.
  void stop_if_asked() {
    const double time = ticks();
    const bool asked = stop_signal != 0 || attempt_.asked_to_stop();
    const bool late = order_.seconds > 0.0 && time - began_ > order_.seconds;
    if (!asked && !late) return;
    ending_.asked = ending_.asked || asked;
    ending_.late = ending_.late || (late && !asked);
    constexpr std::array signals = {SIGUSR1, SIGTERM, SIGKILL};
    if (sent_ == signals.size() || (sent_ > 0 && time - last_ < order_.grace)) return;
    const int signal = signals.at(sent_++);
    last_ = time;
    // mpirun passes the first two on. Its group has no ranks: they are in groups of their own.
    kill(signal == SIGKILL ? -pid_ : pid_, signal);
    if (signal == SIGKILL)
      end_processes_with(attempt_mark, attempt_.folder().string());
    else  // or those that somebody stopped would not hear of it
      signal_processes_with(attempt_mark, attempt_.folder().string(), SIGCONT);
    ending_.forced = signal != SIGUSR1;
  }

  Attempt attempt_;
  Order order_;
  Pulse& pulse_;
  Ending ending_;
  pid_t pid_ = 0;
  Descriptor output_, log_;
  std::int64_t logged_ = 0;
  bool cut_ = false;
  double began_ = 0.0, last_ = 0.0;
  std::size_t sent_ = 0;
};

}  // namespace

int supervise(const std::filesystem::path& folder) {
  unsetenv(supervisor_mark);  // it is not what this one starts
  struct sigaction action {};
  action.sa_handler = note_stop;
  sigemptyset(&action.sa_mask);
  sigaction(SIGUSR1, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
  try {
    const Attempt attempt(folder);
    const Descriptor claim = attempt.claim();
    if (!claim) return 0;
    // Room for the ending: a run that fills the disk can still say so.
    const std::filesystem::path reserve = folder / "reserve";
    write_output(reserve, std::string(16384, '\0'));
    Pulse pulse(claim);
    Ending ending = Supervisor(folder, pulse).run();
    const std::filesystem::path result = attempt.job() / "result";
    std::error_code none;
    for (const char* kind : {".h5", ".csv"}) {
      const std::filesystem::path file = result.string() + kind;
      const std::uintmax_t bytes = std::filesystem::file_size(file, none);
      if (none) continue;
      ending.bytes = static_cast<std::int64_t>(bytes);
      ending.sha256 = digest_of_file(file, [&] { pulse.beat(); });
    }
    ending.finished = now();
    std::filesystem::remove(reserve);
    attempt.write_ending(ending);
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "sweepvi-serve: %s\n", error.what());
    return 1;
  }
}

}  // namespace sweepvi::service
