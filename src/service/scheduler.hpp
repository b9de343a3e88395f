#pragma once

#include <condition_variable>
#include <mutex>
#include <set>
#include <thread>

#include "service/launcher.hpp"
#include "service/queue.hpp"
#include "service/store.hpp"

namespace sweepvi::service {

/// Starts what waits while there are cores for it, and notes what has ended. It has a thread of its own.
class Scheduler {
public:
  Scheduler(Queue& queue, const Store& store, const Settings& settings, Launcher& launcher);
  ~Scheduler();
  Scheduler(const Scheduler&) = delete;
  Scheduler& operator=(const Scheduler&) = delete;

  /// Something has changed: look now.
  void wake();

private:
  void work();
  void look_at(const Job& job);
  void conclude(const Job& job, const Ending& ending);
  void give_up(const Job& job, State state, const std::string& message);
  void watch_disk(const Job& job);
  void start_next();
  void start(Job job);

  Queue& queue_;
  const Store& store_;
  const Settings& settings_;
  Launcher& launcher_;
  std::set<std::int64_t> told_to_stop_, too_large_;
  double measured_ = 0.0;

  std::mutex mutex_;
  std::condition_variable changed_;
  bool woken_ = false, ends_ = false;
  std::thread thread_;
};

}  // namespace sweepvi::service
