#include "parallel/memory.hpp"

#include <fmt/format.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <limits>
#include <map>
#include <optional>
#include <sstream>
#include <utility>

#include "sweepvi/petsc.hpp"

namespace sweepvi {

namespace {

namespace fs = std::filesystem;

constexpr double unlimited = std::numeric_limits<double>::infinity();

/// The numbers of a file with lines "name value": /proc/meminfo, memory.stat.
std::map<std::string, double> read_table(const fs::path& path) {
  std::map<std::string, double> table;
  std::ifstream file(path);
  std::string line;
  while (std::getline(file, line)) {
    std::istringstream words(line);
    std::string name;
    double value = 0.0;
    if (words >> name >> value) table[name] = value;
  }
  return table;
}

/// A file with one number; `otherwise` if it is missing or says "max".
double read_number(const fs::path& path, double otherwise) {
  std::ifstream file(path);
  double value = 0.0;
  return file >> value ? value : otherwise;
}

double value_of(const std::map<std::string, double>& table, const std::string& name, double otherwise) {
  const auto at = table.find(name);
  return at == table.end() ? otherwise : at->second;
}

/// What one control group leaves. Its cached pages count as used, but make room when asked.
double group_room(const fs::path& folder, bool second) {
  const double limit = read_number(folder / (second ? "memory.max" : "memory.limit_in_bytes"), unlimited);
  if (limit == unlimited) return unlimited;
  const double used = read_number(folder / (second ? "memory.current" : "memory.usage_in_bytes"), 0.0);
  const auto stat = read_table(folder / "memory.stat");
  const std::string total = second ? "" : "total_";
  const double cached =
      value_of(stat, total + "inactive_file", 0.0) + value_of(stat, total + "active_file", 0.0);
  return std::max(0.0, limit - std::max(0.0, used - cached));
}

/// The least of a process's group and the groups around it. In a container the outer part of the path is not
/// visible, and the limits stand at the root.
double control_group_room(const fs::path& root) {
  double room = unlimited;
  std::ifstream file(root / "proc/self/cgroup");
  std::string line;
  while (std::getline(file, line)) {  // number:controllers:/path; version 2 has no controllers
    const std::size_t first = line.find(':');
    const std::size_t second = line.find(':', first + 1);
    if (second == std::string::npos) continue;
    const std::string controllers = "," + line.substr(first + 1, second - first - 1) + ",";
    const bool unified = controllers == ",,";
    if (!unified && controllers.find(",memory,") == std::string::npos) continue;
    const fs::path base = root / (unified ? "sys/fs/cgroup" : "sys/fs/cgroup/memory");
    fs::path inside = fs::path(line.substr(second + 1)).relative_path();
    while (true) {
      room = std::min(room, group_room(base / inside, unified));
      if (inside.empty()) break;
      inside = inside.parent_path();
    }
  }
  return room;
}

/// Address space that `ulimit -v` leaves this process.
double address_room(const fs::path& root) {
  rlimit limit{};
  if (getrlimit(RLIMIT_AS, &limit) != 0 || limit.rlim_cur == RLIM_INFINITY) return unlimited;
  const double used = read_number(root / "proc/self/statm", 0.0) * static_cast<double>(sysconf(_SC_PAGESIZE));
  return std::max(0.0, static_cast<double>(limit.rlim_cur) - used);
}

/// -sweepvi_memory_limit, where PETSc is up.
std::optional<double> asked_limit() {
  PetscBool ready = PETSC_FALSE;
  check(PetscInitialized(&ready));
  if (ready == PETSC_FALSE) return std::nullopt;
  PetscReal gigabytes = 0.0;
  PetscBool set = PETSC_FALSE;
  check_options(PetscOptionsGetReal(nullptr, nullptr, "-sweepvi_memory_limit", &gigabytes, &set));
  return set == PETSC_TRUE && gigabytes > 0.0 ? std::optional(1e9 * gigabytes) : std::nullopt;
}

[[noreturn]] void refuse(const std::string& what, double bytes, const std::string& whose, double there,
                         const std::string& source) {
  throw InputError(fmt::format(
      "{} at least {} of memory{}, and there are {} ({}). If there is more, say so: -sweepvi_memory_limit "
      "GIGABYTES",
      what, memory_text(bytes), whose, memory_text(there), source));
}

}  // namespace

Memory available_memory(const fs::path& root) {
  if (const auto asked = asked_limit()) return {*asked, "-sweepvi_memory_limit", *asked};
  const auto info = read_table(root / "proc/meminfo");
  const double swap = 1024.0 * value_of(info, "SwapFree:", 0.0);
  const double machine = 1024.0 * value_of(info, "MemAvailable:", unlimited);
  const double group = control_group_room(root);
  return {std::min(machine, group) + swap,
          machine <= group ? "available on this machine" : "left to the control group of this process",
          address_room(root)};
}

std::string memory_text(double bytes) {
  const auto [unit, name] = bytes < 1e9    ? std::pair(1e6, "MB")
                            : bytes < 1e12 ? std::pair(1e9, "GB")
                                           : std::pair(1e12, "TB");
  return fmt::format("{:.3g} {}", bytes / unit, name);
}

void require_memory(double bytes, const std::string& what) {
  constexpr double unquestioned = 1e6;  // asking means reading some files
  if (bytes < unquestioned) return;
  const Memory there = available_memory();
  if (bytes > there.node) refuse(what, bytes, "", there.node, there.source);
  if (bytes > there.process) refuse(what, bytes, "", there.process, "ulimit -v");
}

void require_memory(MPI_Comm comm, double bytes, const std::string& what) {
  MPI_Comm node = MPI_COMM_NULL;
  int ranks = 1;
  MPI_Comm_split_type(comm, MPI_COMM_TYPE_SHARED, 0, MPI_INFO_NULL, &node);
  MPI_Comm_size(node, &ranks);
  double together = bytes;
  MPI_Allreduce(MPI_IN_PLACE, &together, 1, MPI_DOUBLE, MPI_SUM, node);
  MPI_Comm_free(&node);
  agreed(comm, [&] {
    const Memory there = available_memory();
    if (together > there.node)
      refuse(what, together, ranks == 1 ? "" : fmt::format(" on a node with {} ranks", ranks), there.node,
             there.source);
    if (bytes > there.process)
      refuse(what, bytes, ranks == 1 ? "" : " on each rank", there.process, "ulimit -v");
  });
}

}  // namespace sweepvi
