#include "service/scheduler.hpp"

#include <fmt/format.h>

#include <chrono>
#include <cstdio>

#include "service/work.hpp"

namespace sweepvi::service {

namespace {
constexpr auto interval = std::chrono::milliseconds(100);
constexpr auto after_trouble = std::chrono::milliseconds(2000);
constexpr double disk_interval = 2.0;  // s
}  // namespace

Scheduler::Scheduler(Queue& queue, const Store& store, const Settings& settings, Launcher& launcher)
    : queue_(queue), store_(store), settings_(settings), launcher_(launcher) {
  thread_ = std::thread([this] { work(); });
}

Scheduler::~Scheduler() {
  {
    const std::lock_guard lock(mutex_);
    ends_ = true;
  }
  changed_.notify_one();
  thread_.join();
}

void Scheduler::wake() {
  {
    const std::lock_guard lock(mutex_);
    woken_ = true;
  }
  changed_.notify_one();
}

void Scheduler::work() {
  while (true) {
    auto pause = interval;
    try {
      for (const Job& job : queue_.running())
        look_at(job);
      if (ticks() - measured_ > disk_interval) measured_ = ticks();
      start_next();
    } catch (const std::exception& error) {  // a full disk, say; it may have room again
      std::fprintf(stderr, "sweepvi-serve: %s\n", error.what());
      pause = after_trouble;
    }
    std::unique_lock lock(mutex_);
    changed_.wait_for(lock, pause, [&] { return woken_ || ends_; });
    woken_ = false;
    if (ends_) return;
  }
}

void Scheduler::look_at(const Job& job) {
  const Attempt attempt = store_.attempt(job.id, job.attempt);
  if (job.stop_asked && told_to_stop_.insert(job.id).second) {
    attempt.ask_to_stop();
    launcher_.stop(attempt, job);
  }
  const Whereabouts found = launcher_.poll(attempt, job);
  switch (found.kind) {
    case Whereabouts::Kind::under_way:
      if (ticks() - measured_ > disk_interval) watch_disk(job);
      return;
    case Whereabouts::Kind::ended:
      conclude(job, attempt.ending().value_or(Ending()));
      break;
    case Whereabouts::Kind::lost:
      end_processes_with("SWEEPVI_ATTEMPT", attempt.folder().string());
      attempt.remove_scratch();
      give_up(job, State::interrupted,
              fmt::format("its processes are gone without a word{}; resume goes on from {}",
                          found.reason.empty() ? "" : " (" + found.reason + ")",
                          has_checkpoint(store_.job(job.id)) ? "its last checkpoint" : "the start"));
      break;
    case Whereabouts::Kind::never_began:
      if (found.reason.empty())
        queue_.put_back(job.id, job.attempt);
      else
        give_up(job, job.stop_asked ? State::cancelled : State::interrupted, found.reason);
      break;
  }
  told_to_stop_.erase(job.id);
  too_large_.erase(job.id);
}

void Scheduler::conclude(const Job& job, const Ending& ending) {
  Judgement judgement = judge(ending, job.stop_asked, store_.job(job.id));
  if (too_large_.contains(job.id) && judgement.state != State::done)
    judgement = {State::failed,
                 fmt::format("stopped: it takes more than {} bytes of disk", settings_.job_disk)};
  queue_.finish(job.id, job.attempt,
                {judgement.state, ending.code, ending.signal, judgement.message, ending.finished,
                 ending.bytes, ending.sha256, size_below(store_.job(job.id))});
}

void Scheduler::give_up(const Job& job, State state, const std::string& message) {
  queue_.finish(job.id, job.attempt, {state, {}, {}, message, now(), 0, {}, size_below(store_.job(job.id))});
}

// No file of it may be larger than that (see Order), and neither may all together.
void Scheduler::watch_disk(const Job& job) {
  if (size_below(store_.job(job.id)) <= settings_.job_disk || !too_large_.insert(job.id).second) return;
  const Attempt attempt = store_.attempt(job.id, job.attempt);
  attempt.ask_to_stop();
  launcher_.stop(attempt, job);
}

void Scheduler::start_next() {
  int busy = 0;
  for (const Job& job : queue_.running())
    busy += job.request.ranks;
  // Strictly in order: a large job at the front is not overtaken for ever by small ones.
  for (std::optional<Job> job = queue_.next();
       job && (busy == 0 || busy + job->request.ranks <= settings_.cores); job = queue_.next()) {
    busy += job->request.ranks;
    start(std::move(*job));
  }
}

// First the queue says that it runs, then it does: whoever is killed in between, it is not started twice.
void Scheduler::start(Job job) {
  if (!queue_.start(job.id)) return;
  ++job.attempt;
  const Attempt attempt = store_.attempt(job.id, job.attempt);
  try {
    std::filesystem::create_directory(attempt.folder());
    std::filesystem::remove(store_.job(job.id) / summary_file);  // of the attempt before
    attempt.write_order(order_for(job, store_.job(job.id), settings_));
    launcher_.launch(attempt, job);
  } catch (const std::exception& error) {
    attempt.claim();  // if it was handed over all the same, it shall not begin now
    give_up(job, State::failed, fmt::format("it could not be started: {}", error.what()));
  }
}

}  // namespace sweepvi::service
