#include "service/fsck.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>

#include <cstdio>
#include <cstdlib>
#include <map>
#include <system_error>

#include "io/printable.hpp"
#include "service/arguments.hpp"
#include "service/digest.hpp"
#include "service/queue.hpp"
#include "service/refusal.hpp"
#include "service/settings.hpp"
#include "service/store.hpp"
#include "service/work.hpp"

namespace sweepvi::service {

namespace fs = std::filesystem;

namespace {

const std::vector<Option>& options() {
  static const std::vector<Option> entries = {
      {"--data", "FOLDER", "what to look at (default: as of serve)"},
      {"--mend", "", "first do what a daemon does when it starts; nothing that was promised is deleted"},
      {"--help", "", "this text"}};
  return entries;
}

/// A folder that goes with this object.
class Temporary {
public:
  Temporary() {
    std::string path = (fs::temp_directory_path() / "sweepvi-XXXXXX").string();
    if (mkdtemp(path.data()) == nullptr) throw std::system_error(errno, std::generic_category(), path);
    path_ = path;
  }
  ~Temporary() {
    std::error_code failure;
    fs::remove_all(path_, failure);
  }
  Temporary(const Temporary&) = delete;
  Temporary& operator=(const Temporary&) = delete;
  const fs::path& path() const { return path_; }

private:
  fs::path path_;
};

class Examination {
public:
  explicit Examination(fs::path folder) : folder_(std::move(folder)) {}

  /// Prints what is wrong. @return how many things
  int run() {
    look_at_queue();
    look_at_folders();
    fmt::print("{}: {} jobs, {} folders, {} in quarantine: {}\n", printable(folder_.string()), jobs_.size(),
               names_.size(), in_quarantine(),
               found_ == 0 ? "nothing is wrong" : fmt::format("{} things are wrong", found_));
    return found_;
  }

private:
  void tell(const std::string& text) {
    ++found_;
    fmt::print("{}\n", printable(text));
  }

  // Of a copy: SQLite writes beside a database that it only reads.
  void look_at_queue() {
    const fs::path queue = folder_ / "queue.db";
    std::error_code none;
    if (!fs::exists(queue, none)) {
      tell("queue.db is missing");
      return;
    }
    const Temporary temporary;
    for (const char* part : {"", "-wal"})
      if (fs::exists(queue.string() + part, none))
        fs::copy_file(queue.string() + part, (temporary.path() / "queue.db").string() + part);
    const fs::path copy = temporary.path() / "queue.db";
    if (const std::string damage = Database::damage(copy); !damage.empty()) {
      tell("queue.db is damaged: " + damage);
      return;
    }
    try {
      for (Queue::Row& row : Queue::rows_in(copy)) {
        if (!row.damage.empty())
          tell(fmt::format("job {}: its row in the queue is damaged: {}", row.job.id, row.damage));
        jobs_[row.job.folder] = std::move(row);
      }
      knows_jobs_ = true;
    } catch (const std::exception& error) {
      tell(std::string("queue.db: ") + error.what());
    }
  }

  void look_at_folders() {
    std::error_code none;
    for (const fs::directory_entry& entry : fs::directory_iterator(folder_ / "jobs", none))
      names_.push_back(entry.path().filename());
    for (const auto& [name, row] : jobs_) {
      if (!row.damage.empty()) continue;
      if (fs::is_directory(folder_ / "jobs" / name, none))
        look_at_job(row.job, folder_ / "jobs" / name);
      else
        tell(fmt::format("job {}: its folder jobs/{} is gone", row.job.id, name));
    }
    for (const std::string& name : names_)
      if (knows_jobs_ && !jobs_.contains(name)) look_at_stray(name);
  }

  void look_at_job(const Job& job, const fs::path& folder) {
    if (!notes_in(folder))
      tell(fmt::format(
          "job {}: jobs/{} has no notes that can be read; were the queue lost, it would not come back",
          job.id, job.folder));
    if (job.attempt > 0 && at_rest(job.state)) {
      const Attempt attempt(folder / ("attempt-" + std::to_string(job.attempt)));
      std::error_code none;
      if (fs::exists(attempt.folder() / "ending.json", none) && !attempt.ending())
        tell(
            fmt::format("job {}: what is kept of the end of attempt {} cannot be read", job.id, job.attempt));
      const fs::path scratch = fs::read_symlink(attempt.folder() / "scratch", none);
      if (!none && fs::exists(scratch, none))
        tell(fmt::format("job {}: files of MPI were left in {}", job.id, scratch.string()));
    }
    if (job.result_sha256.empty()) return;
    const fs::path result = folder / result_file(job);
    std::error_code gone;
    const std::uintmax_t bytes = fs::file_size(result, gone);
    if (gone)
      tell(fmt::format("job {}: its result is gone", job.id));
    else if (bytes != static_cast<std::uintmax_t>(job.result_bytes))
      tell(fmt::format("job {}: its result has {} bytes; {} were written", job.id, bytes, job.result_bytes));
    else if (digest_of_file(result) != job.result_sha256)
      tell(fmt::format("job {}: its result is not what was written (SHA-256)", job.id));
  }

  void look_at_stray(const std::string& name) {
    const fs::path folder = folder_ / "jobs" / name;
    std::error_code none;
    if (fs::exists(folder / "unfinished", none) || fs::is_empty(folder, none))
      tell(fmt::format("jobs/{} was promised to nobody", name));
    else if (is_folder_name(name) && notes_in(folder))
      tell(fmt::format("jobs/{} is of a job that the queue does not know", name));
    else
      tell(fmt::format("jobs/{} belongs to no job", name));
  }

  static bool notes_in(const fs::path& folder) {
    return job_in_notes(read_file(folder / "job.json").value_or("")).has_value();
  }

  std::size_t in_quarantine() const {
    std::error_code none;
    const fs::directory_iterator entries(folder_ / "quarantine", none);
    return none ? 0 : static_cast<std::size_t>(std::distance(begin(entries), end(entries)));
  }

  fs::path folder_;
  std::map<std::string, Queue::Row> jobs_;  // by their folders
  bool knows_jobs_ = false;
  std::vector<std::string> names_;
  int found_ = 0;
};

}  // namespace

int act_as_fsck(const std::vector<std::string>& words) {
  const Arguments given("fsck", words, options(), 0);
  if (given.has("--help")) {
    std::fputs(("Usage: sweepvi fsck [--data FOLDER] [--mend]\n\nsay what is wrong with a data folder of "
                "sweepvi serve, in "
                "which no daemon works; exit 2 if something is\n\n" +
                option_table(options()))
                   .c_str(),
               stdout);
    return 0;
  }
  const fs::path folder = given.has("--data") ? fs::absolute(given.get("--data")) : default_data();
  std::error_code none;
  if (!fs::exists(folder / "sweepvi-data", none))
    throw UsageError(
        fmt::format("--data {}: it is no data folder of sweepvi serve, of this layout", folder.string()));
  if (given.has("--mend")) {
    const Store store(folder);
    Queue queue(sound_queue(store).string(), store.queue_name());
    take_up(store, queue);
    return Examination(folder).run() == 0 ? 0 : 2;
  }
  const Descriptor lock(open((folder / "lock").c_str(), O_RDONLY | O_CLOEXEC));
  if (lock && flock(lock.get(), LOCK_SH | LOCK_NB) != 0)
    throw UsageError(fmt::format("{}: a daemon works here; stop it first", folder.string()));
  return Examination(folder).run() == 0 ? 0 : 2;
}

}  // namespace sweepvi::service
