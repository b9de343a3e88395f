#include <fmt/format.h>

#include "app/case.hpp"
#include "app/options.hpp"
#include "app/summary.hpp"
#include "app/verbs.hpp"
#include "sweepvi/time_march.hpp"

namespace sweepvi::app {

ExitCode check_scene(MPI_Comm comm, const CommandLine& line) {
  Scene scene = load(comm, line);
  const auto model = make_case(comm, scene);
  const TimeSpec& time = scene.time;
  const TimeMarch march(model->dvi(), time.grid());  // reads what options there are
  if (line.help_requested) return ExitCode::done;
  report_unused_options(comm);
  Summary counts;
  counts.count_jacobian(march.solver().jacobian());
  const Lines lines = model->report(counts.unknowns);
  int rank = 0;
  int ranks = 1;
  MPI_Comm_rank(comm, &rank);
  MPI_Comm_size(comm, &ranks);
  if (rank != 0) return ExitCode::done;

  const auto row = [](const std::string& name, const std::string& text) {
    fmt::print("{:<20} {}\n", name, text);
  };
  const auto nonzeros = static_cast<double>(counts.jacobian_nonzeros);
  const auto unknowns = static_cast<double>(counts.unknowns);
  row("scene", line.scene + (scene.title.empty() ? "" : " (" + scene.title + ")"));
  row("steps", fmt::format("{} of {:.9g} s from {:.9g} s to {:.9g} s, scheme {}", time.steps, time.step,
                           time.start, time.end, name_of(time.scheme)));
  for (const auto& [name, text] : lines)
    row(name, text);
  row("Jacobian nonzeros",
      fmt::format("{} ({:.3g} per unknown)", counts.jacobian_nonzeros, nonzeros / unknowns));
  if (ranks > 1) row("edge cut", fmt::format("{} couplings between {} ranks", model->edge_cut(), ranks));
  // K, |K|, the Jacobian, its reduced copy: 12 B an entry; about 30 vectors; the factor is a guess for
  // chain-like fill.
  const double matrices = 4.0 * 12.0 * nonzeros;
  const double vectors = 30.0 * 8.0 * unknowns;
  const double factor = 5.0 * 12.0 * nonzeros;
  row("memory estimate",
      fmt::format(
          "{:.3g} MB over all ranks, and about {:.3g} MB for the factorization (chains; more on lattices)",
          (matrices + vectors) / 1e6, factor / 1e6));
  return ExitCode::done;
}

}  // namespace sweepvi::app
