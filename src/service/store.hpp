#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "service/attempt.hpp"
#include "service/files.hpp"
#include "service/job.hpp"

namespace sweepvi::service {

/// Where everything is kept:
///
///     FOLDER/sweepvi-data     says that the folder is ours; nothing is touched in one that has none
///     FOLDER/queue.db         the queue
///     FOLDER/lock             held by the daemon that works here
///     FOLDER/jobs/RANDOM/     a job: its notes, scene, matrices, log, result and attempts
///     FOLDER/quarantine/      what belongs to no job; nothing ever deletes it
///
/// A job's folder begins with a file `unfinished`. Whether there is a job is decided by the queue alone: the
/// mark goes once its row is committed, and comes back before its row is removed. So a folder that has no row
/// was promised to nobody if it has the mark, and is removed; without it something was lost, and it is kept.
///
/// No name that a client sends becomes part of a path.
class Store {
public:
  /// Makes an empty folder or none into ours, and takes one that is ours.
  /// @throws UsageError, with nothing changed, if it is somebody else's, or another daemon works there
  explicit Store(std::filesystem::path folder);

  /// Of a queue that is made here, see Queue.
  const std::string& queue_name() const { return queue_name_; }
  std::filesystem::path queue() const { return folder_ / "queue.db"; }
  std::filesystem::path folder(const std::string& name) const { return folder_ / "jobs" / name; }
  std::filesystem::path job(const Job& job) const { return folder(job.folder); }
  Attempt attempt(const Job& job, int number) const {
    return Attempt(this->job(job) / ("attempt-" + std::to_string(number)));
  }

  /// A folder for what comes in, with the mark. @return its name
  std::string receive() const;
  /// Puts a job's notes into its folder, and all that is there onto the disk.
  void note(const Job& job) const;
  /// Takes the mark away: there is such a job.
  void promise(const std::string& name) const noexcept;
  /// Puts the mark back. @throws std::system_error if it cannot: without, the job would come back
  void take_back(const std::string& name) const;
  bool promised(const std::string& name) const;
  /// Deletes a folder that no job has.
  void discard(const std::string& name) const noexcept;

  /// Names of all that is in jobs/.
  std::vector<std::string> names() const;
  /// Moves something out of our way. @return where it is now
  std::filesystem::path set_aside(const std::filesystem::path& path) const;

private:
  void adopt();

  std::filesystem::path folder_;
  std::string queue_name_;
  Descriptor lock_;
};

class Queue;

/// Compares queue and folders: jobs that only a folder knows of come back, what nobody was promised is
/// removed, and what cannot be explained is set aside. Tells what it finds on standard error.
void take_up(const Store& store, Queue& queue);

/// The queue's file, after it was set aside if it is damaged: then take_up() brings its jobs back.
std::filesystem::path sound_queue(const Store& store);

}  // namespace sweepvi::service
