#include <fmt/format.h>

#include "app/case.hpp"
#include "app/options.hpp"
#include "app/room.hpp"
#include "app/summary.hpp"
#include "app/verbs.hpp"
#include "io/printable.hpp"
#include "io/toml_table.hpp"
#include "parallel/memory.hpp"
#include "sweepvi/time_march.hpp"

namespace sweepvi::app {

namespace {

void print_row(const std::string& name, const std::string& text) {
  fmt::print("{:<20} {}\n", name, printable_lines(text));
}

/// Whether the document is one for `solve`; what cannot be read is left to those who complain about it.
bool is_problem(MPI_Comm comm, const CommandLine& line) {
  const std::string text = read_shared_text(comm, line.scene);
  bool found = false;
  agreed(comm, [&] {
    const TomlValue document = TomlValue::parse(line.scene, text, {}, false);
    found = document["problem"] && !document["model"] && !document["time"];
  });
  return found;
}

ExitCode check_problem(MPI_Comm comm, const CommandLine& line) {
  if (!line.overrides.empty()) throw InputError("--set changes scenes; " + line.scene + " is a problem");
  const Problem problem = read_problem(comm, line.scene);
  int rank = 0;
  MPI_Comm_rank(comm, &rank);
  if (rank != 0) return ExitCode::done;
  print_row("problem", line.scene);
  print_row("unknowns", fmt::format("{}", problem.M.rows));
  print_row("nonzeros of M", fmt::format("{}", problem.M.values.size()));
  return ExitCode::done;
}

}  // namespace

ExitCode check_scene(MPI_Comm comm, const CommandLine& line) {
  if (is_problem(comm, line)) return check_problem(comm, line);
  Scene scene = load(comm, line);
  const auto model = make_case(comm, scene);
  const TimeSpec& time = scene.time;
  TimeMarch march(model->dvi(), time.grid());  // reads what options there are
  if (line.help_requested) return ExitCode::done;
  report_unused_options(comm);
  Summary counts;
  counts.describe(march.solver());
  const Lines lines = model->report(counts.unknowns);
  int rank = 0;
  int ranks = 1;
  MPI_Comm_rank(comm, &rank);
  MPI_Comm_size(comm, &ranks);
  if (rank != 0) return ExitCode::done;

  const auto nonzeros = static_cast<double>(counts.jacobian_nonzeros);
  const auto unknowns = static_cast<double>(counts.unknowns);
  print_row("scene",
            printable(line.scene) + (scene.title.empty() ? "" : " (" + printable(scene.title) + ")"));
  print_row("steps", fmt::format("{} of {:.9g} s from {:.9g} s to {:.9g} s, scheme {}", time.steps, time.step,
                                 time.start, time.end, name_of(time.scheme)));
  if (time.scheme == Scheme::hybrid)
    print_row("hybrid",
              fmt::format("recorded in these steps, and before and after each event; tolerance {:.3g}",
                          time.tolerance));
  for (const Note& note : notes_before(time))
    print_row("warning", note.text);
  for (const auto& [name, text] : lines)
    print_row(name, text);
  print_row("solver",
            fmt::format("{}; steps are guessed by {}", counts.snes_type,
                        counts.predictor == "blocks"  ? "sweeps over blocks that read each other weakly"
                        : counts.predictor == "paths" ? "sweeps along paths of constraints"
                        : counts.predictor == "active set"
                            ? "their active set, with a factorization where it changes"
                            : counts.predictor));
  print_row("Jacobian nonzeros",
            fmt::format("{} ({:.3g} per unknown)", counts.jacobian_nonzeros, nonzeros / unknowns));
  if (ranks > 1)
    print_row("edge cut", fmt::format("{} couplings between {} ranks", model->edge_cut(), ranks));
  const Memory memory = available_memory();
  print_row("memory estimate",
            fmt::format("{} over all ranks; {} {}", memory_text(estimated_memory(ranks, unknowns, nonzeros)),
                        memory_text(memory.node), memory.source));
  return ExitCode::done;
}

}  // namespace sweepvi::app
