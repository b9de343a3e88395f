#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <nlohmann/json.hpp>

#include "app/comparison.hpp"
#include "app/file_head.hpp"
#include "app/options.hpp"
#include "app/ready_run.hpp"
#include "app/study_plan.hpp"
#include "app/study_table.hpp"
#include "app/summary.hpp"
#include "app/verbs.hpp"
#include "io/printable.hpp"

namespace sweepvi::app {

namespace {

constexpr double reference_tolerance = 1e-12;
constexpr double reference_refinement = 10.0;
constexpr double log_interval = 5.0;  // s

std::optional<double> to_step(const std::string& text) {
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  if (end == text.c_str() || *end != '\0') return std::nullopt;
  if (!(value > 0.0) || !std::isfinite(value))
    throw InputError(fmt::format("--reference {}: a step is above 0", text));
  return value;
}

/// A scene run with one step after the other, and so on.
class Study {
public:
  Study(MPI_Comm comm, const CommandLine& line) : comm_(comm), line_(line) {
    MPI_Comm_rank(comm_, &rank_);
    MPI_Comm_size(comm_, &ranks_);
  }
  ExitCode go();

private:
  void check_all();
  void check_one(const StudyRun& run);
  void find_reference();
  bool refer_to(const StudyRun& run, const std::string& name);
  std::vector<StudyRow> run_all();
  StudyRow run_one(const StudyRun& run);
  void say(std::size_t number, const StudyRun& run);
  void write(const std::vector<StudyRow>& rows, std::size_t failed, std::size_t loose);

  MPI_Comm comm_;
  const CommandLine& line_;
  int rank_ = 0, ranks_ = 1;
  double begin_ = MPI_Wtime(), said_ = MPI_Wtime();
  StudyPlan plan_;
  OptionsRead read_;
  std::optional<Recorded> reference_;
  std::string reference_name_;
  double reference_largest_ = 0.0;
  std::string failure_;  // of the last run meant to be the reference
};

void Study::check_one(const StudyRun& run) {
  const ReadyRun ready(comm_, line_, run, read_);
  const Recorded outline = ready.outline();
  if (reference_) check_alike(outline, *reference_);
}

// Nothing runs before all that can be refused has been: each scheme with each step and each setting.
void Study::check_all() {
  const bool from_file = line_.reference && !to_step(*line_.reference);
  for (const std::optional<std::string>& made : {line_.csv, line_.summary}) {
    if (!made) continue;
    check_distinct(comm_, {{"the scene", line_.scene},
                           {"the settings", line_.settings.value_or("")},
                           {"the reference", from_file ? *line_.reference : ""},
                           {made == line_.csv ? "--csv" : "--summary", *made}});
    check_writable(comm_, *made, true);
  }
  if (line_.csv && line_.summary)
    check_distinct(comm_, {{"--csv", *line_.csv}, {"--summary", *line_.summary}});
  if (from_file) {
    reference_ = read_recorded(comm_, *line_.reference, line_.components);
    reference_name_ = fmt::format("{}, {} rows", *line_.reference, reference_->trajectory->rows());
  }
  const StudyRun* last = nullptr;
  std::string first_setting;
  for (const StudyRun& run : plan_.runs) {
    const bool new_scheme = last == nullptr || last->scheme != run.scheme;
    if (new_scheme) first_setting = run.setting.name;
    const bool new_setting = new_scheme || last->setting.name != run.setting.name;
    if (new_setting || run.setting.name == first_setting) check_one(run);
    last = &run;
  }
}

// The trajectory of a run becomes the reference; false, and why, if it cannot.
bool Study::refer_to(const StudyRun& run, const std::string& name) {
  RunResult result;
  try {
    ReadyRun ready(comm_, line_, run, read_);
    const Recorded room = ready.outline();
    result = ready.go(true);
    failure_ = result.failure;
    reference_name_ = fmt::format("{}, h = {:.6g} s", name, ready.time().step);
  } catch (const Error& error) {
    if (error.code() != ExitCode::bad_input) throw;
    failure_ = error.what();
  }
  if (!failure_.empty()) return false;
  reference_ = std::move(result.kept);
  return true;
}

void Study::find_reference() {
  if (reference_) return;
  const Setting ours{"default", "", {}, {}};
  const std::string hybrid = name_of(Scheme::hybrid);
  std::optional<double> step = line_.reference ? to_step(*line_.reference) : std::nullopt;
  std::string instead;
  if (!step) {
    // Its rows lie as close as those of any run, and there are two at each of its events.
    if (refer_to({hybrid, plan_.finest, reference_tolerance, ours},
                 fmt::format("hybrid, tolerance {:g}", reference_tolerance)))
      return;
    instead = fmt::format(" (not hybrid: {})", failure_);
    step = plan_.finest / reference_refinement;
  }
  if (!refer_to({plan_.scheme, *step, {}, ours}, plan_.scheme))
    throw Error(ExitCode::unsolved, fmt::format("there is no reference: {} with h = {:g} s failed: {}{}",
                                                plan_.scheme, *step, failure_, instead));
  reference_name_ += instead;
}

// A line every few seconds.
void Study::say(std::size_t number, const StudyRun& run) {
  if (rank_ != 0 || MPI_Wtime() - said_ < log_interval) return;
  said_ = MPI_Wtime();
  std::fprintf(stderr, "run %zu of %zu: %s, %g s, %s\n", number, plan_.runs.size(), run.scheme.c_str(),
               run.step, printable(run.setting.name).c_str());
}

StudyRow Study::run_one(const StudyRun& run) {
  StudyRow row;
  row.run = run;
  const int repeats = line_.repeats.value_or(3);
  std::vector<double> seconds;
  double matmult = 0.0;
  std::optional<Recorded> kept;
  for (int i = 0; i < repeats && row.failure.empty(); ++i) {
    ReadyRun ready(comm_, line_, run, read_);
    RunResult result = ready.go(i == 0);
    row.h = ready.time().step;
    if (run.scheme == name_of(Scheme::hybrid)) row.tolerance = ready.time().tolerance;
    row.failure = result.failure;
    row.certified = ready.march().solver().certificate().certifies();
    seconds.push_back(result.seconds);
    if (i > 0) continue;
    kept = std::move(result.kept);
    matmult = result.matmult_seconds;
    row.steps = result.steps;
    row.steps_in_parts = result.parted;
    row.linear_solves = result.linear_solves;
    row.newton_iterations = result.newton_iterations;
  }
  if (!row.failure.empty()) return row;
  std::sort(seconds.begin(), seconds.end());
  const std::size_t half = seconds.size() / 2;
  row.seconds = seconds.size() % 2 == 1 ? seconds[half] : 0.5 * (seconds[half - 1] + seconds[half]);
  row.seconds_min = seconds.front();
  row.seconds_max = seconds.back();
  row.matmults_per_step = row.seconds / static_cast<double>(row.steps) / matmult;
  const double largest = std::max(reference_largest_, largest_entry(comm_, *kept->trajectory));
  row.found = measure(comm_, *kept, *reference_, largest, {});
  return row;
}

std::vector<StudyRow> Study::run_all() {
  std::vector<StudyRow> rows;
  for (const StudyRun& run : plan_.runs) {
    say(rows.size() + 1, run);
    rows.push_back(run_one(run));
  }
  find_orders(rows);
  return rows;
}

void Study::write(const std::vector<StudyRow>& rows, std::size_t failed, std::size_t loose) {
  give_back(read_);
  const std::vector<std::string> unused = report_unused_options(comm_);
  const std::size_t components = reference_->trajectory->components();
  if (line_.csv) write_text(comm_, *line_.csv, csv_text(rows));
  if (line_.summary) {
    nlohmann::ordered_json json;
    json["exit"] = static_cast<int>(failed > 0  ? ExitCode::unsolved
                                    : loose > 0 ? ExitCode::uncertified
                                                : ExitCode::done);
    json["status"] = failed > 0 ? "failed" : loose > 0 ? "done, not certified" : "done";
    json["scene"] = line_.scene;
    json["reference"] = reference_name_;
    json["components"] = components;
    json["ranks"] = ranks_;
    json["repeats"] = line_.repeats.value_or(3);
    json["runs"] = nlohmann::ordered_json::parse(rows_json(rows));
    json["seconds_total"] = MPI_Wtime() - begin_;
    json["unused_options"] = unused;
    write_text(comm_, *line_.summary, json.dump(2) + "\n");
  }
  if (rank_ != 0) return;
  fmt::print("{}: {} of {} components, {} rank{}, times of {} repeat{}\n", printable(line_.scene), components,
             reference_->columns, ranks_, ranks_ == 1 ? "" : "s", line_.repeats.value_or(3),
             line_.repeats.value_or(3) == 1 ? "" : "s");
  fmt::print("reference: {}\n\n{}", printable(reference_name_), table_text(rows, plan_.several_settings));
}

ExitCode Study::go() {
  plan_ = make_plan(comm_, line_);
  if (line_.help_requested) {  // the objects print their options
    const ReadyRun ready(comm_, line_, plan_.runs.front(), read_);
    return ExitCode::done;
  }
  check_all();
  find_reference();
  reference_largest_ = largest_entry(comm_, *reference_->trajectory);
  const std::vector<StudyRow> rows = run_all();
  const auto failed = static_cast<std::size_t>(
      std::count_if(rows.begin(), rows.end(), [](const StudyRow& row) { return !row.failure.empty(); }));
  const auto loose = static_cast<std::size_t>(
      std::count_if(rows.begin(), rows.end(), [](const StudyRow& row) { return !row.certified; }));
  write(rows, failed, loose);
  if (failed > 0)
    throw Error(ExitCode::unsolved,
                fmt::format("{} of {} runs failed; the table says why", failed, rows.size()));
  if (loose > 0)
    throw Error(
        ExitCode::uncertified,
        fmt::format("{} of {} runs are done, but not certified: -sweepvi_certificate_rtol is above {:.0e}",
                    loose, rows.size(), CertificateOptions::loosest));
  return ExitCode::done;
}

}  // namespace

ExitCode study(MPI_Comm comm, const CommandLine& line) {
  return Study(comm, line).go();
}

}  // namespace sweepvi::app
