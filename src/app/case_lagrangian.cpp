#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "app/case.hpp"
#include "io/mechanical_recording.hpp"
#include "model/definiteness.hpp"
#include "model/from_scene.hpp"
#include "petsc/sparse.hpp"

namespace sweepvi::app {

namespace {

std::vector<std::string> state_names(const Scene& scene) {
  const auto* chain = std::get_if<ChainSpec>(&scene.model);
  return chain != nullptr ? chain->element->states : std::vector<std::string>{};
}

/// Whether some entry off the diagonal is not zero. @note Collective.
bool couples(Mat matrix) {
  int found = 0;
  for_each_row(matrix, [&](PetscInt row, auto columns, auto values) {
    for (std::size_t k = 0; k < columns.size(); ++k)
      if (columns[k] != row && values[k] != 0.0) found = 1;
  });
  MPI_Allreduce(MPI_IN_PLACE, &found, 1, MPI_INT, MPI_LOR,
                PetscObjectComm(reinterpret_cast<PetscObject>(matrix)));
  return found != 0;
}

/// A mechanical system with restitution, given as such or as a chain: moreau-jean.
class LagrangianCase final : public Case {
public:
  LagrangianCase(MPI_Comm comm, Scene& scene)
      : options_{.theta = scene.time.theta,
                 .detection =
                     scene.time.scheme == Scheme::hybrid ? Detection::predicted : scene.time.detection},
        names_(state_names(scene)),
        system_(make_lagrangian_system(comm, scene)) {
    system_.check_values();
    if (scene.time.scheme != Scheme::hybrid)
      step_matrix_ = check_step_matrix(system_, scene.time.grid().h(), options_.theta);
    distribute(system_);
    dvi_ = make_moreau_jean(system_, options_, scene.time.grid());
    if (scene.time.scheme == Scheme::hybrid) hybrid_ = make_hybrid(*dvi_, system_);
    PetscInt unknowns = 0;
    check(VecGetSize(dvi_->state(), &unknowns));
    boxed_ = unknowns == system_.coordinates();
  }

  Dvi& dvi() override { return *dvi_; }
  HybridProcess* hybrid() override { return hybrid_.get(); }
  Recording recording(const OutputSpec& output) const override {
    return mechanical_recording(output, system_, *dvi_, names_);
  }
  std::string form() const override { return boxed_ ? "box on v" : "primal-dual"; }
  std::int64_t constraints() const override { return system_.constraints(); }
  std::int64_t edge_cut() const override { return system_.edge_cut; }
  std::int64_t contact_changes() const override { return count_constraints(dvi_->events()); }
  StateOrder state_order() const override {
    return {{system_.coordinate_order, system_.coordinates()},
            {system_.constraint_order, system_.constraints()}};
  }
  Lines report(std::int64_t unknowns) const override;

private:
  MoreauJeanOptions options_;
  std::vector<std::string> names_;
  LagrangianSystem system_;
  std::string step_matrix_;  // what was found of it; empty where nothing is stepped
  bool boxed_ = false;
  std::unique_ptr<MechanicalDvi> dvi_;
  std::unique_ptr<HybridProcess> hybrid_;
};

Lines LagrangianCase::report(std::int64_t unknowns) const {
  const PetscInt n = system_.coordinates();
  const std::string obstacle = against_box_on_v(system_);
  double least = 0.0;
  double most = 0.0;
  check(VecMin(system_.e.get(), nullptr, &least));
  check(VecMax(system_.e.get(), nullptr, &most));
  Lines lines;
  lines.emplace_back("sizes", fmt::format("{} coordinates, {} constraints", n, system_.constraints()));
  const bool diagonal = !couples(system_.M.get());
  lines.emplace_back("mass matrix", diagonal ? std::string("diagonal, positive")
                                             : fmt::format("symmetric, positive definite ({})",
                                                           examine_definiteness(system_.M.get()).how_text()));
  if (!step_matrix_.empty()) lines.emplace_back("step matrix", step_matrix_);
  lines.emplace_back("restitution",
                     least == most ? fmt::format("{}", least) : fmt::format("{} to {}", least, most));
  lines.emplace_back(
      "time stepping",
      fmt::format("theta = {}{}, contacts detected at the {} position", options_.theta,
                  options_.theta == 0.5 ? " (keeps the energy)" : "", name_of(options_.detection)));
  lines.emplace_back("form", form() + (boxed_             ? ": a bound on one velocity for each constraint"
                                       : obstacle.empty() ? ", as asked; box on v would do without impulses"
                                                          : ": " + obstacle));
  lines.emplace_back("unknowns", fmt::format("{} ({} velocities{})", unknowns, n,
                                             boxed_ ? "" : fmt::format(" + {} impulses", unknowns - n)));
  return lines;
}

}  // namespace

std::unique_ptr<Case> make_lagrangian_case(MPI_Comm comm, Scene& scene) {
  return std::make_unique<LagrangianCase>(comm, scene);
}

}  // namespace sweepvi::app
