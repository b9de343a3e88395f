#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "service/attempt.hpp"
#include "service/child.hpp"
#include "service/job.hpp"
#include "service/settings.hpp"

namespace sweepvi::service {

/// What a job's `work` says, as words of the command line. Names of its files, all in its folder:
inline constexpr const char* scene_file = "scene.toml";
inline constexpr const char* settings_file = "settings.toml";  ///< of a study
inline constexpr const char* confine_file = "files.json";      ///< what the scene may name
inline constexpr const char* progress_file = "progress";
inline constexpr const char* summary_file = "summary.json";
inline constexpr const char* log_file = "log";
const char* result_file(const Job& job);

/// Whether an earlier attempt left something to go on from.
bool has_checkpoint(const std::filesystem::path& job_folder);

/// What the supervisor of a job's next attempt is to do.
/// @param room  bytes that all jobs together may still take: no file may be larger
Order order_for(const Job& job, const std::filesystem::path& folder, const Settings& settings,
                std::int64_t room);

/// `sweepvi check` of what is in a folder, as it would be run.
struct Checked {
  bool good = false;
  int exit = 0;
  std::string text;  ///< the report, or the complaint
};
Checked check_work(const nlohmann::json& work, const std::filesystem::path& folder, const Settings& settings);

/// What became of an attempt: state and message, from its ending and its log.
struct Judgement {
  State state = State::failed;
  std::string message;
};
Judgement judge(const Ending& ending, bool stop_asked, const std::filesystem::path& folder);

}  // namespace sweepvi::service
