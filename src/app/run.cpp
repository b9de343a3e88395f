#include <fmt/format.h>
#include <algorithm>

#include "app/case.hpp"
#include "app/file_head.hpp"
#include "app/options.hpp"
#include "app/progress.hpp"
#include "app/summary.hpp"
#include "app/verbs.hpp"
#include "io/recorder.hpp"
#include "sweepvi/time_march.hpp"

namespace sweepvi::app {

namespace {

std::string failure_text(const TimeMarch& march, const StepReport& report) {
  const PetscInt number = march.steps_taken() + 1;
  const double t = march.grid().time(number);
  if (!report.obstacle.empty())
    return fmt::format("step {}, t = {:.6g} s: {}. Everything before it is in the output", number, t,
                       report.obstacle);
  return fmt::format(
      "step {}, t = {:.6g} s: the step could not be certified: {} after {} iterations in {} attempts, "
      "residual {:.3g} of "
      "the row terms (asked for {:.3g}). Everything before it is in the output. Try a smaller time.step, or "
      "-snes_vi_monitor to watch the active set",
      number, t, report.reason, report.iterations, report.attempts, report.residual,
      march.solver().certificate().rtol);
}

}  // namespace

ExitCode run(MPI_Comm comm, const CommandLine& line) {
  const double begin = MPI_Wtime();
  const std::string started = timestamp();
  int rank = 0;
  MPI_Comm_rank(comm, &rank);
  Scene scene = load(comm, line);
  const TimeSpec& time = scene.time;
  const std::string path = line.output.value_or(scene.output.file);
  check_distinct(comm,
                 {{"the scene", line.scene}, {"the output", path}, {"--summary", line.summary.value_or("")}});

  const auto model = make_case(comm, scene);
  const Dvi& dvi = model->dvi();
  TimeMarch march(model->dvi(), time.grid());
  if (line.help_requested) return ExitCode::done;  // the objects have printed their options

  if (line.summary) check_writable(comm, *line.summary, true);
  Recorder recorder(path, line.force, time, scene.output.every, dvi, model->recording(scene.output));
  describe(recorder.file(), comm, scene.title, scene.text, line.overrides, started);
  recorder.file().attribute("scheme", name_of(time.scheme));
  recorder.file().attribute("step", time.step);
  recorder.file().attribute("status", "running");

  Summary summary;
  summary.constraints = model->constraints();
  summary.edge_cut = model->edge_cut();
  summary.count_jacobian(march.solver().jacobian());
  SNESType snes_type = nullptr;
  check(SNESGetType(march.solver().snes(), &snes_type));
  summary.snes_type = snes_type;
  summary.max_penetration = 0.0;
  summary.seconds_setup = MPI_Wtime() - begin;

  StepReport report;
  std::optional<Error> trouble;
  {
    Progress progress(comm, time.steps);
    const double stepping = MPI_Wtime();
    double last = stepping;
    double recording = 0.0;
    march.observe([&](const Step& step, const StepReport& step_report) {
      const double solved = MPI_Wtime();
      summary.snes_iterations += step_report.iterations;
      summary.predictor_hits += step_report.predicted ? 1 : 0;
      ++summary.rungs[static_cast<std::size_t>(step_report.rung)];
      summary.max_residual = std::max(summary.max_residual, step_report.residual);
      summary.max_penetration = std::max(summary.max_penetration, dvi.penetration());
      int contact_changes = model->contact_changed() ? 1 : 0;
      MPI_Allreduce(MPI_IN_PLACE, &contact_changes, 1, MPI_INT, MPI_LOR, comm);
      summary.active_changes += contact_changes;
      recorder.step(step, step_report, solved - last);
      last = MPI_Wtime();
      recording += last - solved;
      progress.show(step.number, step.t_new, summary.snes_iterations);
    });
    try {
      report = march.run();
    } catch (const Error& error) {
      if (error.code() != ExitCode::output || TableFile::damaged()) throw;
      trouble = error;  // all ranks know; what is in the file stays
    }
    summary.seconds_stepping = MPI_Wtime() - stepping - recording;
  }
  summary.steps = march.steps_taken();
  if (trouble) throw *trouble;

  const bool failed = !report.certified;
  if (failed && report.obstacle.empty())
    summary.max_residual = std::max(summary.max_residual, report.residual);
  summary.exit = failed ? ExitCode::unsolved : ExitCode::done;
  summary.status = failed ? "failed" : "done";
  recorder.file().attribute("status", summary.status);
  recorder.file().attribute("finished", timestamp());
  recorder.finish();
  summary.time_matmult(march.solver().jacobian());
  summary.unused_options = report_unused_options(comm);
  summary.seconds_total = MPI_Wtime() - begin;
  summary.write(comm, line.summary);

  if (rank == 0) {
    fmt::print("{}: {} steps of {:.6g} s, {} unknowns ({}), {} constraint{}, {:.3g} s\n", path, summary.steps,
               time.step, summary.unknowns, model->form(), summary.constraints,
               summary.constraints == 1 ? "" : "s", summary.seconds_total);
    fmt::print("worst certificate ratio {:.2g}, worst penetration {:.2g}, {} Newton iterations\n",
               summary.max_residual, summary.max_penetration, summary.snes_iterations);
  }
  if (failed) throw Error(ExitCode::unsolved, failure_text(march, report));
  return ExitCode::done;
}

}  // namespace sweepvi::app
