#pragma once

#include <atomic>
#include <condition_variable>
#include <map>
#include <mutex>
#include <set>
#include <thread>

#include "service/launcher.hpp"
#include "service/queue.hpp"
#include "service/store.hpp"

namespace sweepvi::service {

/// Starts what waits while there are cores and room on the disk for it, and notes what has ended. It has a
/// thread of its own. What is wrong with one job keeps no other from going on.
class Scheduler {
public:
  Scheduler(Queue& queue, const Store& store, const Settings& settings, Launcher& launcher);
  ~Scheduler();
  Scheduler(const Scheduler&) = delete;
  Scheduler& operator=(const Scheduler&) = delete;

  /// Something has changed: look now.
  void wake();
  /// Bytes of all jobs that run, as they were measured last.
  std::int64_t running_bytes() const { return running_bytes_; }

private:
  void work();
  void look_at_all();
  void look_at(const Job& job);
  void watch(const Job& job, const Attempt& attempt);
  void conclude(const Job& job, const Ending& ending);
  void give_up(const Job& job, State state, const std::string& message);
  void give_up_lost(const Job& job, const std::string& reason);
  void measure_disk();
  void stop_for_room(const Job& job, const std::string& reason);
  std::int64_t room_left() const;
  void start_next();
  void start(Job job);

  Queue& queue_;
  const Store& store_;
  const Settings& settings_;
  Launcher& launcher_;
  /// An attempt under way, by our clock.
  struct Watched {
    double begin = 0.0;                 // when it was first seen
    double limit = 0.0;                 // its supervisor's [s]; 0: none
    double stop = 0.0;                  // when it was asked to stop; 0: it was not
    double beat = 0.0, looked = 0.0;    // its supervisor's last word, and our last look
    double silent = 0.0;                // for so long since [s], while we looked
    bool woken = false, ended = false;  // by us, being overdue
  };
  std::map<std::int64_t, Watched> watched_;
  std::set<std::int64_t> told_to_stop_;
  std::map<std::int64_t, std::string> too_large_;  // stopped for it, and why
  std::set<std::int64_t> troubled_;                // what went wrong with them was told
  std::atomic<std::int64_t> running_bytes_ = 0;
  double measured_ = 0.0;

  std::mutex mutex_;
  std::condition_variable changed_;
  bool woken_ = false, ends_ = false;
  std::thread thread_;
};

}  // namespace sweepvi::service
