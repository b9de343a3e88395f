#include "service/settings.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <climits>
#include <cstdlib>
#include <cstring>
#include <sstream>
#include <thread>

#include "service/address.hpp"
#include "service/arguments.hpp"
#include "service/files.hpp"
#include "service/refusal.hpp"

namespace sweepvi::service {

namespace fs = std::filesystem;

namespace {

const std::vector<Option>& options() {
  static const std::vector<Option> entries = {
      {"--listen", "HOST:PORT|unix:PATH", "where to listen (default: 127.0.0.1:8750)"},
      {"--data", "FOLDER", "queue and jobs (default: $XDG_STATE_HOME/sweepvi or ~/.local/state/sweepvi)"},
      {"--token-file", "FILE",
       "ask for the token in it, or for one of those of its users, see README.md; outside loopback there "
       "must be one"},
      {"--cores", "N", "ranks that run at once (default: the processors of this machine)"},
      {"--launcher", "mpirun|slurm", "what starts jobs (default: mpirun)"},
      {"--launcher-words", "\"...\"", "more words for mpirun or sbatch, as in \"--partition=short\""},
      {"--max-body", "BYTES", "of a request (default: 256M)"},
      {"--max-jobs", "N", "that are kept (default: 10000)"},
      {"--max-disk", "BYTES", "of all jobs (default: 100G)"},
      {"--max-job-disk", "BYTES", "of one job (default: 20G)"},
      {"--max-memory", "BYTES", "address space of one rank (default: no limit)"},
      {"--max-wall", "SECONDS", "of one attempt at a job (default: no limit)"},
      {"--grace", "SECONDS", "from SIGUSR1 to SIGTERM to SIGKILL (default: 30)"},
      {"--check-seconds", "SECONDS", "for 'sweepvi check' before a job is queued (default: 60)"},
      {"--check-memory", "BYTES", "address space it may take, 0 for any (default: 8G)"},
      {"--threads", "N", "connections at once (default: 64)"},
      {"--help", "", "this text"}};
  return entries;
}

/// scripts/plot, installed beside this program or in the sources it was built from.
fs::path find_plot(const fs::path& own) {
  const fs::path folder = own.parent_path();
  for (const fs::path& path :
       {folder / "sweepvi-plot", folder / "../scripts/plot", folder / "../../scripts/plot"})
    if (access(path.c_str(), X_OK) == 0) return fs::weakly_canonical(path);
  return {};
}

}  // namespace

fs::path default_data() {
  const char* state = std::getenv("XDG_STATE_HOME");
  if (state != nullptr && *state == '/') return fs::path(state) / "sweepvi";
  const char* home = std::getenv("HOME");
  if (home == nullptr || *home != '/')
    throw UsageError("there is no $HOME; say where to work with --data FOLDER");
  return fs::path(home) / ".local/state/sweepvi";
}

std::string Settings::host() const {
  std::string host = listen.substr(0, listen.rfind(':'));
  if (host.starts_with('[') && host.ends_with(']')) host = host.substr(1, host.size() - 2);
  return host;
}

int Settings::port() const {
  const std::size_t colon = listen.rfind(':');
  const std::string text = colon == std::string::npos ? "" : listen.substr(colon + 1);
  char* end = nullptr;
  const long port = std::strtol(text.c_str(), &end, 10);
  if (text.empty() || *end != '\0' || port < 0 || port > 65535)
    throw UsageError(fmt::format("--listen {}: expected HOST:PORT or unix:PATH", listen));
  return static_cast<int>(port);
}

bool Settings::on_loopback() const {
  return on_socket() || is_loopback(host());
}

Settings read_settings(const std::vector<std::string>& words) {
  const Arguments given("serve", words, options(), 0);
  Settings settings;
  settings.listen = given.get("--listen", settings.listen);
  settings.data = given.has("--data") ? fs::path(given.get("--data")) : default_data();
  settings.data = fs::absolute(settings.data);
  if (settings.on_socket()) {
    if (settings.listen.size() - 5 >= 100 || settings.listen.size() == 5)
      throw UsageError("--listen unix:PATH: a path of 1 to 99 characters");
  } else {
    static_cast<void>(settings.port());
  }
  const fs::path own = own_path();
  settings.program = own.parent_path() / "sweepvi";
  if (access(settings.program.c_str(), X_OK) != 0)
    throw UsageError(
        fmt::format("{} is not there; sweepvi-serve works beside it", settings.program.string()));
  settings.plot = find_plot(own);
  if (given.has("--token-file")) settings.users = read_users(given.get("--token-file"));
  if (!settings.on_loopback() && settings.open())
    throw UsageError(fmt::format("--listen {}: outside loopback there must be a token; add --token-file FILE",
                                 settings.listen));
  settings.launcher = given.get("--launcher", settings.launcher);
  if (settings.launcher != "mpirun" && settings.launcher != "slurm")
    throw UsageError(fmt::format("--launcher {}: expected mpirun or slurm", settings.launcher));
  std::istringstream more(given.get("--launcher-words"));
  for (std::string word; more >> word;)
    settings.launcher_words.push_back(word);

  constexpr double most_bytes = 1e18;
  const auto whole = [&](const char* word, std::int64_t otherwise, double least, double most) {
    return static_cast<std::int64_t>(given.number(word, static_cast<double>(otherwise), least, most));
  };
  const int processors = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  settings.cores = static_cast<int>(whole("--cores", processors, 1, 1e6));
  settings.body = whole("--max-body", settings.body, 1024, most_bytes);
  settings.jobs = whole("--max-jobs", settings.jobs, 1, 1e9);
  settings.disk = whole("--max-disk", settings.disk, 1, most_bytes);
  settings.job_disk = whole("--max-job-disk", settings.job_disk, 1, most_bytes);
  settings.memory = whole("--max-memory", settings.memory, 1, most_bytes);
  settings.wall = given.number("--max-wall", settings.wall, 0.001, 1e9);
  settings.grace = given.number("--grace", settings.grace, 0.01, 3600);
  settings.check_seconds = static_cast<int>(whole("--check-seconds", settings.check_seconds, 1, 3600));
  settings.check_memory = whole("--check-memory", settings.check_memory, 0, most_bytes);
  settings.threads = static_cast<int>(whole("--threads", settings.threads, 4, 1000));
  return settings;
}

std::string serve_help() {
  return "Usage: sweepvi serve [options]\n\nqueue and run scenes that others hand in over HTTP; see "
         "README.md, "
         "\"As a service\"\n\n" +
         option_table(options()) + "\nBYTES may end in K, M, G or T.\n";
}

}  // namespace sweepvi::service
