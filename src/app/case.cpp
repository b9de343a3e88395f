#include "app/case.hpp"

#include "app/options.hpp"
#include "app/room.hpp"
#include "io/unresolved_signals.hpp"

namespace sweepvi::app {

std::int64_t count_constraints(const std::vector<StepEvent>& events) {
  std::int64_t count = 0;
  for (std::size_t i = 0; i < events.size(); ++i)
    count += i == 0 || events[i].constraint != events[i - 1].constraint ? 1 : 0;
  return count;
}

Scene load(MPI_Comm comm, const CommandLine& line) {
  Scene scene = read_scene(comm, line.scene, line.overrides);
  insert_scene_options(line, scene.petsc_options, scene.petsc_options_set);
  require_room(comm, scene);
  find_unresolved_signals(comm, scene);
  return scene;
}

std::unique_ptr<Case> make_case(MPI_Comm comm, Scene& scene) {
  const Scheme scheme = scene.time.scheme;
  if (scheme == Scheme::catching_up) return make_sweeping_case(comm, scene);
  if (scheme == Scheme::moreau_jean) return make_lagrangian_case(comm, scene);
  if (scheme == Scheme::hybrid) {
    if (std::holds_alternative<SweepingSpec>(scene.model)) return make_sweeping_case(comm, scene);
    const auto* chain = std::get_if<ChainSpec>(&scene.model);
    if (std::holds_alternative<ImpactSpec>(scene.model) || (chain != nullptr && chain->element->kappa))
      return make_impact_case(comm, scene);
    const bool mechanical = chain != nullptr ? chain->element->mass.has_value()
                                             : std::holds_alternative<LagrangianSpec>(scene.model);
    return mechanical ? make_lagrangian_case(comm, scene) : make_linear_case(comm, scene);
  }
  if (scheme != Scheme::zhuravlev_ivanov) return make_linear_case(comm, scene);
  const auto* impact = std::get_if<ImpactSpec>(&scene.model);
  if (impact != nullptr && impact->reference) return make_tracking_case(comm, scene);
  return make_impact_case(comm, scene);
}

}  // namespace sweepvi::app
