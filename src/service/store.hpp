#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "service/attempt.hpp"
#include "service/files.hpp"

namespace sweepvi::service {

/// Where everything is kept:
///
///     FOLDER/queue.db          the queue
///     FOLDER/lock              held by the daemon that works here
///     FOLDER/incoming/RANDOM/  what somebody is handing in
///     FOLDER/jobs/ID/          a job: its scene, matrices, log, result and attempts
///
/// No name that a client sends becomes part of a path.
class Store {
public:
  /// Makes what is missing, for this user only.
  /// @throws UsageError if another daemon works there
  explicit Store(std::filesystem::path folder);

  std::filesystem::path queue() const { return folder_ / "queue.db"; }
  std::filesystem::path job(std::int64_t id) const { return folder_ / "jobs" / std::to_string(id); }
  Attempt attempt(std::int64_t id, int number) const {
    return Attempt(job(id) / ("attempt-" + std::to_string(number)));
  }

  /// An empty folder for what comes in.
  std::filesystem::path receive() const;
  /// Makes it the folder of a job.
  void keep(const std::filesystem::path& incoming, std::int64_t id) const;
  void remove(std::int64_t id) const;
  static void discard(const std::filesystem::path& incoming) noexcept;
  /// Removes what no job belongs to: a daemon was killed while it came in.
  void clean(const std::vector<std::int64_t>& ids) const;

private:
  std::filesystem::path folder_;
  Descriptor lock_;
};

}  // namespace sweepvi::service
