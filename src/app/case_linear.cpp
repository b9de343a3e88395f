#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "app/case.hpp"
#include "io/level_recording.hpp"
#include "model/from_scene.hpp"
#include "model/opposite.hpp"
#include "model/step_matrix.hpp"
#include "parallel/gather.hpp"
#include "sweepvi/linear_dvi.hpp"
#include "sweepvi/partition.hpp"

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

std::string decision_text(const LinearSystem& system, const RelativeDegree& degree) {
  std::string text =
      fmt::format("smallest |C A^(r-1) B| that counted: {:.1e} of its terms, {}", degree.smallest_kept,
                  std::isinf(degree.smallest_margin)
                      ? std::string("exact")
                      : fmt::format("{:.1e} times its error bound", degree.smallest_margin));
  text += degree.largest_dropped > 0.0
              ? fmt::format("; largest taken as zero: {:.1e} of its terms", degree.largest_dropped)
              : "; the others are exactly zero";
  if (degree.doubtful > 0)
    text += fmt::format(
        "; for {} constraint{} that is above its error bound and taken as rounding of computed data (if it "
        "is "
        "a coupling, state model.relative_degree)",
        degree.doubtful, degree.doubtful == 1 ? "" : "s");
  if (!system.stated_degree.empty()) text += "; as stated by model.relative_degree";
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

/// A linear system, given as such or as a chain, of any relative degrees.
class LinearCase final : public Case {
public:
  LinearCase(MPI_Comm comm, Scene& scene)
      : scheme_(scene.time.scheme == Scheme::hybrid ? Scheme::homsp : scene.time.scheme),
        theta_(scene.time.theta),
        h_(scene.time.step),
        system_(make_linear_system(comm, scene)) {
    merge_opposite_constraints(system_);
    degree_ = analyse_relative_degree(system_);
    markov_ = check_markov_matrix(system_, degree_);
    if (scene.time.scheme != Scheme::hybrid)
      step_matrix_ = check_first_order_step(system_.A.get(), scene.time.grid().h(), theta_, "A");
    distribute(system_, degree_);
    form_ = choose_form(system_, degree_, scheme_, h_);
    dvi_ = make_linear_dvi(system_, degree_, scheme_, form_, scene.time.grid(), theta_);
    if (scene.time.scheme == Scheme::hybrid) hybrid_ = make_hybrid(*dvi_, system_, degree_);
  }

  Dvi& dvi() override { return *dvi_; }
  HybridProcess* hybrid() override { return hybrid_.get(); }
  Recording recording(const OutputSpec& output) const override {
    return level_recording(output, system_, degree_, *dvi_);
  }
  std::string form() const override { return sweepvi::name_of(form_); }
  std::int64_t constraints() const override { return system_.scene_constraints(); }
  std::int64_t edge_cut() const override { return system_.edge_cut; }
  std::int64_t contact_changes() const override {
    std::vector<StepEvent> changes = dvi_->events();
    std::erase_if(changes, [](const StepEvent& event) { return event.impact && event.level > 1; });
    return count_constraints(changes);
  }
  StateOrder state_order() const override {
    return {{system_.state_order, system_.states()}, {system_.constraint_order, system_.scene_constraints()}};
  }
  Lines report(std::int64_t unknowns) const override;

private:
  std::string form_line() const;

  Scheme scheme_;
  double theta_, h_;
  LinearSystem system_;
  RelativeDegree degree_;
  MarkovReport markov_;
  std::string step_matrix_;  // what was found of it; empty where nothing is stepped
  Form form_ = Form::primal_dual;
  std::unique_ptr<ConstrainedDvi> dvi_;
  std::unique_ptr<HybridProcess> hybrid_;
};

std::string LinearCase::form_line() const {
  const std::string obstacle = against_box_on_z(system_, degree_, scheme_, h_);
  return form() + (form_ == Form::box_on_z ? ": outputs are unknowns, their rows read the measures"
                   : obstacle.empty()      ? ", as asked; box on z would do without multipliers"
                                           : ": " + obstacle);
}

Lines LinearCase::report(std::int64_t unknowns) const {
  const MPI_Comm comm = system_.comm();
  const PetscInt n = system_.states();
  Lines lines;
  lines.emplace_back("sizes", fmt::format("{} states, {} constraints, {} outputs", n, system_.constraints(),
                                          degree_.outputs));
  if (const Walls walls = count_walls(comm, system_); walls.two_sided > 0)
    lines.emplace_back(
        "two-sided",
        fmt::format("{} constraint{}{}", walls.two_sided, walls.two_sided == 1 ? "" : "s",
                    walls.merged == 0
                        ? ""
                        : fmt::format(", {} of them two opposite rows of the scene", walls.merged)));
  lines.emplace_back("relative degree", degrees_text(comm, degree_));
  if (degree_.highest > 0) lines.emplace_back("  decided by", decision_text(system_, degree_));
  lines.emplace_back("Markov matrix", markov_.diagonal
                                          ? std::string("diagonal")
                                          : fmt::format("{} nonzeros, largest coupled group {}",
                                                        markov_.nonzeros, markov_.largest_block));
  lines.emplace_back("  condition", markov_.condition_known ? fmt::format("{:.3g}", markov_.condition)
                                                            : "not computed (coupled group too large)");
  lines.emplace_back("  solvability", name_of(markov_.solvability));
  const ZeroDynamics zero = zero_dynamics(system_, degree_);
  lines.emplace_back(
      "zero dynamics",
      zero.size <= 0 ? std::string("none")
      : std::isnan(zero.largest_real_part)
          ? fmt::format("{} states (spectrum computed up to 500 states)", zero.size)
          : fmt::format("{} states, largest real part of the spectrum {:.3g} 1/s{}", zero.size,
                        zero.largest_real_part,
                        zero.largest_real_part > 1e-9 ? " (unstable: non-minimum phase)" : ""));
  if (!step_matrix_.empty()) lines.emplace_back("step matrix", step_matrix_);
  lines.emplace_back("form", form_line());
  if (scheme_ == Scheme::homsp)
    lines.emplace_back("time stepping",
                       fmt::format("theta = {} for states, measures at the end of a step", theta_));
  lines.emplace_back(
      "unknowns", fmt::format("{} ({} states{})", unknowns, n,
                              form_ == Form::box_on_z ? "" : fmt::format(" + {} multipliers", unknowns - n)));
  lines.emplace_back("not needed", not_needed(system_, degree_, form_));
  return lines;
}

}  // namespace

std::unique_ptr<Case> make_linear_case(MPI_Comm comm, Scene& scene) {
  return std::make_unique<LinearCase>(comm, scene);
}

}  // namespace sweepvi::app
