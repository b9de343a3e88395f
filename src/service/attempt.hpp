#pragma once

#include <cstdint>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "service/files.hpp"

namespace sweepvi::service {

/// In the environment that processes begin with, with the folder of the attempt: of its supervisor, and of
/// all that the supervisor starts.
inline constexpr const char* supervisor_mark = "SWEEPVI_SUPERVISOR";
inline constexpr const char* attempt_mark = "SWEEPVI_ATTEMPT";

/// What a supervisor is to run, and within which limits.
struct Order {
  std::vector<std::string> words;  ///< of the program that launches the ranks
  std::int64_t file_bytes = 0;     ///< of one file; 0: no limit
  std::int64_t log_bytes = 0;      ///< of the log
  double seconds = 0.0;            ///< until it is stopped; 0: no limit
  double grace = 0.0;              ///< from one kind of signal to the next [s]
};

/// How an attempt ended.
struct Ending {
  std::optional<int> code, signal;
  bool asked = false;   ///< somebody asked it to stop
  bool late = false;    ///< it reached its limit of time
  bool forced = false;  ///< it had to be killed
  bool started = true;  ///< false: stopped before it began
  double finished = 0.0;
  std::int64_t log_from = 0;  ///< where its part of the log begins
  std::int64_t bytes = 0;     ///< of the result; 0: none
  std::string sha256;         ///< of the result
};

/// One attempt at a job, as the daemon and the supervisor of that attempt see it. All they know of each other
/// is in this folder: so either of them may be killed, and a daemon that comes back finds all attempts again.
class Attempt {
public:
  explicit Attempt(std::filesystem::path folder) : folder_(std::move(folder)) {}

  const std::filesystem::path& folder() const { return folder_; }
  std::filesystem::path job() const { return folder_.parent_path(); }

  void write_order(const Order& order) const;
  Order order() const;

  /// Of all who ever call this, one gets a descriptor; whoever holds it runs the attempt, or keeps it from
  /// being run. The others get none.
  /// @throws std::system_error
  Descriptor claim() const;
  bool claimed() const;
  /// Whether the one who claimed it is still there.
  bool alive() const;

  /// Says that its supervisor is there, at least every few seconds. @param claim  what claim() gave
  static void beat(const Descriptor& claim) noexcept;
  /// When it said so last [s since 1970, by the clock of the file system]; 0: never.
  double last_beat() const;

  /// Where MPI keeps its own files meanwhile; remembered, for a supervisor that is killed cannot tidy up.
  void note_scratch(const std::filesystem::path& path) const;
  void remove_scratch() const noexcept;

  void ask_to_stop() const;  ///< @throws std::system_error
  bool asked_to_stop() const;

  void write_ending(const Ending& ending) const;
  std::optional<Ending> ending() const;  ///< nothing if there is none that can be read

private:
  std::filesystem::path folder_;
};

}  // namespace sweepvi::service
