#include "service/work.hpp"

#include <fmt/format.h>

#include <csignal>
#include <cstring>
#include <sstream>

#include "service/digest.hpp"

namespace sweepvi::service {

namespace fs = std::filesystem;
using nlohmann::json;

namespace {

constexpr const char* checkpoint_file = "result.h5.checkpoint";
constexpr std::int64_t log_bytes = std::int64_t{16} << 20;
// MPI's own files have a limit, too; what a job writes beyond its room the scheduler finds soon.
constexpr std::int64_t least_file = std::int64_t{16} << 20;
constexpr std::size_t longest_message = 4000;

/// Scene, changes and options: the words that check, run, solve and study share.
std::vector<std::string> shared_words(const json& work) {
  std::vector<std::string> words = {scene_file, std::string("--confine=") + confine_file};
  for (const json& change : work.value("set", json::array()))
    words.push_back("--set=" + change.get<std::string>());
  for (const json& word : work.value("options", json::array()))
    words.push_back(word);
  return words;
}

std::vector<std::string> study_words(const json& work) {
  std::vector<std::string> words;
  for (const auto& [key, value] : work.at("study").items())
    words.push_back(fmt::format("--{}={}", key, value.get<std::string>()));
  if (work.value("settings", false)) words.push_back(std::string("--settings=") + settings_file);
  return words;
}

void append(std::vector<std::string>& words, const std::vector<std::string>& more) {
  words.insert(words.end(), more.begin(), more.end());
}

std::string ending_of_signal(int signal) {
  const char* name = sigdescr_np(signal);
  return fmt::format("ended by signal {} ({})", signal, name == nullptr ? "unknown" : name);
}

/// What the program said last about itself; else what PETSc or mpirun said of its death, or anything at all.
std::string complaint_in(const std::string& log) {
  std::istringstream lines(log);
  std::string own;
  std::string death;
  std::string any;
  for (std::string line; std::getline(lines, line);) {
    if (line.starts_with("sweepvi: ")) own = line.substr(9);
    if (any.empty() && !line.starts_with("step ") && line.find_first_not_of("- \t") != std::string::npos)
      any = line;
    for (const char* sign : {"Caught signal number", "exited on signal", "bad_alloc", "Out of memory"})
      if (line.find(sign) != std::string::npos && death.empty()) death = line;
  }
  if (!own.empty()) return own;
  return death.empty() ? any : death;
}

}  // namespace

const char* result_file(const Job& job) {
  return job.request.work.at("verb") == "study" ? "result.csv" : "result.h5";
}

bool has_checkpoint(const fs::path& job_folder) {
  std::error_code failure;
  return fs::exists(job_folder / checkpoint_file, failure);
}

Order order_for(const Job& job, const fs::path& folder, const Settings& settings, std::int64_t room) {
  const json& work = job.request.work;
  const std::string verb = work.at("verb");
  Order order;
  order.words = {"mpirun", "-n", std::to_string(job.request.ranks), "--oversubscribe", "--bind-to", "none"};
  if (settings.launcher == "mpirun") append(order.words, settings.launcher_words);
  append(order.words,
         {own_path().string(), "limited", "0", std::to_string(work.value("memory", std::int64_t{0})),
          settings.program.string(), verb});
  append(order.words, shared_words(work));
  append(order.words, {std::string("--summary=") + summary_file});
  const double wall = work.value("wall_limit", 0.0);
  if (verb == "study") {
    append(order.words, study_words(work));
    append(order.words, {std::string("--csv=") + result_file(job)});
  } else {
    append(order.words, {"-o", result_file(job)});
  }
  if (verb == "run") {
    append(order.words, {std::string("--progress=") + progress_file});
    if (wall > 0.0) append(order.words, {fmt::format("--wall-limit={}", wall)});
    append(order.words, {has_checkpoint(folder) ? std::string("--restart=") + checkpoint_file : "--force"});
  }
  if (verb == "solve") append(order.words, {"--force"});
  order.file_bytes = std::min(settings.job_disk, std::max(room, least_file));
  order.log_bytes = std::min(log_bytes, std::max<std::int64_t>(room, 0));
  // A run has --wall-limit to end in order, and gets a little more than that.
  order.seconds = wall > 0.0 ? wall + (verb == "run" ? settings.grace : 0.0) : 0.0;
  order.grace = settings.grace;
  return order;
}

Checked check_work(const json& work, const fs::path& folder, const Settings& settings) {
  // Alone, without mpirun, and with a folder of its own for MPI's files: checks run side by side.
  const fs::path scratch = folder / ("mpi-" + random_hex(4));
  const std::vector<std::string> program = {"env", "OMPI_MCA_ess_singleton_isolated=1",
                                            "OMPI_MCA_orte_tmpdir_base=" + scratch.string(),
                                            settings.program.string()};
  std::vector<std::string> words = program;
  append(words, {"check"});
  append(words, shared_words(work));
  ChildLimits limits;
  limits.seconds = settings.check_seconds;
  limits.memory = settings.check_memory;
  fs::create_directory(scratch);
  ChildResult result = run_child(words, folder, limits);
  const std::string report = result.out;
  if (result.code == 0 && work.at("verb") == "study") {
    words = program;
    append(words, {"study"});
    append(words, shared_words(work));
    append(words, study_words(work));
    words.emplace_back("--help");  // reads everything, computes nothing
    result = run_child(words, folder, limits);
  }
  std::error_code failure;
  fs::remove_all(scratch, failure);
  if (result.code == 0) return {true, 0, report};
  std::string text = result.signal == SIGALRM
                         ? fmt::format("the check took longer than {} s", settings.check_seconds)
                     : result.signal != 0 ? "the check " + ending_of_signal(result.signal)
                                          : complaint_in(result.err);
  if (text.empty()) text = result.err.substr(0, longest_message);
  return {false, result.code, text};
}

Judgement judge(const Ending& ending, bool stop_asked, const fs::path& folder) {
  constexpr std::size_t tail = 1U << 16U;
  constexpr int stopped = 4;
  // Batch systems and administrators stop jobs, too: those are interrupted.
  const bool asked = stop_asked || ending.asked;
  const State when_stopped = stop_asked ? State::cancelled : State::interrupted;
  if (!ending.started) return {when_stopped, "stopped before it began"};
  if (ending.code == 0) return {State::done, ""};
  std::error_code none;
  const std::uintmax_t log = std::filesystem::file_size(folder / log_file, none);
  const auto own = none ? 0
                        : static_cast<std::size_t>(
                              std::max<std::int64_t>(static_cast<std::int64_t>(log) - ending.log_from, 0));
  std::string message =
      complaint_in(read_tail(folder / log_file, std::min(tail, own))).substr(0, longest_message);
  if (ending.code == stopped) return {when_stopped, message};
  if (ending.late) return {State::interrupted, "it was ended at its limit of time"};
  if (asked) {
    const bool kept = has_checkpoint(folder);
    return {when_stopped, kept ? "ended; its last checkpoint is kept" : "ended before its first checkpoint"};
  }
  constexpr int by_signal = 128;  // as shells and mpirun tell it
  const int signal =
      ending.signal.value_or(ending.code.value_or(0) > by_signal ? *ending.code - by_signal : 0);
  if (signal != 0) return {State::failed, message.empty() ? ending_of_signal(signal) : message};
  if (message.empty()) message = fmt::format("exit {}", ending.code.value_or(-1));
  return {State::failed, message};
}

}  // namespace sweepvi::service
