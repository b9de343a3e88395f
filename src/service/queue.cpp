#include "service/queue.hpp"

#include <fmt/format.h>

#include <array>

#include "service/files.hpp"
#include "service/refusal.hpp"

namespace sweepvi::service {

namespace {

constexpr std::int64_t version = 3;

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
  result_sha256 TEXT NOT NULL DEFAULT '',
  folder TEXT NOT NULL DEFAULT '',
  owner TEXT NOT NULL DEFAULT ''))";
constexpr const char* order = "CREATE INDEX IF NOT EXISTS waiting ON jobs (state, priority DESC, id)";

// Columns that databases of earlier versions may lack. Version 1 named folders by the number of the job.
struct Column {
  const char* name;
  const char* type;
};
constexpr std::array later_columns = {Column{"key", "TEXT"},
                                      Column{"digest", "TEXT NOT NULL DEFAULT ''"},
                                      Column{"report", "TEXT NOT NULL DEFAULT ''"},
                                      Column{"bytes", "INTEGER NOT NULL DEFAULT 0"},
                                      Column{"submitted", "REAL NOT NULL DEFAULT 0"},
                                      Column{"started", "REAL"},
                                      Column{"finished", "REAL"},
                                      Column{"attempt", "INTEGER NOT NULL DEFAULT 0"},
                                      Column{"stop_asked", "INTEGER NOT NULL DEFAULT 0"},
                                      Column{"exit", "INTEGER"},
                                      Column{"signal", "INTEGER"},
                                      Column{"message", "TEXT NOT NULL DEFAULT ''"},
                                      Column{"result_bytes", "INTEGER NOT NULL DEFAULT 0"},
                                      Column{"result_sha256", "TEXT NOT NULL DEFAULT ''"},
                                      Column{"folder", "TEXT NOT NULL DEFAULT ''"},
                                      Column{"owner", "TEXT NOT NULL DEFAULT ''"}};
constexpr std::array first_columns = {"id", "state", "title", "ranks", "priority", "work"};

constexpr const char* columns =
    "SELECT id, state, title, ranks, priority, work, key, digest, report, bytes, submitted, started, "
    "finished, attempt, stop_asked, exit, signal, message, result_bytes, result_sha256, folder, owner FROM "
    "jobs ";

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
                 nlohmann::json::parse(row.text(5), nullptr, false),
                 row.text(6),
                 row.text(7),
                 row.text(8),
                 row.integer(9),
                 row.text(21)};
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
  job.folder = row.text(20);
  return job;
}

/// What nobody but a stranger can have put there.
std::string damage_in(const Job& job, const std::string& state) {
  constexpr int most_ranks = 1000000;
  constexpr double latest = 1e11;  // s since 1970: what calendars can tell
  if (!state_named(state)) return "its state is unknown";
  if (job.request.ranks < 1 || job.request.ranks > most_ranks) return "it has no number of ranks";
  if (job.attempt < 0) return "its attempts are fewer than none";
  for (const double time : {job.submitted, job.started.value_or(0.0), job.finished.value_or(0.0)})
    if (!(time >= 0.0) || time > latest) return "it has a time that no clock shows";
  if (!is_folder_name(job.folder)) return "its folder has no name that a folder has";
  const bool digest = job.result_sha256.empty() ||
                      (job.result_sha256.size() == 64 &&
                       job.result_sha256.find_first_not_of("0123456789abcdef") == std::string::npos);
  return digest ? complaint_about(job.request.work) : "its result has no digest";
}

}  // namespace

bool is_folder_name(const std::string& name) {
  constexpr std::size_t longest = 64;
  return !name.empty() && name.size() <= longest &&
         name.find_first_not_of("0123456789abcdefghijklmnopqrstuvwxyz-") == std::string::npos;
}

Queue::Queue(const std::string& path, const std::string& name) : database_(path) {
  const std::int64_t found = database_.number("PRAGMA user_version");
  if (found > version)
    throw UsageError(
        fmt::format("{}: made by a later version of sweepvi (its schema is {}, this one knows {}); "
                    "use that version, or choose another --data",
                    path, found, version));
  if (!database_.has_table("jobs") && database_.number("SELECT count(*) FROM sqlite_master") > 0)
    throw UsageError(path + ": a database of something else; choose another --data");
  migrate();
  Transaction transaction(database_);
  {
    Statement row(database_, "SELECT name FROM queue");
    if (row.step()) name_ = row.text(0);
  }
  if (!name_.empty()) return;
  name_ = name;
  database_.run("DELETE FROM queue");
  Statement(database_, "INSERT INTO queue VALUES (?)").with(name_).run();
  transaction.commit();
}

void Queue::migrate() {
  Transaction transaction(database_);
  database_.run(tables);
  for (const char* column : first_columns)
    if (!database_.has_column("jobs", column))
      throw UsageError(
          fmt::format("the queue's jobs have no column '{}': a database of something else; choose "
                      "another --data",
                      column));
  for (const Column& column : later_columns)
    if (!database_.has_column("jobs", column.name))
      database_.run(fmt::format("ALTER TABLE jobs ADD COLUMN {} {}", column.name, column.type));
  database_.run("CREATE UNIQUE INDEX IF NOT EXISTS by_key ON jobs (key)");
  database_.run(order);
  database_.run("CREATE TABLE IF NOT EXISTS queue (name TEXT NOT NULL)");
  database_.run("UPDATE jobs SET folder = CAST(id AS TEXT) WHERE folder = ''");
  database_.run(fmt::format("PRAGMA user_version = {}", version));
  transaction.commit();
}

std::vector<Queue::Row> Queue::rows_in(const std::filesystem::path& path) {
  const Database database(path.string());
  if (const std::int64_t found = database.number("PRAGMA user_version"); found != version)
    throw UsageError(fmt::format("its schema is {}, this version works with {}", found, version));
  std::vector<Row> found;
  Statement rows(database, columns);
  while (rows.step()) {
    Job job = read_job(rows);
    std::string damage = damage_in(job, rows.text(1));
    found.push_back({std::move(job), std::move(damage)});
  }
  return found;
}

std::optional<std::string> Queue::name_in(const std::filesystem::path& path) {
  try {
    const Database database(path, Database::Use::look);
    for (const char* column : first_columns)
      if (!database.has_column("jobs", column)) return std::nullopt;
    if (!database.has_table("queue")) return std::nullopt;
    Statement row(database, "SELECT name FROM queue");
    return row.step() ? row.text(0) : "";
  } catch (const DatabaseError&) {
    return std::nullopt;
  }
}

std::optional<Job> Queue::read(const Statement& row) const {
  Job job = read_job(row);
  const std::string damage = damage_in(job, row.text(1));
  if (damage.empty()) return job;
  if (damaged_.insert(job.id).second)
    log_line(fmt::format("the row of job {} in the queue is damaged: {}; it is left alone", job.id, damage));
  return std::nullopt;
}

std::vector<Job> Queue::read_all(Statement& rows) const {
  std::vector<Job> jobs;
  while (rows.step())
    if (std::optional<Job> job = read(rows)) jobs.push_back(std::move(*job));
  return jobs;
}

std::optional<Job> Queue::with_key(const std::string& key, const std::string& digest) const {
  const std::lock_guard lock(mutex_);
  Statement row(database_, fmt::format("{} WHERE key = ?", columns));
  row.with(key);
  if (key.empty() || !row.step()) return std::nullopt;
  std::optional<Job> job = read(row);
  if (!job || job->request.digest != digest)
    throw Refusal(409, fmt::format("the idempotency key '{}' belongs to job {}, which is another request",
                                   key, row.integer(0)));
  return job;
}

Queue::Added Queue::add(const Request& request, const std::string& folder, std::int64_t most,
                        const std::function<void(const Job& job)>& prepare) {
  if (std::optional<Job> known = with_key(request.key, request.digest)) return {std::move(*known), false};
  std::unique_lock lock(mutex_);
  Transaction transaction(database_);
  if (database_.number("SELECT count(*) FROM jobs") >= most)
    throw Refusal(429, fmt::format("there are {} jobs already; delete some first", most));
  Statement(
      database_,
      "INSERT INTO jobs (state, title, ranks, priority, work, key, digest, report, bytes, submitted, folder, "
      "owner) VALUES ('queued', ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?) ON CONFLICT (key) DO NOTHING")
      .with(request.title)
      .with(std::int64_t{request.ranks})
      .with(std::int64_t{request.priority})
      .with(request.work.dump())
      .with(request.key.empty() ? std::optional<std::string>() : std::optional(request.key))
      .with(request.digest)
      .with(request.report)
      .with(request.bytes)
      .with(now())
      .with(folder)
      .with(request.owner)
      .run();
  if (database_.changes() == 0) {  // the same request came twice at once
    transaction.commit();
    lock.unlock();
    return {with_key(request.key, request.digest).value(), false};
  }
  Job job = job_or_refuse(database_.last_id());
  prepare(job);
  transaction.commit();
  return {std::move(job), true};
}

bool Queue::restore(const Job& job) {
  const std::lock_guard lock(mutex_);
  Transaction transaction(database_);
  {
    Statement row(database_, fmt::format("{} WHERE id = ?", columns));
    row.with(job.id);
    if (row.step() && read(row)) return false;
  }
  Statement(database_, "DELETE FROM jobs WHERE id = ?").with(job.id).run();
  Statement(
      database_,
      "INSERT INTO jobs (id, state, title, ranks, priority, work, key, digest, report, bytes, submitted, "
      "started, attempt, folder, owner) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?) "
      "ON CONFLICT (key) DO NOTHING")
      .with(job.id)
      .with(std::string(name_of(job.state)))
      .with(job.request.title)
      .with(std::int64_t{job.request.ranks})
      .with(std::int64_t{job.request.priority})
      .with(job.request.work.dump())
      .with(job.request.key.empty() ? std::optional<std::string>() : std::optional(job.request.key))
      .with(job.request.digest)
      .with(job.request.report)
      .with(job.request.bytes)
      .with(job.submitted)
      .with(job.started)
      .with(std::int64_t{job.attempt})
      .with(job.folder)
      .with(job.request.owner)
      .run();
  if (database_.changes() == 0) return false;
  damaged_.erase(job.id);
  transaction.commit();
  return true;
}

Job Queue::job_or_refuse(std::int64_t id) const {
  Statement row(database_, fmt::format("{} WHERE id = ?", columns));
  row.with(id);
  if (!row.step()) throw Refusal(404, fmt::format("there is no job {}", id));
  std::optional<Job> job = read(row);
  if (!job)
    throw Refusal(500,
                  fmt::format("the row of job {} in the queue is damaged; the daemon's log says more", id));
  return std::move(*job);
}

std::optional<Job> Queue::find(std::int64_t id) const {
  const std::lock_guard lock(mutex_);
  try {
    return job_or_refuse(id);
  } catch (const Refusal& refusal) {
    if (refusal.status() == 404) return std::nullopt;
    throw;
  }
}

std::vector<Job> Queue::list(const Selection& wanted, std::int64_t most) const {
  const std::lock_guard lock(mutex_);
  Statement rows(database_, fmt::format("{} WHERE (?1 = 0 OR id < ?1) AND (?2 = '' OR state = ?2) AND "
                                        "(?3 IS NULL OR owner = ?3) ORDER BY id DESC LIMIT ?4",
                                        columns));
  rows.with(wanted.before)
      .with(std::string(wanted.state ? name_of(*wanted.state) : ""))
      .with(wanted.owner)
      .with(most);
  return read_all(rows);
}

std::vector<Job> Queue::running() const {
  const std::lock_guard lock(mutex_);
  Statement rows(database_, fmt::format("{} WHERE state = 'running' ORDER BY id", columns));
  return read_all(rows);
}

std::optional<Job> Queue::next() const {
  const std::lock_guard lock(mutex_);
  Statement rows(database_, fmt::format("{} WHERE state = 'queued' ORDER BY priority DESC, id", columns));
  while (rows.step())
    if (std::optional<Job> job = read(rows)) return job;
  return std::nullopt;
}

std::map<State, std::int64_t> Queue::counts(const std::optional<std::string>& owner) const {
  const std::lock_guard lock(mutex_);
  std::map<State, std::int64_t> counts;
  for (const State state :
       {State::queued, State::running, State::done, State::failed, State::cancelled, State::interrupted})
    counts[state] = 0;
  Statement rows(database_, "SELECT state, count(*) FROM jobs WHERE ?1 IS NULL OR owner = ?1 GROUP BY state");
  rows.with(owner);
  while (rows.step())
    if (const std::optional<State> state = state_named(rows.text(0))) counts[*state] = rows.integer(1);
  return counts;
}

std::int64_t Queue::bytes_kept() const {
  const std::lock_guard lock(mutex_);
  return database_.number("SELECT coalesce(sum(max(bytes, 0)), 0) FROM jobs WHERE state <> 'running'");
}

Queue::Kept Queue::kept_by(const std::string& owner) const {
  const std::lock_guard lock(mutex_);
  Statement row(database_, "SELECT count(*), coalesce(sum(max(bytes, 0)), 0) FROM jobs WHERE owner = ?");
  row.with(owner);
  row.step();
  return {row.integer(0), row.integer(1)};
}

std::map<std::string, Queue::Owner> Queue::owners() const {
  const std::lock_guard lock(mutex_);
  std::map<std::string, Owner> owners;
  Statement rows(database_, columns);
  while (rows.step()) {
    const bool whole = read(rows).has_value();
    constexpr int folder = 20;
    owners[rows.text(folder)] = {rows.integer(0), !whole};
  }
  return owners;
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
  try {
    const Job job = job_or_refuse(id);
    if (!at_rest(job.state))
      throw Refusal(409, fmt::format("job {} is {}; cancel it first", id, name_of(job.state)));
  } catch (const Refusal& refusal) {
    if (refusal.status() != 500) throw;  // a damaged row is in nobody's way, and of no use
  }
  Statement(database_, "DELETE FROM jobs WHERE id = ?").with(id).run();
  transaction.commit();
}

std::string Queue::folder_of(std::int64_t id) const {
  const std::lock_guard lock(mutex_);
  Statement row(database_, "SELECT folder FROM jobs WHERE id = ?");
  row.with(id);
  if (!row.step()) throw Refusal(404, fmt::format("there is no job {}", id));
  const std::string name = row.text(0);
  return is_folder_name(name) ? name : "";
}

void Queue::say(std::int64_t id, const std::string& message) {
  const std::lock_guard lock(mutex_);
  Statement(database_, "UPDATE jobs SET message = ?1 WHERE id = ?2 AND state = 'queued' AND message <> ?1")
      .with(message)
      .with(id)
      .run();
}

}  // namespace sweepvi::service
