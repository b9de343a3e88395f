#include <fmt/format.h>

#include <map>
#include <set>
#include <stdexcept>

#include "io/output_file.hpp"
#include "service/child.hpp"
#include "service/launcher.hpp"

namespace sweepvi::service {

namespace {

constexpr double asking_interval = 2.0;  // s between questions to Slurm about the same attempt

std::string first_line(const std::string& text) {
  return text.substr(0, text.find('\n'));
}

std::string trimmed(const std::string& text) {
  const std::size_t first = text.find_first_not_of(" \t\n");
  return first == std::string::npos ? "" : text.substr(first, text.find_last_not_of(" \t\n") - first + 1);
}

/// For a shell script.
std::string quoted(const std::string& text) {
  std::string result = "'";
  for (const char c : text)
    result += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return result + "'";
}

// Everything is asked by the job's name, which says queue, job and attempt: no number that Slurm gives has to
// be kept, and none can be lost.
class SlurmLauncher : public Launcher {
public:
  SlurmLauncher(const Settings& settings, std::string queue)
      : settings_(settings), queue_(std::move(queue)) {}

  void launch(const Attempt& attempt, const Job& job) override {
    const std::filesystem::path script = attempt.folder() / "slurm.sh";
    write_output(script, fmt::format("#!/bin/sh\nexec {} supervise {}\n", quoted(own_path().string()),
                                     quoted(attempt.folder().string())));
    std::vector<std::string> words = {"sbatch", "--parsable", "--no-requeue", "--job-name=" + name(job),
                                      fmt::format("--ntasks={}", job.request.ranks),
                                      "--output=" + (attempt.folder() / "slurm.log").string(),
                                      // before Slurm's own limit: time for a checkpoint
                                      "--signal=B:USR1@60"};
    const Order order = attempt.order();
    if (order.seconds > 0.0) {
      const double minutes = (order.seconds + 3.0 * order.grace) / 60.0;
      words.push_back(fmt::format("--time={}", static_cast<std::int64_t>(minutes) + 2));
    }
    constexpr std::int64_t megabyte = 1 << 20;
    if (const std::int64_t memory = job.request.work.value("memory", std::int64_t{0}); memory > 0)
      words.push_back(fmt::format("--mem-per-cpu={}M", std::max<std::int64_t>(1, memory / megabyte)));
    words.insert(words.end(), settings_.launcher_words.begin(), settings_.launcher_words.end());
    words.push_back(script.string());
    const ChildResult result = ask(words);
    if (result.code != 0) throw std::runtime_error("sbatch: " + trimmed(result.err));
    asked_[attempt.folder()] = ticks();
    launched_.insert(attempt.folder());
  }

  Whereabouts poll(const Attempt& attempt, const Job& job) override {
    using Kind = Whereabouts::Kind;
    if (attempt.ending()) return {Kind::ended, {}};
    double& asked = asked_[attempt.folder()];
    if (ticks() - asked < asking_interval) return {Kind::under_way, {}};
    asked = ticks();
    const ChildResult waiting = ask({"squeue", "--noheader", "--format=%T", "--name=" + name(job)});
    if (waiting.code != 0 || !trimmed(waiting.out).empty()) return {Kind::under_way, {}};
    if (attempt.ending()) return {Kind::ended, {}};
    // Slurm knows of none (any more), and a script that comes late finds the attempt claimed.
    const std::string said = account(job);
    if (attempt.claimed()) return {Kind::lost, said};
    if (!attempt.claim()) return {Kind::under_way, {}};
    const bool was_there = launched_.contains(attempt.folder()) || !said.empty();
    return {Kind::never_began, was_there ? trimmed("it left Slurm's queue before it began. " + said) : ""};
  }

  void stop(const Attempt& attempt, const Job& job) override {
    // The supervisor passes the signal on; a script that waits in Slurm's queue can go at once.
    ask(attempt.claimed()
            ? std::vector<std::string>{"scancel", "--batch", "--signal=USR1", "--name=" + name(job)}
            : std::vector<std::string>{"scancel", "--state=PENDING", "--name=" + name(job)});
  }

  std::string describe() const override {
    return fmt::format("at most {} cores of a cluster, by Slurm", settings_.cores);
  }

private:
  std::string name(const Job& job) const {
    return fmt::format("sweepvi-{}-{}-{}", queue_, job.id, job.attempt);
  }

  static ChildResult ask(const std::vector<std::string>& words) {
    return run_child(words, "/", {.seconds = 30});
  }

  /// What Slurm's accounting says of the end; empty where there is none.
  std::string account(const Job& job) const {
    const ChildResult result = ask({"sacct", "--noheader", "--allocations", "--parsable2",
                                    "--format=State,ExitCode", "--name=" + name(job)});
    const std::string line = trimmed(first_line(result.out));
    return result.code != 0 || line.empty() ? "" : "Slurm says " + line;
  }

  const Settings& settings_;
  std::string queue_;
  std::map<std::filesystem::path, double> asked_;
  std::set<std::filesystem::path> launched_;
};

}  // namespace

std::unique_ptr<Launcher> make_slurm_launcher(const Settings& settings, const std::string& queue) {
  return std::make_unique<SlurmLauncher>(settings, queue);
}

}  // namespace sweepvi::service
