#include "service/queue.hpp"

#include <fmt/format.h>

#include <array>

#include "service/digest.hpp"
#include "service/files.hpp"
#include "service/refusal.hpp"

namespace sweepvi::service {

namespace {

constexpr std::array<std::pair<State, const char*>, 6> state_names = {{{State::queued, "queued"},
                                                                       {State::running, "running"},
                                                                       {State::done, "done"},
                                                                       {State::failed, "failed"},
                                                                       {State::cancelled, "cancelled"},
                                                                       {State::interrupted, "interrupted"}}};

// AUTOINCREMENT: the number of a job that was removed stays unused.
constexpr const char* tables = R"(CREATE TABLE IF NOT EXISTS jobs (
  id INTEGER PRIMARY KEY AUTOINCREMENT,
  state TEXT NOT NULL,
  title TEXT NOT NULL,
  ranks INTEGER NOT NULL,
  priority INTEGER NOT NULL,
  work TEXT NOT NULL,
  key TEXT UNIQUE,
  digest TEXT NOT NULL,
  report TEXT NOT NULL,
  bytes INTEGER NOT NULL,
  submitted REAL NOT NULL,
  started REAL,
  finished REAL,
  attempt INTEGER NOT NULL DEFAULT 0,
  stop_asked INTEGER NOT NULL DEFAULT 0,
  exit INTEGER,
  signal INTEGER,
  message TEXT NOT NULL DEFAULT '',
  result_bytes INTEGER NOT NULL DEFAULT 0,
  result_sha256 TEXT NOT NULL DEFAULT ''))";
constexpr const char* order = "CREATE INDEX IF NOT EXISTS waiting ON jobs (state, priority DESC, id)";

constexpr const char* columns =
    "SELECT id, state, title, ranks, priority, work, key, digest, report, bytes, submitted, started, "
    "finished, attempt, stop_asked, exit, signal, message, result_bytes, result_sha256 FROM jobs ";

Job read_job(const Statement& row) {
  const auto real = [&](int column) {
    return row.null(column) ? std::optional<double>() : std::optional(row.real(column));
  };
  const auto whole = [&](int column) {
    return row.null(column) ? std::optional<int>() : std::optional(static_cast<int>(row.integer(column)));
  };
  Job job;
  job.id = row.integer(0);
  job.state = state_named(row.text(1)).value_or(State::failed);
  job.request = {row.text(2),
                 static_cast<int>(row.integer(3)),
                 static_cast<int>(row.integer(4)),
                 nlohmann::json::parse(row.text(5)),
                 row.text(6),
                 row.text(7),
                 row.text(8),
                 row.integer(9)};
  job.submitted = row.real(10);
  job.started = real(11);
  job.finished = real(12);
  job.attempt = static_cast<int>(row.integer(13));
  job.stop_asked = row.integer(14) != 0;
  job.exit = whole(15);
  job.signal = whole(16);
  job.message = row.text(17);
  job.result_bytes = row.integer(18);
  job.result_sha256 = row.text(19);
  return job;
}

std::vector<Job> read_jobs(Statement& rows) {
  std::vector<Job> jobs;
  while (rows.step())
    jobs.push_back(read_job(rows));
  return jobs;
}

}  // namespace

const char* name_of(State state) {
  for (const auto& [known, name] : state_names)
    if (known == state) return name;
  return "";
}

std::optional<State> state_named(const std::string& name) {
  for (const auto& [state, known] : state_names)
    if (known == name) return state;
  return std::nullopt;
}

bool at_rest(State state) {
  return state != State::queued && state != State::running;
}

Queue::Queue(const std::string& path) : database_(path) {
  database_.run(tables);
  database_.run(order);
  database_.run("CREATE TABLE IF NOT EXISTS queue (name TEXT NOT NULL)");
  Transaction transaction(database_);
  Statement row(database_, "SELECT name FROM queue");
  if (row.step()) {
    name_ = row.text(0);
    return;
  }
  name_ = random_hex(4);
  Statement(database_, "INSERT INTO queue VALUES (?)").with(name_).run();
  transaction.commit();
}

std::optional<Job> Queue::with_key(const std::string& key, const std::string& digest) const {
  const std::lock_guard lock(mutex_);
  Statement row(database_, fmt::format("{} WHERE key = ?", columns));
  row.with(key);
  if (key.empty() || !row.step()) return std::nullopt;
  Job job = read_job(row);
  if (job.request.digest != digest)
    throw Refusal(409, fmt::format("the idempotency key '{}' belongs to job {}, which is another request",
                                   key, job.id));
  return job;
}

Queue::Added Queue::add(const Request& request, std::int64_t most,
                        const std::function<void(std::int64_t id)>& place) {
  if (std::optional<Job> known = with_key(request.key, request.digest)) return {std::move(*known), false};
  const std::lock_guard lock(mutex_);
  Transaction transaction(database_);
  {
    Statement count(database_, "SELECT count(*) FROM jobs");
    if (count.step() && count.integer(0) >= most)
      throw Refusal(429, fmt::format("there are {} jobs already; delete some first", most));
  }
  Statement insert(
      database_,
      "INSERT INTO jobs (state, title, ranks, priority, work, key, digest, report, bytes, submitted) "
      "VALUES ('queued', ?, ?, ?, ?, ?, ?, ?, ?, ?) ON CONFLICT (key) DO NOTHING");
  insert.with(request.title)
      .with(std::int64_t{request.ranks})
      .with(std::int64_t{request.priority})
      .with(request.work.dump())
      .with(request.key.empty() ? std::optional<std::string>() : std::optional(request.key))
      .with(request.digest)
      .with(request.report)
      .with(request.bytes)
      .with(now())
      .run();
  if (database_.changes() == 0) {  // the same request came twice at once
    Statement row(database_, fmt::format("{} WHERE key = ?", columns));
    row.with(request.key).step();
    Job job = read_job(row);
    if (job.request.digest != request.digest)
      throw Refusal(409, fmt::format("the idempotency key '{}' belongs to job {}, which is another request",
                                     request.key, job.id));
    return {std::move(job), false};
  }
  const std::int64_t id = database_.last_id();
  place(id);
  Job job = job_or_refuse(id);
  transaction.commit();
  return {std::move(job), true};
}

Job Queue::job_or_refuse(std::int64_t id) const {
  Statement row(database_, fmt::format("{} WHERE id = ?", columns));
  row.with(id);
  if (!row.step()) throw Refusal(404, fmt::format("there is no job {}", id));
  return read_job(row);
}

std::optional<Job> Queue::find(std::int64_t id) const {
  const std::lock_guard lock(mutex_);
  Statement row(database_, fmt::format("{} WHERE id = ?", columns));
  row.with(id);
  return row.step() ? std::optional(read_job(row)) : std::nullopt;
}

std::vector<Job> Queue::list(std::optional<State> state, std::int64_t before, std::int64_t most) const {
  const std::lock_guard lock(mutex_);
  Statement rows(database_, fmt::format("{} WHERE (? = 0 OR id < ?) AND (? = '' OR state = ?) "
                                        "ORDER BY id DESC LIMIT ?",
                                        columns));
  const std::string name = state ? name_of(*state) : "";
  rows.with(before).with(before).with(name).with(name).with(most);
  return read_jobs(rows);
}

std::vector<Job> Queue::running() const {
  const std::lock_guard lock(mutex_);
  Statement rows(database_, fmt::format("{} WHERE state = 'running' ORDER BY id", columns));
  return read_jobs(rows);
}

std::optional<Job> Queue::next() const {
  const std::lock_guard lock(mutex_);
  Statement row(database_,
                fmt::format("{} WHERE state = 'queued' ORDER BY priority DESC, id LIMIT 1", columns));
  return row.step() ? std::optional(read_job(row)) : std::nullopt;
}

std::map<State, std::int64_t> Queue::counts() const {
  const std::lock_guard lock(mutex_);
  std::map<State, std::int64_t> counts;
  for (const auto& [state, name] : state_names)
    counts[state] = 0;
  Statement rows(database_, "SELECT state, count(*) FROM jobs GROUP BY state");
  while (rows.step())
    counts[state_named(rows.text(0)).value_or(State::failed)] = rows.integer(1);
  return counts;
}

std::int64_t Queue::bytes_kept() const {
  const std::lock_guard lock(mutex_);
  Statement row(database_, "SELECT coalesce(sum(bytes), 0) FROM jobs");
  row.step();
  return row.integer(0);
}

std::vector<std::int64_t> Queue::ids() const {
  const std::lock_guard lock(mutex_);
  Statement rows(database_, "SELECT id FROM jobs");
  std::vector<std::int64_t> ids;
  while (rows.step())
    ids.push_back(rows.integer(0));
  return ids;
}

bool Queue::start(std::int64_t id) {
  const std::lock_guard lock(mutex_);
  Statement(database_,
            "UPDATE jobs SET state = 'running', attempt = attempt + 1, started = ?, finished = NULL, "
            "exit = NULL, signal = NULL, message = '' WHERE id = ? AND state = 'queued'")
      .with(now())
      .with(id)
      .run();
  return database_.changes() == 1;
}

void Queue::put_back(std::int64_t id, int attempt) {
  const std::lock_guard lock(mutex_);
  // Whoever asked it to stop meanwhile has what was asked for.
  Statement(
      database_,
      "UPDATE jobs SET state = CASE stop_asked WHEN 0 THEN 'queued' ELSE 'cancelled' END, started = NULL "
      "WHERE id = ? AND attempt = ? AND state = 'running'")
      .with(id)
      .with(std::int64_t{attempt})
      .run();
}

void Queue::finish(std::int64_t id, int attempt, const Outcome& outcome) {
  const std::lock_guard lock(mutex_);
  Statement(database_,
            "UPDATE jobs SET state = ?, exit = ?, signal = ?, message = ?, finished = ?, result_bytes = ?, "
            "result_sha256 = ?, bytes = ? WHERE id = ? AND attempt = ? AND state = 'running'")
      .with(std::string(name_of(outcome.state)))
      .with(outcome.exit)
      .with(outcome.signal)
      .with(outcome.message)
      .with(outcome.finished)
      .with(outcome.result_bytes)
      .with(outcome.result_sha256)
      .with(outcome.bytes)
      .with(id)
      .with(std::int64_t{attempt})
      .run();
}

Job Queue::ask_to_stop(std::int64_t id) {
  const std::lock_guard lock(mutex_);
  Transaction transaction(database_);
  const Job job = job_or_refuse(id);
  if (at_rest(job.state))
    throw Refusal(409, fmt::format("job {} is {}; there is nothing to cancel", id, name_of(job.state)));
  if (job.state == State::queued)
    Statement(
        database_,
        "UPDATE jobs SET state = 'cancelled', finished = ?, message = 'cancelled before it was started' "
        "WHERE id = ?")
        .with(now())
        .with(id)
        .run();
  else
    Statement(database_, "UPDATE jobs SET stop_asked = 1 WHERE id = ?").with(id).run();
  Job changed = job_or_refuse(id);
  transaction.commit();
  return changed;
}

Job Queue::resume(std::int64_t id, const nlohmann::json& work) {
  const std::lock_guard lock(mutex_);
  Transaction transaction(database_);
  const Job job = job_or_refuse(id);
  if (!at_rest(job.state) || job.state == State::done)
    throw Refusal(
        409, fmt::format("job {} is {}; what was cancelled, interrupted or has failed can be resumed", id,
                         name_of(job.state)));
  Statement(database_,
            "UPDATE jobs SET state = 'queued', stop_asked = 0, work = ?, message = '', started = NULL, "
            "finished = NULL, exit = NULL, signal = NULL, result_bytes = 0, result_sha256 = '' WHERE id = ?")
      .with(work.dump())
      .with(id)
      .run();
  Job changed = job_or_refuse(id);
  transaction.commit();
  return changed;
}

void Queue::remove(std::int64_t id) {
  const std::lock_guard lock(mutex_);
  Transaction transaction(database_);
  const Job job = job_or_refuse(id);
  if (!at_rest(job.state))
    throw Refusal(409, fmt::format("job {} is {}; cancel it first", id, name_of(job.state)));
  Statement(database_, "DELETE FROM jobs WHERE id = ?").with(id).run();
  transaction.commit();
}

}  // namespace sweepvi::service
