#include <fmt/format.h>

#include <algorithm>

#include "app/case.hpp"
#include "io/step_events.hpp"
#include "model/step_matrix.hpp"
#include "model/sweeping_from_scene.hpp"

namespace sweepvi::app {

namespace {

/// A first-order sweeping process: a moving box or polyhedron.
class SweepingCase final : public Case {
public:
  SweepingCase(MPI_Comm comm, Scene& scene)
      : grid_(scene.time.grid()), system_(make_sweeping_system(comm, std::get<SweepingSpec>(scene.model))) {
    if (system_.A && scene.time.scheme != Scheme::hybrid)
      step_matrix_ = check_first_order_step(system_.A.get(), grid_.h(), 1.0, "A");
    distribute(system_);
    dvi_ = make_sweeping_dvi(system_, grid_);
    if (scene.time.scheme == Scheme::hybrid) hybrid_ = make_hybrid(*dvi_, system_);
  }

  Dvi& dvi() override { return *dvi_; }
  HybridProcess* hybrid() override { return hybrid_.get(); }
  Recording recording(const OutputSpec& output) const override;
  std::string form() const override { return system_.is_box() ? "box on u" : "u and measures of faces"; }
  std::int64_t constraints() const override { return system_.constraints(); }
  std::int64_t edge_cut() const override { return system_.edge_cut; }
  std::int64_t contact_changes() const override { return count_constraints(dvi_->events()); }
  StateOrder state_order() const override {
    const Places components{system_.state_order, system_.states()};
    if (system_.is_box()) return {components, components};
    return {components, {system_.face_order, system_.constraints()}};
  }
  Lines report(std::int64_t unknowns) const override;

private:
  TimeGrid grid_;
  SweepingSystem system_;
  std::string step_matrix_;  // what was found of it; empty where there is no A
  std::unique_ptr<ConstrainedDvi> dvi_;
  std::unique_ptr<HybridProcess> hybrid_;
};

Recording SweepingCase::recording(const OutputSpec&) const {
  const ConstrainedDvi& dvi = *dvi_;
  const std::vector<PetscInt>& rows = system_.is_box() ? system_.state_order : system_.face_order;
  PetscInt total = system_.states();
  if (system_.G) check(MatGetSize(system_.G.get(), &total, nullptr));
  Recording recording;
  recording.quantities.push_back({.name = "/x",
                                  .description = "u",
                                  .positions = system_.state_order,
                                  .total = system_.states(),
                                  .read = [&dvi](double* to) {
                                    const ReadArray x(dvi.x());
                                    std::copy(x.data(), x.data() + x.size(), to);
                                  }});
  recording.quantities.push_back(
      {.name = "/w",
       .description =
           system_.is_box() ? "distance of each component to the nearer bound (inf: it has none)" : "G u - g",
       .positions = rows,
       .total = total,
       .read = [&dvi](double* to) { std::copy(dvi.w().begin(), dvi.w().end(), to); }});
  recording.quantities.push_back(
      {.name = "/mu",
       .description =
           system_.is_box()
               ? "measures of the steps since the last row, per component, negative at upper bounds"
               : "measures of the steps since the last row, per face",
       .extents = {1},
       .positions = rows,
       .total = total,
       .summed = true,
       .read = [&dvi](double* to) { std::copy(dvi.mu().begin(), dvi.mu().end(), to); }});
  recording.quantities.push_back(
      {.name = "/level",
       .description = "1: measures of first-order processes act on u itself",
       .type = FieldSpec::Type::integer,
       .positions = rows,
       .total = total,
       .read = [&dvi](double* to) { std::copy(dvi.level().begin(), dvi.level().end(), to); }});
  recording.events = [&dvi, rows](double t) { return events_of(dvi.events(), rows, t); };
  return recording;
}

const char* motion(bool varies) {
  return varies ? "moving" : "standing still";
}

Lines SweepingCase::report(std::int64_t unknowns) const {
  const std::int64_t count = constraints();
  const PetscInt n = system_.states();
  Lines lines;
  if (system_.is_box()) {
    const bool moves = (system_.lower && system_.lower->varies) || (system_.upper && system_.upper->varies);
    lines.emplace_back("set", fmt::format("box in {} dimension{}, {} with bounds, {}", n, n == 1 ? "" : "s",
                                          count, motion(moves)));
    lines.emplace_back("empty", "never: lower <= upper at every step");
  } else {
    lines.emplace_back(
        "set", fmt::format("polyhedron of {} face{} in {} dimension{}, {}", count, count == 1 ? "" : "s", n,
                           n == 1 ? "" : "s", motion(system_.g.varies)));
    lines.emplace_back("empty", system_.g.varies ? "not at the start; looked for at each step" : "never");
  }
  lines.emplace_back("perturbation", fmt::format("{}, {}", system_.A ? "A u" : "no A",
                                                 !system_.f.any     ? "no f"
                                                 : system_.f.varies ? "f varies"
                                                                    : "f constant"));
  if (system_.A) {
    const double growth = grid_.h() * one_sided_lipschitz(system_);
    lines.emplace_back("  solvability",
                       fmt::format("h times the largest v'Av/v'v is at most {:.3g}: {}", growth,
                                   growth < 1.0 ? "each step has exactly one solution"
                                                : "1 or more, steps may have none or several solutions"));
  }
  if (!step_matrix_.empty()) lines.emplace_back("step matrix", step_matrix_);
  lines.emplace_back("form", form());
  lines.emplace_back("unknowns", system_.is_box()
                                     ? fmt::format("{} (components)", unknowns)
                                     : fmt::format("{} ({} components + {} measures)", unknowns, n, count));
  return lines;
}

}  // namespace

std::unique_ptr<Case> make_sweeping_case(MPI_Comm comm, Scene& scene) {
  return std::make_unique<SweepingCase>(comm, scene);
}

}  // namespace sweepvi::app
