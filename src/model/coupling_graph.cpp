#include "model/coupling_graph.hpp"

#include "model/from_scene.hpp"

namespace sweepvi {

CouplingGraph::CouplingGraph(MPI_Comm comm, const ChainSpec& spec, LocalRange elements) : spec_(spec) {
  if (spec.weights) weights_ = scatter_rows(comm, *spec.weights, elements.size(), elements.size());
}

CouplingGraph::Row CouplingGraph::row(PetscInt i) const {
  Row row;
  if (weights_) {
    row.neighbours = get_row(weights_.get(), i);
    return row;
  }
  const auto count = static_cast<PetscInt>(spec_.count);
  const auto nx = static_cast<PetscInt>(spec_.shape[0]);
  switch (spec_.topology) {
    case Topology::chain:
      add(row, i - 1, i > 0);
      add(row, i + 1, i + 1 < count);
      break;
    case Topology::ring:
      add(row, (i + count - 1) % count, true);
      add(row, (i + 1) % count, true);
      break;
    case Topology::lattice:
      add(row, i - 1, i % nx > 0);
      add(row, i + 1, i % nx + 1 < nx);
      add(row, i - nx, i >= nx);
      add(row, i + nx, i + nx < count);
  }
  return row;
}

void CouplingGraph::add(Row& row, PetscInt neighbour, bool exists) const {
  if (!exists)
    row.ends += spec_.coupling;
  else if (spec_.coupling != 0.0)
    row.neighbours.emplace_back(neighbour, spec_.coupling);
}

}  // namespace sweepvi
