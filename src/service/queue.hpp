#pragma once

#include <functional>
#include <map>
#include <mutex>
#include <set>
#include <string>
#include <vector>

#include "service/database.hpp"
#include "service/job.hpp"

namespace sweepvi::service {

/// Whether a row may name a job's folder so: lower-case letters, digits and dashes, 64 at most.
bool is_folder_name(const std::string& name);

/// All jobs and their states: what is not in here did not happen. Every change is one transaction; any thread
/// may call. A row that somebody has damaged is left alone and told on standard error: it stands in nobody's
/// way.
/// @throws DatabaseError, by all that follows
class Queue {
public:
  /// Makes the database if it is missing, and brings one of an earlier version up to date.
  /// @param name  of a queue that is made: tells its jobs from those of others in a batch system
  /// @throws UsageError if a later version made it, or it is not a queue
  Queue(const std::string& path, const std::string& name);

  const std::string& name() const { return name_; }

  /// The name of the queue in a file; nothing if that is no queue. Writes nothing.
  static std::optional<std::string> name_in(const std::filesystem::path& path);

  struct Row {
    Job job;
    std::string damage;  ///< empty: none
  };
  /// All rows of the queue in a file, damaged or not.
  /// @throws UsageError  if another version made it  @throws DatabaseError
  static std::vector<Row> rows_in(const std::filesystem::path& path);

  struct Added {
    Job job;
    bool is_new = false;  ///< false: there was one with this key already
  };
  /// @param folder  where its files are
  /// @param prepare  called before the job is committed; if it throws, there is no such job
  /// @throws Refusal (409) if the key stands for another request; (429) if there are `most` jobs at rest or
  /// not
  Added add(const Request& request, const std::string& folder, std::int64_t most,
            const std::function<void(const Job& job)>& prepare);
  /// The job that came with this key, if that was the same request. @throws Refusal (409) if it was another
  std::optional<Job> with_key(const std::string& key, const std::string& digest) const;
  /// Takes up a job that was in a queue that is lost: it waits, or it is whatever became of its last attempt.
  /// False if its number or its key is in use.
  bool restore(const Job& job);

  /// @throws Refusal (500) if its row is damaged
  std::optional<Job> find(std::int64_t id) const;
  struct Selection {
    std::optional<State> state;
    std::int64_t before = 0;           ///< only jobs with smaller numbers; 0: all
    std::optional<std::string> owner;  ///< only his
  };
  /// Newest first.
  std::vector<Job> list(const Selection& wanted, std::int64_t most) const;
  std::vector<Job> running() const;
  /// Who is to start next: the oldest of the highest priority.
  std::optional<Job> next() const;
  std::map<State, std::int64_t> counts(const std::optional<std::string>& owner = std::nullopt) const;
  /// Bytes of all jobs that are at rest or wait.
  std::int64_t bytes_kept() const;
  struct Kept {
    std::int64_t jobs = 0;
    std::int64_t bytes = 0;  ///< of those that run: what they began with
  };
  Kept kept_by(const std::string& owner) const;
  struct Owner {
    std::int64_t id = 0;
    bool damaged = false;  ///< its row is
  };
  /// Whose each folder is.
  std::map<std::string, Owner> owners() const;

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
  /// Forgets a job at rest, or one whose row is damaged. @throws Refusal (404, 409)
  void remove(std::int64_t id);
  /// Of any row, damaged or not; empty if that names none. @throws Refusal (404)
  std::string folder_of(std::int64_t id) const;
  /// Says why a job waits.
  void say(std::int64_t id, const std::string& message);

private:
  void migrate();
  std::optional<Job> read(const Statement& row) const;
  std::vector<Job> read_all(Statement& rows) const;
  Job job_or_refuse(std::int64_t id) const;

  mutable std::mutex mutex_;
  Database database_;
  std::string name_;
  mutable std::set<std::int64_t> damaged_;  // those that were told
};

}  // namespace sweepvi::service
