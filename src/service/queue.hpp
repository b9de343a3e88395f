#pragma once

#include <functional>
#include <map>
#include <mutex>
#include <string>
#include <vector>

#include "service/database.hpp"
#include "service/job.hpp"

namespace sweepvi::service {

/// All jobs and their states: what is not in here did not happen. Every change is one transaction; any thread
/// may call.
class Queue {
public:
  explicit Queue(const std::string& path);

  /// Drawn when the database was made: tells this queue's jobs from those of others in a batch system.
  const std::string& name() const { return name_; }

  struct Added {
    Job job;
    bool is_new = false;  ///< false: there was one with this key already
  };
  /// @param place  puts the job's files where its number says; if it throws, there is no such job
  /// @throws Refusal (409) if the key stands for another request; (429) if there are `most` jobs at rest or
  /// not
  Added add(const Request& request, std::int64_t most, const std::function<void(std::int64_t id)>& place);
  /// The job that came with this key, if that was the same request. @throws Refusal (409) if it was another
  std::optional<Job> with_key(const std::string& key, const std::string& digest) const;

  std::optional<Job> find(std::int64_t id) const;
  /// Newest first. @param before  only jobs with smaller numbers; 0: all
  std::vector<Job> list(std::optional<State> state, std::int64_t before, std::int64_t most) const;
  std::vector<Job> running() const;
  /// Who is to start next: the oldest of the highest priority.
  std::optional<Job> next() const;
  std::map<State, std::int64_t> counts() const;
  /// Bytes of all jobs that are at rest or wait.
  std::int64_t bytes_kept() const;
  std::vector<std::int64_t> ids() const;

  /// queued -> running, as its next attempt. False if it is not queued any more.
  bool start(std::int64_t id);
  /// running -> queued: the attempt never began.
  void put_back(std::int64_t id, int attempt);

  struct Outcome {
    State state = State::failed;
    std::optional<int> exit, signal;
    std::string message;
    double finished = 0.0;
    std::int64_t result_bytes = 0;
    std::string result_sha256;
    std::int64_t bytes = 0;  ///< of its folder
  };
  /// running -> the outcome's state.
  void finish(std::int64_t id, int attempt, const Outcome& outcome);

  /// queued -> cancelled; of a running job, that it is to stop. @throws Refusal (404, 409)
  Job ask_to_stop(std::int64_t id);
  /// at rest -> queued, with changes to its work. @throws Refusal (404, 409)
  Job resume(std::int64_t id, const nlohmann::json& work);
  /// Forgets a job at rest. @throws Refusal (404, 409)
  void remove(std::int64_t id);

private:
  Job job_or_refuse(std::int64_t id) const;

  mutable std::mutex mutex_;
  Database database_;
  std::string name_;
};

}  // namespace sweepvi::service
