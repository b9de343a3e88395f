#pragma once

#include "io/scene.hpp"

namespace sweepvi::app {

/// Complains about a scene that cannot fit into the memory there is, before anything is built from it. What
/// it holds against the memory is less than half of what any scene was found to take, so that nothing is
/// refused that fits.
/// @throws Error (bad_input) on every rank.  @note Collective.
void require_room(MPI_Comm comm, const Scene& scene);

/// What a run takes on all ranks together [B], to a factor of 2 or so (dense matrices: of 4): for `check`.
double estimated_memory(int ranks, double unknowns, double jacobian_nonzeros);

}  // namespace sweepvi::app
