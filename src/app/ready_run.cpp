#include "app/ready_run.hpp"

#include <algorithm>
#include <limits>

#include "app/failure.hpp"
#include "app/summary.hpp"
#include "io/kept_run.hpp"
#include "parallel/memory.hpp"

namespace sweepvi::app {

namespace {

Scene load(MPI_Comm comm, const CommandLine& line, const StudyRun& run, OptionsScope& options) {
  const CommandLine one = line_of(line, run);
  Scene scene = app::load(comm, one);
  options.insert(one, run.setting.options);
  return scene;
}

}  // namespace

ReadyRun::ReadyRun(MPI_Comm comm, const CommandLine& line, const StudyRun& run, OptionsRead& read)
    : comm_(comm),
      line_(line),
      options_(read),
      scene_(load(comm, line, run, options_)),
      case_(make_case(comm, scene_)) {
  if (HybridProcess* process = case_->hybrid())
    march_ = std::make_unique<TimeMarch>(*process, HybridOptions{.tolerance = scene_.time.tolerance},
                                         scene_.time.grid());
  else
    march_ = std::make_unique<TimeMarch>(case_->dvi(), scene_.time.grid());
}

Recorded ReadyRun::outline() const {
  KeptRun outline(comm_, line_.scene, case_->recording(scene_.output), line_.components);
  const double entries = static_cast<double>(scene_.time.steps + 1) * static_cast<double>(outline.width());
  // Its rows are gathered from all ranks once it is done.
  require_memory(comm_, 3.0 * 8.0 * entries, line_.scene + ": the rows of a run take");
  if (entries > static_cast<double>(std::numeric_limits<int>::max()))
    throw InputError(line_.scene +
                     ": a run has more numbers than can be gathered at once; choose fewer "
                     "--components or a larger step");
  outline.row(scene_.time.start);
  outline.row(scene_.time.end);
  return outline.take(line_.scene);
}

std::pair<std::vector<double>, std::vector<PetscInt>> ReadyRun::states() const {
  const Recording recording = case_->recording({});
  const auto x = std::find_if(recording.quantities.begin(), recording.quantities.end(),
                              [](const Quantity& quantity) { return quantity.name == "/x"; });
  std::vector<double> values(x->positions.size());
  x->read(values.data());
  return {std::move(values), x->positions};
}

RunResult ReadyRun::go(bool keep) {
  RunResult result;
  std::optional<KeptRun> kept;
  if (keep) {
    kept.emplace(comm_, line_.scene, case_->recording(scene_.output), line_.components);
    kept->row(scene_.time.start);
  }
  double keeping = 0.0;
  const auto put = [&](double t, bool row, bool events) {
    if (!kept) return;
    const double begin = MPI_Wtime();
    if (events) kept->events(t);
    if (row) kept->row(t);
    keeping += MPI_Wtime() - begin;
  };
  march_->observe([&](const Step& step, const StepReport& report) {
    ++result.steps;
    result.parted += report.parts > 1 ? 1 : 0;
    result.newton_iterations += report.iterations;
    put(step.t_new, true, true);
  });
  march_->observe_parts([&](const Step& part, const StepReport&) { put(part.t_new, false, true); });
  march_->observe_events([&](const Step& at, const StepReport&) { put(at.t_new, true, false); });

  const std::int64_t solves = linear_solves();
  MPI_Barrier(comm_);
  const double begin = MPI_Wtime();
  StepReport report;
  try {
    report = march_->run();
  } catch (const Error& error) {
    if (error.code() == ExitCode::internal) throw;
    result.failure = error.what();
    return result;
  }
  result.seconds = MPI_Wtime() - begin - keeping;
  if (!report.certified) {
    result.failure = failure_text(*march_, report);
    return result;
  }
  MPI_Allreduce(MPI_IN_PLACE, &result.seconds, 1, MPI_DOUBLE, MPI_MAX, comm_);
  result.linear_solves = linear_solves() - solves;
  if (case_->hybrid() != nullptr) result.steps = march_->hybrid_counts().expansions;
  if (!keep) return result;
  Summary unit;
  unit.time_matmult(march_->solver().jacobian());
  result.matmult_seconds = unit.matmult_seconds;
  result.kept = kept->take(line_.scene);
  return result;
}

}  // namespace sweepvi::app
