#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "app/options.hpp"
#include "app/prepare.hpp"
#include "app/summary.hpp"
#include "app/verbs.hpp"
#include "parallel/gather.hpp"
#include "sweepvi/linear_dvi.hpp"

namespace sweepvi::app {

namespace {

const char* name_of(MarkovReport::Solvability solvability) {
  switch (solvability) {
    case MarkovReport::Solvability::positive_definite:
      return "positive definite: each step has exactly one solution";
    case MarkovReport::Solvability::p_matrix:
      return "a P-matrix, not positive definite: each step has exactly one solution";
    case MarkovReport::Solvability::positive_semidefinite:
      return "positive semidefinite: enough for degrees 0 and 1";
    case MarkovReport::Solvability::not_checked:
      return "not decided: coupled group too large or, for degrees 0 and 1, not semidefinite";
  }
  return "";
}

std::string degrees_text(MPI_Comm comm, const RelativeDegree& relative_degree) {
  std::map<int, std::int64_t> count;
  for (const int r : gather(comm, relative_degree.degree))
    ++count[r];
  std::string text;
  for (const auto& [r, n] : count)
    text += fmt::format("{}r = {} for {} constraint{}", text.empty() ? "" : ", ", r, n, n == 1 ? "" : "s");
  return text;
}

/// Constraints with an upper wall, and those of them that stand for two rows of the scene.
struct Walls {
  std::int64_t two_sided = 0, merged = 0;
};

Walls count_walls(MPI_Comm comm, const LinearSystem& system) {
  std::int64_t counts[2] = {0, static_cast<std::int64_t>(system.opposite.size())};
  if (system.wmax) {
    const ReadArray wmax(system.wmax.get());
    counts[0] = std::count_if(wmax.data(), wmax.data() + wmax.size(),
                              [](double value) { return value < PETSC_INFINITY; });
  }
  MPI_Allreduce(MPI_IN_PLACE, counts, 2, MPI_INT64_T, MPI_SUM, comm);
  return {counts[0], counts[1]};
}

std::string not_needed(const LinearSystem& system, const RelativeDegree& relative_degree, Form form) {
  std::string text;
  const auto add = [&](const char* what) { text += (text.empty() ? "" : "; ") + std::string(what); };
  if (form == Form::box_on_z) add("multipliers");
  if (system.states() == relative_degree.outputs) add("zero dynamics (n = sum of r)");
  if (!system.f.any) add("forcing");
  if (system.f.any && !system.f.varies) add("derivatives of the forcing (it is constant)");
  if (!system.D) add("D");
  return text.empty() ? "nothing" : text;
}

}  // namespace

ExitCode check_scene(MPI_Comm comm, const CommandLine& line) {
  const Prepared model = prepare(comm, line);
  const LinearSystem& system = model.system;
  const RelativeDegree& degree = model.relative_degree;
  const TimeSpec& time = model.scene.time;
  const Form form = choose_form(system, degree, time.scheme);
  const auto dvi = make_linear_dvi(system, degree, time.scheme, form, time.grid());
  const TimeMarch march(*dvi, time.grid());  // reads what options there are
  if (line.help_requested) return ExitCode::done;
  report_unused_options(comm);
  Summary counts;
  counts.count_jacobian(march.solver().jacobian());
  const ZeroDynamics zero = zero_dynamics(system, degree);
  const std::string degrees = degrees_text(comm, degree);
  const std::string obstacle = against_box_on_z(system, degree, time.scheme);
  const Walls walls = count_walls(comm, system);
  int rank = 0;
  int ranks = 1;
  MPI_Comm_rank(comm, &rank);
  MPI_Comm_size(comm, &ranks);
  if (rank != 0) return ExitCode::done;

  const auto row = [](const char* name, const std::string& text) { fmt::print("{:<20} {}\n", name, text); };
  const PetscInt n = system.states();
  const PetscInt m = system.constraints();
  row("scene",
      fmt::format("{}{}", line.scene, model.scene.title.empty() ? "" : " (" + model.scene.title + ")"));
  row("steps", fmt::format("{} of {:.9g} s from {:.9g} s to {:.9g} s, scheme {}", time.steps, time.step,
                           time.start, time.end, sweepvi::name_of(time.scheme)));
  row("sizes", fmt::format("{} states, {} constraints, {} outputs", n, m, degree.outputs));
  if (walls.two_sided > 0)
    row("two-sided",
        fmt::format("{} constraint{}{}", walls.two_sided, walls.two_sided == 1 ? "" : "s",
                    walls.merged == 0
                        ? ""
                        : fmt::format(", {} of them two opposite rows of the scene", walls.merged)));
  row("relative degree", degrees);
  if (degree.highest > 0)
    row("  decided at",
        fmt::format(
            "|C A^i B| > {:.0e} |C||A|^i|B|; smallest that counted {:.1e}, largest that did not {:.1e}",
            degree.tolerance, degree.smallest_kept, degree.largest_dropped));
  row("Markov matrix", model.markov.diagonal
                           ? std::string("diagonal")
                           : fmt::format("{} nonzeros, largest coupled group {}", model.markov.nonzeros,
                                         model.markov.largest_block));
  row("  condition", model.markov.condition_known ? fmt::format("{:.3g}", model.markov.condition)
                                                  : "not computed (coupled group too large)");
  row("  solvability", name_of(model.markov.solvability));
  row("zero dynamics",
      zero.size <= 0 ? std::string("none")
      : std::isnan(zero.largest_real_part)
          ? fmt::format("{} states (spectrum computed up to 500 states)", zero.size)
          : fmt::format("{} states, largest real part of the spectrum {:.3g} 1/s{}", zero.size,
                        zero.largest_real_part,
                        zero.largest_real_part > 1e-9 ? " (unstable: non-minimum phase)" : ""));
  row("form", fmt::format("{}{}", sweepvi::name_of(form),
                          form == Form::box_on_z ? ": outputs are unknowns, their rows read the measures"
                          : obstacle.empty()     ? ", as asked; box on z would do without multipliers"
                                                 : ": " + obstacle));
  row("unknowns",
      fmt::format("{} ({} states{})", counts.unknowns, n,
                  form == Form::box_on_z ? "" : fmt::format(" + {} multipliers", counts.unknowns - n)));
  row("Jacobian nonzeros",
      fmt::format("{} ({:.3g} per unknown)", counts.jacobian_nonzeros,
                  static_cast<double>(counts.jacobian_nonzeros) / static_cast<double>(counts.unknowns)));
  row("not needed", not_needed(system, degree, form));
  if (ranks > 1) row("edge cut", fmt::format("{} couplings between {} ranks", system.edge_cut, ranks));
  // K, |K|, the Jacobian, its reduced copy: 12 B an entry; about 30 vectors; the factor is a guess for
  // chain-like fill.
  const double matrices = 4.0 * 12.0 * static_cast<double>(counts.jacobian_nonzeros);
  const double vectors = 30.0 * 8.0 * static_cast<double>(counts.unknowns);
  const double factor = 5.0 * 12.0 * static_cast<double>(counts.jacobian_nonzeros);
  row("memory estimate",
      fmt::format(
          "{:.3g} MB over all ranks, and about {:.3g} MB for the factorization (chains; more on lattices)",
          (matrices + vectors) / 1e6, factor / 1e6));
  return ExitCode::done;
}

}  // namespace sweepvi::app
