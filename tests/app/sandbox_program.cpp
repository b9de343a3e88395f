// What a process does that somebody's document has taken over: it tries every way out of its sandbox, and
// what a run needs. Prints a line "RANK WHERE WHAT ANSWER" for each try; the answer is "done" or the name of
// an errno; and where its shared memory is, which is gone afterwards. usage: sandbox_program FOLDER ELSEWHERE
// PORT SOCKET VICTIM
//   FOLDER     may be written     ELSEWHERE  a folder with a file `secret`      PORT  of 127.0.0.1, with a
//   listener SOCKET     of the file system, with a listener      VICTIM  the number of a process of the same
//   user
#include <arpa/inet.h>
#include <dlfcn.h>
#include <fcntl.h>
#include <mpi.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/ptrace.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <future>
#include <string>
#include <thread>
#include <vector>

#include "app/sandbox.hpp"
#include "io/output_file.hpp"
#include "sweepvi/petsc.hpp"

namespace {

using Try = std::function<bool()>;  // false: see errno

struct Prober {
  std::string where;
  int rank = 0;

  void operator()(const char* what, const Try& attempt) const {
    errno = 0;
    const bool done = attempt();
    std::printf("%d %s %s %s\n", rank, where.c_str(), what, done ? "done" : strerrorname_np(errno));
    std::fflush(stdout);
  }
};

bool opens(const std::string& path, int flags) {
  const int file = open(path.c_str(), flags | O_CLOEXEC, 0600);
  if (file >= 0) close(file);
  return file >= 0;
}

bool connects(int family, const sockaddr* address, socklen_t size) {
  const int end = socket(family, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (end < 0) return false;
  const bool done = connect(end, address, size) == 0;
  const int error = errno;
  close(end);
  errno = error;
  return done;
}

struct Arguments {
  std::string folder, elsewhere, socket;
  int port = 0;
  pid_t victim = 0;
};

void try_files(const Prober& probe, const Arguments& given) {
  const std::string own = given.folder + "/own" + std::to_string(probe.rank);
  probe("write-own", [&] { return opens(own, O_WRONLY | O_CREAT); });
  probe("replace-own", [&] {
    sweepvi::write_output(own + ".out", "text");
    return true;
  });
  probe("read-own", [&] { return opens(own, O_RDONLY); });
  probe("remove-own", [&] { return unlink(own.c_str()) == 0; });
  probe("read-elsewhere", [&] { return opens(given.elsewhere + "/secret", O_RDONLY); });
  probe("read-by-dots", [&] { return opens(given.folder + "/../elsewhere/secret", O_RDONLY); });
  probe("read-by-link", [&] { return opens(given.folder + "/link", O_RDONLY); });
  probe("list-elsewhere", [&] { return opens(given.elsewhere, O_RDONLY | O_DIRECTORY); });
  probe("write-elsewhere", [&] { return opens(given.elsewhere + "/new", O_WRONLY | O_CREAT); });
  probe("truncate-elsewhere", [&] { return truncate((given.elsewhere + "/secret").c_str(), 0) == 0; });
  probe("remove-elsewhere", [&] { return unlink((given.elsewhere + "/secret").c_str()) == 0; });
  probe("move-elsewhere",
        [&] { return rename((own + ".out").c_str(), (given.elsewhere + "/out").c_str()) == 0; });
  probe("link-elsewhere",
        [&] { return link((given.elsewhere + "/secret").c_str(), (own + ".link").c_str()) == 0; });
  probe("make-link", [&] { return symlink("/etc/passwd", (own + ".symlink").c_str()) == 0; });
  probe("make-fifo", [&] { return mkfifo((own + ".fifo").c_str(), 0600) == 0; });
  probe("make-folder-elsewhere", [&] { return mkdir((given.elsewhere + "/folder").c_str(), 0700) == 0; });
  probe("environment-of-others",
        [&] { return opens("/proc/" + std::to_string(given.victim) + "/environ", O_RDONLY); });
  probe("memory-of-others", [&] { return opens("/proc/" + std::to_string(given.victim) + "/mem", O_RDWR); });
}

void try_system_files(const Prober& probe) {
  probe("read-passwd", [&] { return opens("/etc/passwd", O_RDONLY); });
  probe("list-root", [&] { return opens("/", O_RDONLY | O_DIRECTORY); });
  probe("write-temporary", [&] { return opens("/var/tmp/sweepvi-sandbox-test", O_WRONLY | O_CREAT); });
  probe("mode-of-own", [&] { return chmod(".", 0777) == 0; });
}

/// What a run goes on to need.
void try_own_needs(const Prober& probe) {
  probe("read-library", [&] {
    Dl_info library{};
    return dladdr(reinterpret_cast<void*>(&MPI_Init), &library) != 0 && opens(library.dli_fname, O_RDONLY);
  });
  probe("read-status", [&] { return opens("/proc/self/status", O_RDONLY); });
  probe("read-memory", [&] { return opens("/proc/meminfo", O_RDONLY); });
  probe("start-thread", [&] {
    std::thread([] {}).join();
    return true;
  });
  probe("allocate", [&] {
    void* place = mmap(nullptr, 1U << 26U, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    return place != MAP_FAILED && munmap(place, 1U << 26U) == 0;
  });
}

void try_processes(const Prober& probe, const Arguments& given) {
  probe("start-process", [&] {
    const pid_t child = fork();
    if (child == 0) _exit(0);
    if (child > 0) waitpid(child, nullptr, 0);
    return child >= 0;
  });
  probe("start-program", [&] {
    std::array<char*, 2> words = {const_cast<char*>("true"), nullptr};
    return execv("/bin/true", words.data()) == 0;
  });
  probe("start-library-program", [&] {
    std::array<char*, 1> words = {nullptr};
    return syscall(SYS_execveat, AT_FDCWD, "/lib64/ld-linux-x86-64.so.2", words.data(), words.data(), 0) == 0;
  });
  probe("run-memory", [&] {
    const int file = memfd_create("code", 0);
    if (file < 0 || write(file, "#!/bin/true\n", 12) != 12) return false;
    std::array<char*, 2> words = {const_cast<char*>("code"), nullptr};
    return fexecve(file, words.data(), words.data()) == 0;
  });
  probe("signal-others", [&] { return kill(given.victim, 0) == 0; });
  probe("signal-all", [&] { return kill(-1, 0) == 0; });
  probe("signal-self", [&] { return kill(getpid(), 0) == 0 && raise(SIGURG) == 0; });
  probe("trace-others", [&] { return ptrace(PTRACE_SEIZE, given.victim, nullptr, nullptr) == 0; });
  probe("read-others", [&] {
    char byte = 0;
    const iovec here{&byte, 1};
    const iovec there{&byte, 1};
    return process_vm_readv(given.victim, &here, 1, &there, 1, 0) >= 0;
  });
  probe("limit-others", [&] {
    const rlimit limit{0, 0};
    return prlimit(given.victim, RLIMIT_CPU, &limit, nullptr) == 0;
  });
  probe("raise-own-limit", [&] {
    const rlimit limit{1U << 20U, 1U << 20U};
    return setrlimit(RLIMIT_CORE, &limit) == 0;
  });
  probe("other-user", [&] { return setuid(65534) == 0; });
  probe("own-names", [&] { return unshare(CLONE_NEWUSER) == 0; });
}

void try_connections(const Prober& probe, const Arguments& given) {
  probe("connect-network", [&] {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<std::uint16_t>(given.port));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    return connects(AF_INET, reinterpret_cast<sockaddr*>(&address), sizeof address);
  });
  const auto to_socket = [&](const std::string& name) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::memcpy(address.sun_path, name.data(), name.size());
    const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + name.size());
    return connects(AF_UNIX, reinterpret_cast<sockaddr*>(&address), size);
  };
  probe("connect-socket", [&] { return to_socket(given.socket); });
  probe("connect-abstract", [&] { return to_socket(std::string("\0sweepvi", 8)); });
  probe("listen", [&] {
    const int end = socket(AF_INET, SOCK_STREAM, 0);
    return end >= 0 && listen(end, 1) == 0;
  });
}

/// Messages of all sizes between all ranks, windows and a file that all write.
void try_messages(const Prober& probe, const Arguments& given) {
  probe("messages", [&] {
    int ranks = 1;
    MPI_Comm_size(MPI_COMM_WORLD, &ranks);
    for (const int length : {1, 1000, 4 << 20}) {
      std::vector<double> mine(static_cast<std::size_t>(length), probe.rank);
      std::vector<double> sum(mine.size());
      MPI_Allreduce(mine.data(), sum.data(), length, MPI_DOUBLE, MPI_SUM, MPI_COMM_WORLD);
      if (sum.back() != 0.5 * ranks * (ranks - 1)) return false;
    }
    MPI_Comm other = MPI_COMM_NULL;
    MPI_Comm_dup(MPI_COMM_WORLD, &other);
    MPI_Comm_free(&other);
    return true;
  });
  probe("file-of-all", [&] {
    MPI_File file = MPI_FILE_NULL;
    const std::string path = given.folder + "/shared";
    if (MPI_File_open(MPI_COMM_WORLD, path.c_str(), MPI_MODE_CREATE | MPI_MODE_WRONLY, MPI_INFO_NULL,
                      &file) != MPI_SUCCESS)
      return false;
    const double value = probe.rank;
    MPI_File_write_at_all(file, 8 * probe.rank, &value, 1, MPI_DOUBLE, MPI_STATUS_IGNORE);
    return MPI_File_close(&file) == MPI_SUCCESS;
  });
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 6) return 2;
  const Arguments given{argv[1], argv[2], argv[4], std::atoi(argv[3]), std::atoi(argv[5])};
  const sweepvi::app::Sandbox sandbox({{}, {given.folder}});
  std::promise<void> closed;  // by a thread of before, as MPI has some
  std::promise<int> known;
  std::thread other([&] {
    const Prober probe{"thread", known.get_future().get()};
    closed.get_future().wait();
    try_files(probe, given);
    try_processes(probe, given);
    try_connections(probe, given);
  });
  int rank = 0;
  {
    const sweepvi::Session session(argv[0], {});
    MPI_Comm_rank(session.comm(), &rank);
    std::printf("%d main shared-memory %s\n", rank, std::getenv("OMPI_MCA_btl_vader_backing_directory"));
    sandbox.close();
    const Prober probe{"main", rank};
    try_files(probe, given);
    try_system_files(probe);
    try_own_needs(probe);
    try_processes(probe, given);
    try_connections(probe, given);
    try_messages(probe, given);
    known.set_value(rank);
    closed.set_value();
    other.join();
    MPI_Barrier(session.comm());
  }
  std::printf("%d main end done\n", rank);
  return 0;
}
