#pragma once

#include <vector>

#include "parallel/element_graph.hpp"

namespace sweepvi {

/// What a rank owns from now on, in its order, in old numbers.
struct Share {
  std::vector<PetscInt> states, constraints;
  std::vector<PetscInt> block;  ///< of each of its states
  PetscInt block_count = 0, edge_cut = 0;
};

/// Deals rank 0's graph out by METIS; each rank numbers its vertices for low fill. States and constraints
/// follow their vertex.
/// @throws Error (internal) on every rank if METIS fails
/// @note Collective.
Share share_out(MPI_Comm comm, ElementGraph elements);

}  // namespace sweepvi
