#include <fmt/format.h>
#include <malloc.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>

#include "app/bench_table.hpp"
#include "app/failure.hpp"
#include "app/file_head.hpp"
#include "app/options.hpp"
#include "app/ready_run.hpp"
#include "app/summary.hpp"
#include "app/verbs.hpp"
#include "app/versions.hpp"
#include "io/printable.hpp"

namespace sweepvi::app {

namespace {

constexpr double log_interval = 5.0;  // s

/// Resident memory of this process, now and at its peak, as Linux counts it [B].
struct Resident {
  std::int64_t now = 0, peak = 0;

  static Resident read() {
    Resident found;
    std::ifstream file("/proc/self/status");
    for (std::string line; std::getline(file, line);) {
      if (line.starts_with("VmRSS:")) found.now = 1024 * std::stoll(line.substr(6));
      if (line.starts_with("VmHWM:")) found.peak = 1024 * std::stoll(line.substr(6));
    }
    return found;
  }

  /// Gives back what earlier runs have freed, and begins a new peak.
  static Resident restart() {
    malloc_trim(0);
    std::ofstream("/proc/self/clear_refs") << "5";
    return read();
  }
};

/// Times the steps of a scene, with one setting or with several in turn.
class Bench {
public:
  Bench(MPI_Comm comm, const CommandLine& line)
      : comm_(comm),
        line_(line),
        warmup_(line.warmup.value_or(3)),
        count_(line.count.value_or(20)),
        rounds_(line.repeats.value_or(line.settings ? 3 : 1)) {
    MPI_Comm_rank(comm_, &rank_);
    MPI_Comm_size(comm_, &ranks_);
  }
  ExitCode go();

private:
  using States = std::pair<std::vector<double>, std::vector<PetscInt>>;

  void plan();
  void check_all();
  void check_length(const TimeSpec& time) const;
  void time_one(BenchRow& row, bool first);
  void take_steps(BenchRow& row, ReadyRun& ready, bool first, double begin);
  bool out_of_time(double begin);
  double step(BenchRow& row, ReadyRun& ready);
  void compare(BenchRow& row, const States& states);
  void say(int round, const BenchRow& row);
  void write(ExitCode code);

  MPI_Comm comm_;
  const CommandLine& line_;
  int warmup_, count_, rounds_;
  int rank_ = 0, ranks_ = 1;
  double begin_ = MPI_Wtime(), said_ = MPI_Wtime();
  OptionsRead read_;
  std::vector<BenchRow> rows_;
  std::optional<States> states_;  // of the first setting, in the end
  std::size_t states_steps_ = 0;
  std::int64_t changes_ = 0;  // of contacts, in the present step
};

void Bench::plan() {
  const Scene scene = read_scene(comm_, line_.scene, line_.overrides);
  if (scene.time.scheme == Scheme::hybrid)
    throw InputError(
        "the scheme hybrid goes from event to event and has no steps to time; use 'sweepvi study', or "
        "another "
        "time.scheme");
  const std::vector<Setting> settings =
      line_.settings ? read_settings(comm_, *line_.settings) : std::vector<Setting>{{"default", "", {}, {}}};
  for (const Setting& setting : settings) {
    if (!fits(setting, name_of(scene.time.scheme))) continue;
    rows_.emplace_back();
    rows_.back().setting = setting;
  }
  if (rows_.empty())
    throw InputError(
        fmt::format("no setting of --settings goes with the scheme {}", name_of(scene.time.scheme)));
}

void Bench::check_length(const TimeSpec& time) const {
  const std::int64_t needed = std::int64_t{warmup_} + count_;
  if (needed > time.steps)
    throw InputError(fmt::format(
        "{}: the scene has {} steps; --warmup {} and --count {} need {}. Take fewer, or --set time.end={:g}",
        line_.scene, time.steps, warmup_, count_, needed,
        time.start + time.step * static_cast<double>(needed)));
}

// Nothing runs before all that can be refused has been.
void Bench::check_all() {
  if (line_.summary) {
    check_distinct(comm_, {{"the scene", line_.scene},
                           {"the settings", line_.settings.value_or("")},
                           {"--summary", *line_.summary}});
    check_writable(comm_, *line_.summary, true);
  }
  for (const BenchRow& row : rows_)
    if (rows_.size() > 1) check_length(ReadyRun(comm_, line_, {{}, 0.0, {}, row.setting}, read_).time());
}

// Rank 0's clock decides.
bool Bench::out_of_time(double begin) {
  int late = line_.wall_limit && MPI_Wtime() - begin > *line_.wall_limit ? 1 : 0;
  if (line_.wall_limit) MPI_Bcast(&late, 1, MPI_INT, 0, comm_);
  return late != 0;
}

// Seconds of the next step, of the slowest rank; a failure is noted in the row.
double Bench::step(BenchRow& row, ReadyRun& ready) {
  changes_ = 0;
  MPI_Barrier(comm_);
  double seconds = MPI_Wtime();
  const StepReport report = ready.march().step();
  seconds = MPI_Wtime() - seconds;
  MPI_Allreduce(MPI_IN_PLACE, &seconds, 1, MPI_DOUBLE, MPI_MAX, comm_);
  if (!report.certified) {
    row.failure = failure_text(ready.march(), report);
    return seconds;
  }
  changes_ += ready.model().contact_changes();
  MPI_Allreduce(MPI_IN_PLACE, &changes_, 1, MPI_INT64_T, MPI_SUM, comm_);
  row.worst_ratio = std::max(row.worst_ratio, report.residual);
  row.newton_iterations += report.iterations;
  row.predictor_hits += report.predicted ? 1 : 0;
  ++row.rungs[static_cast<std::size_t>(report.rung)];
  return seconds;
}

void Bench::take_steps(BenchRow& row, ReadyRun& ready, bool first, double begin) {
  BenchRow unused;  // counts of steps that do not count
  const double warm = MPI_Wtime();
  for (int i = 0; i < warmup_ && unused.failure.empty() && !row.stopped; ++i) {
    row.stopped = out_of_time(begin);
    if (!row.stopped) step(unused, ready);
  }
  row.failure = unused.failure;
  if (!row.failure.empty() || row.stopped) return;
  row.warmup.push_back(MPI_Wtime() - warm);

  const std::int64_t solves = linear_solves(), factored = factorizations();
  BenchRow& counts = first ? row : unused;
  std::int64_t closed = 0;
  for (int i = 0; i < count_; ++i) {
    row.stopped = out_of_time(begin);
    if (row.stopped) break;
    const double seconds = step(counts, ready);
    row.failure = counts.failure;
    if (!row.failure.empty()) return;
    row.seconds.push_back(seconds);
    counts.changes.push_back(changes_);
    counts.penetration = std::max(counts.penetration, ready.model().dvi().penetration());
    closed += ready.model().dvi().active();
  }
  MPI_Allreduce(MPI_IN_PLACE, &closed, 1, MPI_INT64_T, MPI_SUM, comm_);
  counts.linear_solves = linear_solves() - solves;
  counts.factorizations = factorizations() - factored;
  counts.mumps_flops = ready.march().solver().mumps_flops();
  counts.contacts =
      static_cast<double>(closed) / static_cast<double>(std::max<std::size_t>(1, counts.steps()));
  Summary unit;
  unit.time_matmult(ready.march().solver().jacobian());
  row.matmult.push_back(unit.matmult_seconds);
  if (first) compare(row, ready.states());
}

// The last states against those of the first setting, if it took the same steps.
void Bench::compare(BenchRow& row, const States& states) {
  if (&row == &rows_.front()) {
    states_ = states;
    states_steps_ = row.steps();
    return;
  }
  int alike = states_ && states_steps_ == row.steps() && states_->second == states.second ? 1 : 0;
  MPI_Allreduce(MPI_IN_PLACE, &alike, 1, MPI_INT, MPI_LAND, comm_);
  if (alike == 0) return;
  double largest[2] = {0.0, 0.0};  // difference, state
  for (std::size_t i = 0; i < states.first.size(); ++i) {
    largest[0] = std::max(largest[0], std::abs(states.first[i] - states_->first[i]));
    largest[1] = std::max(largest[1], std::abs(states_->first[i]));
  }
  MPI_Allreduce(MPI_IN_PLACE, largest, 2, MPI_DOUBLE, MPI_MAX, comm_);
  row.difference = largest[1] > 0.0 ? largest[0] / largest[1] : largest[0];
}

void Bench::time_one(BenchRow& row, bool first) {
  const double begin = MPI_Wtime();
  const Resident before = rows_.size() > 1 ? Resident::restart() : Resident::read();
  ReadyRun ready(comm_, line_, {{}, 0.0, {}, row.setting}, read_);
  check_length(ready.time());
  row.certified = ready.march().solver().certificate().certifies();
  row.setup.push_back(MPI_Wtime() - begin);
  if (first) {
    Summary sizes;
    sizes.describe(ready.march().solver());
    row.unknowns = sizes.unknowns;
    row.jacobian_nonzeros = sizes.jacobian_nonzeros;
    row.constraints = ready.model().constraints();
    row.edge_cut = ready.model().edge_cut();
    row.form = ready.model().form();
    row.h = ready.time().step;
    row.snes_type = sizes.snes_type;
    row.predictor = sizes.predictor;
  }
  // A step taken in parts: its last part is counted as any step is.
  ready.march().observe_parts(
      [&](const Step&, const StepReport&) { changes_ += ready.model().contact_changes(); });
  try {
    take_steps(row, ready, first, begin);
  } catch (const Error& error) {
    if (error.code() == ExitCode::internal) throw;
    row.failure = error.what();
  }
  if (!first) return;
  const std::int64_t peak = Resident::read().peak;
  std::int64_t all = peak - before.now;
  MPI_Allreduce(MPI_IN_PLACE, &all, 1, MPI_INT64_T, MPI_SUM, comm_);
  MPI_Allreduce(&peak, &row.peak_rss_bytes, 1, MPI_INT64_T, MPI_MAX, comm_);
  row.bytes_per_unknown = static_cast<double>(all) / static_cast<double>(row.unknowns);
}

// A line every few seconds.
void Bench::say(int round, const BenchRow& row) {
  if (rank_ != 0 || MPI_Wtime() - said_ < log_interval) return;
  said_ = MPI_Wtime();
  std::fprintf(stderr, "round %d of %d: %s\n", round + 1, rounds_, printable(row.setting.name).c_str());
}

void Bench::write(ExitCode code) {
  give_back(read_);
  const std::vector<std::string> unused = report_unused_options(comm_);
  if (line_.summary) {
    nlohmann::ordered_json json;
    json["exit"] = static_cast<int>(code);
    json["scene"] = line_.scene;
    json["ranks"] = ranks_;
    json["blas"] = blas_description();
    json["warmup"] = warmup_;
    json["count"] = count_;
    json["repeats"] = rounds_;
    json.update(nlohmann::ordered_json::parse(row_json(rows_.front())));
    if (line_.settings)
      for (const BenchRow& row : rows_)
        json["runs"].push_back(nlohmann::ordered_json::parse(row_json(row)));
    json["seconds_total"] = MPI_Wtime() - begin_;
    json["unused_options"] = unused;
    write_text(comm_, *line_.summary, json.dump(2) + "\n");
  }
  if (rank_ != 0) return;
  const BenchRow& row = rows_.front();
  fmt::print("{}: {} unknowns ({}), {} constraint{}, {} rank{}\nBLAS {}\n", printable(line_.scene),
             row.unknowns, row.form, row.constraints, row.constraints == 1 ? "" : "s", ranks_,
             ranks_ == 1 ? "" : "s", blas_description());
  fmt::print("{} steps of {:.6g} s to warm up, {} to time, {} round{}\n\n{}", warmup_, row.h, count_, rounds_,
             rounds_ == 1 ? "" : "s", table_text(rows_));
}

ExitCode Bench::go() {
  plan();
  if (line_.help_requested) {  // the objects print their options
    const ReadyRun ready(comm_, line_, {{}, 0.0, {}, rows_.front().setting}, read_);
    return ExitCode::done;
  }
  check_all();
  for (int round = 0; round < rounds_; ++round)
    for (BenchRow& row : rows_) {
      if (!row.failure.empty() || row.stopped) continue;  // it would be again
      say(round, row);
      time_one(row, round == 0);
    }
  const auto count = [&](auto&& holds) { return std::count_if(rows_.begin(), rows_.end(), holds); };
  const auto failed = count([](const BenchRow& row) { return !row.failure.empty(); });
  const auto stopped = count([](const BenchRow& row) { return row.stopped; });
  const auto loose = count([](const BenchRow& row) { return !row.certified; });
  const ExitCode code = failed > 0    ? ExitCode::unsolved
                        : stopped > 0 ? ExitCode::stopped
                        : loose > 0   ? ExitCode::uncertified
                                      : ExitCode::done;
  write(code);
  if (failed > 0)
    throw Error(code, rows_.size() == 1 ? rows_.front().failure
                                        : fmt::format("{} of {} settings failed; the table says why", failed,
                                                      rows_.size()));
  if (stopped > 0)
    throw Error(code, fmt::format("stopped by --wall-limit {:g}; the numbers are of the steps before it",
                                  *line_.wall_limit));
  if (loose > 0)
    throw Error(
        code, fmt::format("{} of {} settings are done, but not certified: -sweepvi_certificate_rtol is above "
                          "{:.0e}",
                          loose, rows_.size(), CertificateOptions::loosest));
  return code;
}

}  // namespace

ExitCode bench(MPI_Comm comm, const CommandLine& line) {
  return Bench(comm, line).go();
}

}  // namespace sweepvi::app
