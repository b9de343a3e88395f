#include "service/scheduler.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <utility>

#include "io/printable.hpp"
#include "service/work.hpp"

namespace sweepvi::service {

namespace {
constexpr auto interval = std::chrono::milliseconds(100);
constexpr auto after_trouble = std::chrono::milliseconds(2000);
constexpr double disk_interval = 0.5;  // s
constexpr double quiet = 5.0;          // s: a supervisor that says nothing for longer was stopped
constexpr double longest_look =
    0.5;  // s; more between two of our looks is our own pause, and nobody's silence
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
      look_at_all();
      if (ticks() - measured_ > disk_interval) {
        measured_ = ticks();
        measure_disk();
      }
      start_next();
    } catch (const std::exception& error) {  // a full disk, say; it may have room again
      log_line(printable(error.what()));
      pause = after_trouble;
    }
    std::unique_lock lock(mutex_);
    changed_.wait_for(lock, pause, [&] { return woken_ || ends_; });
    woken_ = false;
    if (ends_) return;
  }
}

void Scheduler::look_at_all() {
  for (const Job& job : queue_.running()) {
    try {
      look_at(job);
      troubled_.erase(job.id);
    } catch (const std::exception& error) {
      if (troubled_.insert(job.id).second)
        log_line(fmt::format("job {}: {}", job.id, printable(error.what())));
    }
  }
}

void Scheduler::look_at(const Job& job) {
  if (!std::filesystem::is_directory(store_.job(job)))
    return give_up(job, State::failed, "its folder is gone from the daemon's data");
  const Attempt attempt = store_.attempt(job, job.attempt);
  if (job.stop_asked && !told_to_stop_.contains(job.id)) {
    attempt.ask_to_stop();
    launcher_.stop(attempt, job);
    told_to_stop_.insert(job.id);
  }
  const Whereabouts found = launcher_.poll(attempt, job);
  switch (found.kind) {
    case Whereabouts::Kind::under_way:
      return watch(job, attempt);
    case Whereabouts::Kind::ended:
      conclude(job, attempt.ending().value_or(Ending()));
      break;
    case Whereabouts::Kind::lost:
      end_processes_with(attempt_mark, attempt.folder().string());
      attempt.remove_scratch();
      give_up_lost(job, found.reason);
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
  watched_.erase(job.id);
}

// A supervisor that was stopped (SIGSTOP) sees neither a request to stop nor a limit of time. Once either is
// due, and it says nothing, it is let go on; where that does not help, all that it supervises is ended.
void Scheduler::watch(const Job& job, const Attempt& attempt) {
  const auto [at, first] = watched_.try_emplace(job.id);
  Watched& watched = at->second;
  const double time = ticks();
  if (first) {
    watched.begin = watched.looked = time;
    watched.limit = attempt.order().seconds;
  }
  const bool told = told_to_stop_.contains(job.id) || too_large_.contains(job.id);
  if (told && watched.stop == 0.0) watched.stop = time;
  const double beat = attempt.last_beat();
  watched.silent =
      beat == watched.beat ? watched.silent + std::min(time - watched.looked, longest_look) : 0.0;
  watched.beat = beat;
  watched.looked = time;
  const bool late = watched.limit > 0.0 && time > watched.begin + watched.limit;
  if (!(late || watched.stop > 0.0) || watched.silent < quiet) return;
  if (!watched.woken) {
    launcher_.wake(attempt);
    watched.woken = true;
    watched.silent = 0.0;
  } else if (watched.silent > settings_.grace) {
    launcher_.end(attempt);
    watched.ended = true;
    watched.silent = 0.0;
  }
}

void Scheduler::give_up_lost(const Job& job, const std::string& reason) {
  const auto watched = watched_.find(job.id);
  const bool ended = watched != watched_.end() && watched->second.ended;
  const std::string from = has_checkpoint(store_.job(job)) ? "its last checkpoint" : "the start";
  const auto large = too_large_.find(job.id);
  if (large != too_large_.end()) return give_up(job, State::failed, large->second);
  if (ended)
    return give_up(
        job, job.stop_asked ? State::cancelled : State::interrupted,
        fmt::format("it was ended, for its supervisor did not stop it; resume goes on from {}", from));
  give_up(job, State::interrupted,
          fmt::format("its processes are gone without a word{}; resume goes on from {}",
                      reason.empty() ? "" : " (" + reason + ")", from));
}

void Scheduler::conclude(const Job& job, const Ending& ending) {
  Judgement judgement = judge(ending, job.stop_asked, store_.job(job));
  const auto large = too_large_.find(job.id);
  if (large != too_large_.end() && judgement.state != State::done) judgement = {State::failed, large->second};
  queue_.finish(job.id, job.attempt,
                {judgement.state, ending.code, ending.signal, judgement.message, ending.finished,
                 ending.bytes, ending.sha256, size_below(store_.job(job))});
}

void Scheduler::give_up(const Job& job, State state, const std::string& message) {
  queue_.finish(job.id, job.attempt, {state, {}, {}, message, now(), 0, {}, size_below(store_.job(job))});
}

// No file of a job may be larger than its share (see Order), and neither may all together. Where all jobs
// together are too large, the one that was started last has to go.
void Scheduler::measure_disk() {
  std::int64_t all = 0;
  std::optional<Job> last;
  for (Job& job : queue_.running()) {
    const std::int64_t bytes = size_below(store_.job(job));
    all += bytes;
    if (bytes > settings_.job_disk)
      stop_for_room(job, fmt::format("stopped: it takes more than {} bytes of disk", settings_.job_disk));
    if (!last || job.started.value_or(0.0) >= last->started.value_or(0.0)) last = std::move(job);
  }
  running_bytes_ = all;
  if (last && room_left() < 0)
    stop_for_room(*last,
                  fmt::format("stopped: all jobs together take more than {} bytes of disk; delete some, "
                              "then resume it",
                              settings_.disk));
}

void Scheduler::stop_for_room(const Job& job, const std::string& reason) {
  if (too_large_.contains(job.id)) return;
  const Attempt attempt = store_.attempt(job, job.attempt);
  attempt.ask_to_stop();
  launcher_.stop(attempt, job);
  too_large_.emplace(job.id, reason);
}

std::int64_t Scheduler::room_left() const {
  return settings_.disk - queue_.bytes_kept() - running_bytes_;
}

void Scheduler::start_next() {
  int busy = 0;
  for (const Job& job : queue_.running())
    busy += job.request.ranks;
  // Strictly in order: a large job at the front is not overtaken for ever by small ones.
  for (std::optional<Job> job = queue_.next();
       job && (busy == 0 || busy + job->request.ranks <= settings_.cores); job = queue_.next()) {
    if (room_left() <= 0) {
      queue_.say(job->id, fmt::format("waits for room: all jobs together take {} bytes of disk; delete some",
                                      settings_.disk));
      return;
    }
    busy += job->request.ranks;
    start(std::move(*job));
  }
}

// First the queue says that it runs, then it does: whoever is killed in between, it is not started twice.
void Scheduler::start(Job job) {
  const std::int64_t room = room_left();
  if (!queue_.start(job.id)) return;
  ++job.attempt;
  running_bytes_ += job.request.bytes;  // until it is measured
  const Attempt attempt = store_.attempt(job, job.attempt);
  try {
    std::filesystem::create_directory(attempt.folder());
    std::filesystem::remove(store_.job(job) / summary_file);  // of the attempt before
    attempt.write_order(order_for(job, store_.job(job), settings_, room));
    launcher_.launch(attempt, job);
  } catch (const std::exception& error) {
    const std::string reason = error.what();
    attempt.claim();  // if it was handed over all the same, it shall not begin now
    give_up(job, State::failed, fmt::format("it could not be started: {}", reason));
  }
}

}  // namespace sweepvi::service
