#include <fmt/format.h>
#include <algorithm>
#include <cstdio>
#include <filesystem>

#include "app/case.hpp"
#include "app/failure.hpp"
#include "app/file_head.hpp"
#include "app/options.hpp"
#include "app/progress.hpp"
#include "app/restart.hpp"
#include "app/summary.hpp"
#include "app/verbs.hpp"
#include "app/watch.hpp"
#include "io/mpi_io_failure.hpp"
#include "io/printable.hpp"
#include "io/problem_file.hpp"
#include "io/recorder.hpp"
#include "sweepvi/time_march.hpp"

namespace sweepvi::app {

namespace {

// Leaves the problem of the failed step beside the output, and says so. @note Collective.
std::string leave_problem(MPI_Comm comm, const std::string& output, TimeMarch& march,
                          const std::string& failure) {
  const ProblemPaths paths(output);
  const std::string trouble = write_problem(comm, paths, march.problem(), failure);
  if (!trouble.empty()) return "Its problem could not be written (" + trouble + ")";
  return fmt::format("Its problem is in {0}: try sweepvi solve {0}", paths.toml);
}

// Rows that a killed run left can still be gone on with; a new run of the same name would overwrite them.
void refuse_interrupted(MPI_Comm comm, const std::string& output, const std::string& checkpoint, bool force) {
  int rank = 0;
  MPI_Comm_rank(comm, &rank);
  agreed(comm, [&] {
    std::error_code failure;
    if (rank == 0 && !force && std::filesystem::exists(checkpoint, failure))
      throw Error(
          ExitCode::output,
          fmt::format("{0} is there: an earlier run for {1} was interrupted. Go on with --restart {0}, "
                      "or begin anew with --force",
                      checkpoint, output));
  });
}

/// A run from its scene to its exit code, and what it leaves for one that goes on.
class Run {
public:
  Run(MPI_Comm comm, const CommandLine& line);
  ExitCode go();

private:
  void open();
  void march();
  void after_step(const Step& step, const StepReport& report);
  void write_checkpoint();
  void remove_checkpoint();
  void end_for_want_of_room();
  std::string what_is_kept() const;
  void conclude();
  void tell() const;

  MPI_Comm comm_;
  const CommandLine& line_;
  double begin_ = MPI_Wtime();
  int rank_ = 0;
  Scene scene_;
  std::string path_;
  std::map<std::string, std::string> fingerprint_;
  std::optional<Restart> restart_;
  std::unique_ptr<Case> model_;
  std::unique_ptr<TimeMarch> march_;
  std::string started_ = timestamp();
  std::optional<Checkpointing> checkpointing_;
  std::unique_ptr<Recorder> recorder_;
  std::optional<Watch> watch_;
  std::unique_ptr<Progress> progress_;
  Summary summary_;
  StepReport report_;
  bool stopped_ = false;
  double recorded_ = 0.0;  // when the last step had been recorded
};

Run::Run(MPI_Comm comm, const CommandLine& line) : comm_(comm), line_(line), scene_(load(comm, line)) {
  MPI_Comm_rank(comm_, &rank_);
  path_ = table_path(comm, line.output.value_or(scene_.output.file));
  check_distinct(comm, {{"the scene", line.scene},
                        {"the output", path_},
                        {"--summary", line.summary.value_or("")},
                        {"--progress", line.progress.value_or("")},
                        {"the problem file of a step that fails", ProblemPaths(path_).toml}});
  fingerprint_ = fingerprint(comm, scene_, line.overrides);
  if (line.restart) {
    restart_.emplace(comm, *line.restart, fingerprint_);
    started_ = restart_->started();
    summary_.steps = restart_->steps_done();
  }
  model_ = make_case(comm, scene_);
  if (restart_) restart_->put_state(*model_);
  const auto done = static_cast<PetscInt>(summary_.steps);
  if (HybridProcess* process = model_->hybrid())
    march_ = std::make_unique<TimeMarch>(*process, HybridOptions{.tolerance = scene_.time.tolerance},
                                         scene_.time.grid(), done);
  else
    march_ = std::make_unique<TimeMarch>(model_->dvi(), scene_.time.grid(), done);
  if (restart_ && model_->hybrid() != nullptr) restart_->put_state(*model_, *march_);
}

// All that can be refused is refused before a file is touched.
void Run::open() {
  checkpointing_.emplace(comm_, path_, fingerprint_, started_);
  if (restart_) {
    restart_->open_rows();
    restart_->put_counts(summary_);
  } else {
    refuse_interrupted(comm_, path_, checkpointing_->path(), line_.force);
  }
  if (line_.summary) check_writable(comm_, *line_.summary, true);
  const OutputSpec& output = scene_.output;
  Recording recording = model_->recording(output);
  if (model_->hybrid() != nullptr) recording.error = [this] { return march_->hybrid_error(); };
  if (restart_) {
    recorder_ = restart_->recorder(path_, line_.force, scene_.time, output.every, model_->dvi(),
                                   std::move(recording));
  } else {
    recorder_ = std::make_unique<Recorder>(path_, line_.force, scene_.time, output.every, model_->dvi(),
                                           std::move(recording));
  }
  try {
    checkpointing_->reserve(checkpointing_->collect(*model_, *march_, *recorder_, summary_));
  } catch (const Error&) {
    recorder_->file().discard();
    throw;
  }
  if (!restart_) remove_checkpoint();  // of an earlier run, whose rows are gone now
  TableFile& file = recorder_->file();
  describe(file, comm_, scene_.title, scene_.text, line_.overrides, started_);
  file.attribute("scheme", name_of(scene_.time.scheme));
  file.attribute("step", scene_.time.step);
  file.attribute("status", "running");
  if (!restart_) return;
  write_checkpoint();
  restart_->release_rows(path_, *recorder_);
}

void Run::write_checkpoint() {
  checkpointing_->write(checkpointing_->collect(*model_, *march_, *recorder_, summary_));
  EndAtMpiIoFailure::say(what_is_kept());
}

std::string Run::what_is_kept() const {
  return ". What was computed up to the last checkpoint is kept: go on with --restart " +
         checkpointing_->path();
}

// It is of no use any more; that it is still there changes nothing of what the run has done.
void Run::remove_checkpoint() {
  try {
    checkpointing_->remove();
  } catch (const Error& error) {
    if (rank_ == 0) std::fprintf(stderr, "sweepvi: warning: %s\n", printable(error.what()).c_str());
  }
}

// There is room for the rows so far and for a checkpoint, and for no more.
void Run::end_for_want_of_room() {
  write_checkpoint();
  agreed(comm_, [&] {
    if (rank_ == 0) throw Error(ExitCode::output, recorder_->file().shortage());
  });
}

void Run::after_step(const Step& step, const StepReport& report) {
  const double solved = MPI_Wtime();
  summary_.steps = step.number;
  summary_.seconds_stepping += solved - recorded_;
  summary_.snes_iterations += report.iterations;
  summary_.predictor_hits += report.predicted ? 1 : 0;
  ++summary_.rungs[static_cast<std::size_t>(report.rung)];
  summary_.most_parts = std::max<std::int64_t>(summary_.most_parts, report.parts);
  summary_.max_residual = std::max(summary_.max_residual, report.residual);
  summary_.max_penetration = std::max(summary_.max_penetration, model_->dvi().penetration());
  int contact_changes = model_->contact_changes() > 0 ? 1 : 0;
  MPI_Allreduce(MPI_IN_PLACE, &contact_changes, 1, MPI_INT, MPI_LOR, comm_);
  summary_.active_changes += contact_changes;
  recorder_->step(step, report, solved - recorded_);
  progress_->show(step.number, step.t_new, summary_.snes_iterations, summary_.max_residual);

  const Watch::Asked asked = watch_->ask();
  if (asked.stop && step.number < scene_.time.steps) {
    stopped_ = true;
    march_->stop();
  } else if (asked.checkpoint) {
    try {
      write_checkpoint();
    } catch (const Error& error) {
      if (error.code() != ExitCode::output || TableFile::damaged() || recorder_->file().lost()) throw;
      if (rank_ == 0)
        std::fprintf(stderr, "sweepvi: no checkpoint at step %lld: %s. The run goes on\n",
                     static_cast<long long>(step.number), printable(error.what()).c_str());
    }
    watch_->checkpoint_written();
  }
  if (!stopped_ && step.number < scene_.time.steps && recorder_->file().short_of_room())
    end_for_want_of_room();
  recorded_ = MPI_Wtime();
}

void Run::march() {
  watch_.emplace(comm_, begin_, line_.wall_limit, scene_.output.checkpoint);
  progress_ = std::make_unique<Progress>(comm_, summary_.steps, scene_.time.steps, line_.progress);
  report_.certified = true;
  stopped_ = summary_.steps < scene_.time.steps && watch_->ask().stop;
  if (stopped_) return;
  march_->observe([this](const Step& step, const StepReport& report) { after_step(step, report); });
  march_->observe_parts([this](const Step& part, const StepReport&) { recorder_->part(part); });
  march_->observe_events([this](const Step& at, const StepReport&) { recorder_->event(at.t_new); });
  recorded_ = MPI_Wtime();
  report_ = march_->run();
  progress_.reset();
}

// Files, then the summary. What is not complete can be gone on with, from the file or from the checkpoint.
void Run::conclude() {
  const bool failed = !report_.certified;
  if (failed && report_.obstacle.empty())
    summary_.max_residual = std::max(summary_.max_residual, report_.residual);
  const bool certifies = march_->solver().certificate().certifies();
  summary_.exit = failed       ? ExitCode::unsolved
                  : stopped_   ? ExitCode::stopped
                  : !certifies ? ExitCode::uncertified
                               : ExitCode::done;
  summary_.status = failed ? "failed" : stopped_ ? "stopped" : !certifies ? "done, not certified" : "done";
  if (model_->hybrid() != nullptr) summary_.hybrid = march_->hybrid_counts();
  summary_.notes = notes_of(scene_.time, summary_);
  CheckpointData goes_on;
  const bool complete = !failed && !stopped_;
  recorder_->abandon();
  if (!complete) {
    goes_on = checkpointing_->collect(*model_, *march_, *recorder_, summary_);
    checkpointing_->write(goes_on);
    goes_on.facts["rows"]["file"] = recorder_->file().name();
  }
  recorder_->file().attribute("status", summary_.status);
  recorder_->file().attribute("finished", timestamp());
  recorder_->file().attribute("notes", lines_of(summary_.notes));
  if (!complete)
    recorder_->file().embed("/checkpoint", rank_ == 0 ? encode(goes_on) : std::vector<std::byte>());
  recorder_->finish();
  if (complete)
    remove_checkpoint();
  else
    checkpointing_->write(goes_on);
  summary_.time_matmult(march_->solver().jacobian());
  summary_.mumps_flops = march_->solver().mumps_flops();
  summary_.unused_options = report_unused_options(comm_);
  summary_.seconds_total = MPI_Wtime() - begin_;
  summary_.write(comm_, line_.summary);
}

void Run::tell() const {
  if (rank_ != 0) return;
  fmt::print("{}: {} {} of {:.6g} s, {} unknowns ({}), {} constraint{}, {:.3g} s\n", printable(path_),
             summary_.steps, summary_.hybrid ? "intervals" : "steps", scene_.time.step, summary_.unknowns,
             model_->form(), summary_.constraints, summary_.constraints == 1 ? "" : "s",
             summary_.seconds_total);
  if (summary_.hybrid)
    fmt::print("tolerance {:.2g}: {} events, {} Taylor series of {:.1f} terms, estimated error {:.2g}\n",
               scene_.time.tolerance, summary_.hybrid->events, summary_.hybrid->expansions,
               static_cast<double>(summary_.hybrid->coefficients) /
                   static_cast<double>(std::max<std::int64_t>(1, summary_.hybrid->expansions)),
               summary_.hybrid->error);
  fmt::print("worst certificate ratio {:.2g}, worst penetration {:.2g}, {} Newton iterations\n",
             summary_.max_residual, summary_.max_penetration, summary_.snes_iterations);
  for (const Note& note : summary_.notes)
    fmt::print("note: {}\n", printable(note.text));
}

ExitCode Run::go() {
  if (line_.help_requested) return ExitCode::done;  // the objects have printed their options
  open();
  if (rank_ == 0)
    for (const Note& note : notes_before(scene_.time))
      std::fprintf(stderr, "sweepvi: warning: %s\n", note.text.c_str());
  summary_.constraints = model_->constraints();
  summary_.edge_cut = model_->edge_cut();
  summary_.describe(march_->solver());
  summary_.seconds_setup = MPI_Wtime() - begin_;
  try {
    march();
    conclude();
  } catch (const Error& error) {
    std::error_code failure;
    if (error.code() != ExitCode::output || !std::filesystem::exists(checkpointing_->path(), failure)) throw;
    throw Error(ExitCode::output, error.what() + what_is_kept());
  }
  tell();
  if (!report_.certified) {
    const std::string failure = failure_text(*march_, report_);
    if (summary_.hybrid && !report_.obstacle.empty())  // no step's problem
      throw Error(ExitCode::unsolved, failure + ". Everything before it is in the output");
    const std::string problem = leave_problem(comm_, path_, *march_, failure);
    const bool hopeless = !report_.obstacle.empty();
    throw Error(
        ExitCode::unsolved,
        fmt::format(
            "{}. Everything before it is in the output. {}{}", failure, problem,
            hopeless ? "" : ". Or try a smaller time.step, or -snes_vi_monitor to watch the active set"));
  }
  if (stopped_)
    throw Error(ExitCode::stopped,
                fmt::format("stopped by {} after step {} of {}, t = {:.6g} s. Go on with --restart {}",
                            watch_->reason(), summary_.steps, scene_.time.steps, march_->time(), path_));
  if (summary_.exit == ExitCode::uncertified)
    throw Error(summary_.exit, why_uncertified(march_->solver().certificate()));
  return ExitCode::done;
}

}  // namespace

ExitCode run(MPI_Comm comm, const CommandLine& line) {
  return Run(comm, line).go();
}

}  // namespace sweepvi::app
