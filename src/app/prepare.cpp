#include "app/prepare.hpp"

#include "app/options.hpp"
#include "model/from_scene.hpp"
#include "model/opposite.hpp"
#include "sweepvi/partition.hpp"

namespace sweepvi::app {

Prepared prepare(MPI_Comm comm, const CommandLine& line) {
  Prepared prepared;
  prepared.scene = read_scene(comm, line.scene, line.overrides);
  insert_scene_options(line, prepared.scene.petsc_options, prepared.scene.petsc_options_set);
  prepared.system = make_linear_system(comm, prepared.scene);
  merge_opposite_constraints(prepared.system);
  prepared.relative_degree = analyse_relative_degree(prepared.system);
  prepared.markov = check_markov_matrix(prepared.system, prepared.relative_degree);
  distribute(prepared.system, prepared.relative_degree);
  return prepared;
}

}  // namespace sweepvi::app
