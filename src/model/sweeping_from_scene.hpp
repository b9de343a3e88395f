#pragma once

#include "io/scene.hpp"
#include "sweepvi/sweeping.hpp"

namespace sweepvi {

/// The sweeping process a scene describes; rows dealt out in order. The spec is emptied.
/// @note Collective on `comm`.
SweepingSystem make_sweeping_system(MPI_Comm comm, SweepingSpec& spec);

}  // namespace sweepvi
