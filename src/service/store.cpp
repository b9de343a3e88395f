#include "service/store.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <sstream>
#include <system_error>

#include "io/output_file.hpp"
#include "io/printable.hpp"
#include "service/digest.hpp"
#include "service/queue.hpp"
#include "service/refusal.hpp"

namespace sweepvi::service {

namespace fs = std::filesystem;

namespace {

constexpr const char* marker = "sweepvi-data";
constexpr const char* unfinished = "unfinished";
constexpr const char* notes_file = "job.json";

std::string marker_text(const std::string& queue) {
  return "A data folder of sweepvi serve, layout 2\nqueue " + queue + "\n";
}

/// Nobody else may change what is in it, or the jobs were theirs.
void check_owner(const fs::path& folder) {
  struct stat about {};
  if (stat(folder.c_str(), &about) != 0)
    throw UsageError(fmt::format("--data {}: {}", folder.string(), std::strerror(errno)));
  if (!S_ISDIR(about.st_mode)) throw UsageError(fmt::format("--data {}: it is no folder", folder.string()));
  if (about.st_uid != geteuid() || (about.st_mode & 022U) != 0)
    throw UsageError(
        fmt::format("--data {}: others may write there, or it is not yours; chmod go-w it, or choose another",
                    folder.string()));
}

/// The second word of its second line.
std::string queue_in(const std::string& text) {
  std::istringstream lines(text);
  std::string line;
  std::getline(lines, line);
  std::string word;
  std::string name;
  lines >> word >> name;
  const bool good = word == "queue" && is_folder_name(name);
  return good ? name : random_hex(4);
}

}  // namespace

Store::Store(fs::path folder) : folder_(std::move(folder)) {
  umask(077);
  adopt();
  lock_ = Descriptor(open((folder_ / "lock").c_str(), O_WRONLY | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600));
  if (!lock_) throw std::system_error(errno, std::generic_category(), (folder_ / "lock").string());
  if (flock(lock_.get(), LOCK_EX | LOCK_NB) != 0)
    throw UsageError(fmt::format("{}: another daemon works here; choose another --data", folder_.string()));
  fs::create_directories(folder_ / "jobs");
  std::error_code none;
  // Version 1 kept here what was coming in; nobody was promised anything of it.
  if (fs::exists(folder_ / "incoming", none) && !fs::remove(folder_ / "incoming", none))
    set_aside(folder_ / "incoming");
}

void Store::adopt() {
  if (!fs::exists(folder_)) fs::create_directories(folder_);  // for this user only, by our umask
  check_owner(folder_);
  if (const std::optional<std::string> text = read_file(folder_ / marker)) {
    queue_name_ = queue_in(*text);
    return;
  }
  // A daemon of version 1 left no marker, but a queue; and an empty folder is nobody's.
  const std::optional<std::string> queue = Queue::name_in(folder_ / "queue.db");
  if (!queue && !fs::is_empty(folder_))
    throw UsageError(
        fmt::format("--data {0}: the folder has files, and none that says it is a data folder ({0}/{1}); "
                    "choose an empty one, "
                    "or one that is not there",
                    folder_.string(), marker));
  queue_name_ = queue.value_or("");
  if (queue_name_.empty()) queue_name_ = random_hex(4);
  write_output(folder_ / marker, marker_text(queue_name_));
}

std::string Store::receive() const {
  std::string name = random_hex(16);
  fs::create_directory(folder(name));
  const Descriptor mark(open((folder(name) / unfinished).c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0600));
  if (mark) return name;
  const int error = errno;
  discard(name);
  throw std::system_error(error, std::generic_category(), folder(name).string());
}

void Store::note(const Job& job) const {
  write_output(this->job(job) / notes_file, notes_of(job));
  sync_below(this->job(job));
  sync_folder(folder_ / "jobs");
}

void Store::promise(const std::string& name) const noexcept {
  unlink((folder(name) / unfinished).c_str());
}

void Store::take_back(const std::string& name) const {
  const Descriptor mark(open((folder(name) / unfinished).c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0600));
  // A folder that is gone brings nothing back.
  if (!mark && errno != ENOENT)
    throw std::system_error(errno, std::generic_category(), folder(name).string());
}

bool Store::promised(const std::string& name) const {
  std::error_code none;
  return access((folder(name) / unfinished).c_str(), F_OK) != 0 && !fs::is_empty(folder(name), none);
}

// The mark goes last: what is left where something cannot be removed, or who does it is killed, is no job.
void Store::discard(const std::string& name) const noexcept {
  std::error_code failure;
  bool all = true;
  for (fs::directory_iterator at(folder(name), failure), end; !failure && at != end; at.increment(failure)) {
    if (at->path().filename() == unfinished) continue;
    std::error_code kept;
    fs::remove_all(at->path(), kept);
    all = all && !kept;
  }
  if (all && !failure) fs::remove_all(folder(name), failure);
}

std::vector<std::string> Store::names() const {
  std::vector<std::string> names;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder_ / "jobs"))
    names.push_back(entry.path().filename());
  std::sort(names.begin(), names.end());
  return names;
}

fs::path Store::set_aside(const fs::path& path) const {
  fs::create_directories(folder_ / "quarantine");
  fs::path there = folder_ / "quarantine" / (path.filename().string() + "-" + random_hex(4));
  fs::rename(path, there);
  return there;
}

fs::path sound_queue(const Store& store) {
  fs::path path = store.queue();
  std::error_code none;
  const bool missing = !fs::exists(path, none);
  const std::string damage = missing ? "" : Database::damage(path);
  if (!missing && damage.empty()) return path;
  // SQLite takes the log of a database that is gone for one of the next.
  for (const char* part : {"", "-wal", "-shm"})
    if (const fs::path file = path.string() + part; fs::exists(file, none))
      log_line(fmt::format("{} is damaged or left behind ({}); it is now {}", file.string(),
                           damage.empty() ? "its database is missing" : printable(damage),
                           store.set_aside(file).string()));
  return path;
}

namespace {

/// The number of its last attempt; 0: none.
int last_attempt(const fs::path& folder) {
  int last = 0;
  std::error_code none;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, none)) {
    int number = 0;
    if (std::sscanf(entry.path().filename().c_str(), "attempt-%d", &number) == 1)
      last = std::max(last, number);
  }
  return last;
}

// What became of its last attempt is for the scheduler to find out, as of any that runs.
bool restore(const Store& store, Queue& queue, const std::string& name) {
  if (!is_folder_name(name)) return false;
  std::optional<Job> job = job_in_notes(read_file(store.folder(name) / notes_file).value_or(""));
  if (!job) return false;
  job->folder = name;
  job->attempt = last_attempt(store.folder(name));
  job->state = job->attempt > 0 ? State::running : State::queued;
  if (job->attempt > 0) job->started = now();
  job->request.bytes = size_below(store.folder(name));
  return queue.restore(*job);
}

}  // namespace

void take_up(const Store& store, Queue& queue) {
  std::map<std::string, Queue::Owner> owners = queue.owners();
  for (const std::string& name : store.names()) {
    const auto owner = owners.find(name);
    const bool known = owner != owners.end() && !owner->second.damaged;
    if (known) {
      store.promise(name);
    } else if (!store.promised(name)) {
      store.discard(name);
    } else if (restore(store, queue, name)) {
      log_line(
          fmt::format("jobs/{} is of a job that the queue did not know; it is back in it", printable(name)));
    } else if (owner == owners.end()) {
      log_line(fmt::format("jobs/{} belongs to no job; it is now {}", printable(name),
                           printable(store.set_aside(store.folder(name)).string())));
    }
  }
}

}  // namespace sweepvi::service
