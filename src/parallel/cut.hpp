#pragma once

#include <vector>

#include "parallel/element_graph.hpp"

namespace sweepvi {

struct Cut {
  std::vector<PetscInt> part;  ///< of each vertex
  PetscInt edges = 0;          ///< between different parts
};

/// Cuts a graph into parts of about equal weight with few edges between them, by METIS. With fewer vertices
/// than parts some parts stay empty. The same cut every time.
/// @param weights  of the vertices, positive
/// @throws Error (internal) if METIS fails
Cut cut_graph(Graph& graph, std::vector<idx_t> weights, int parts);

}  // namespace sweepvi
