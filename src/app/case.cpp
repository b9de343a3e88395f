#include "app/case.hpp"

#include "app/options.hpp"

namespace sweepvi::app {

Scene load(MPI_Comm comm, const CommandLine& line) {
  Scene scene = read_scene(comm, line.scene, line.overrides);
  insert_scene_options(line, scene.petsc_options, scene.petsc_options_set);
  return scene;
}

std::unique_ptr<Case> make_case(MPI_Comm comm, Scene& scene) {
  const Scheme scheme = scene.time.scheme;
  const bool levels = scheme == Scheme::homsp || scheme == Scheme::zd_euler || scheme == Scheme::naive_euler;
  const bool linear =
      std::holds_alternative<LinearSpec>(scene.model) || std::holds_alternative<ChainSpec>(scene.model);
  if (levels && linear) return make_linear_case(comm, scene);
  if (levels && std::holds_alternative<LagrangianSpec>(scene.model)) return make_linear_case(comm, scene);
  if (scheme == Scheme::moreau_jean) return make_lagrangian_case(comm, scene);
  throw InputError(scene.path + ": the scheme \"" + name_of(scheme) + "\" for this model is not built yet");
}

}  // namespace sweepvi::app
