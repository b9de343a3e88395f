#pragma once

#include <span>
#include <vector>

#include "sweepvi/petsc.hpp"

namespace sweepvi {

/// Entities dealt out over the ranks, and where each stands when they are brought together.
struct Places {
  std::vector<PetscInt> mine;  ///< of this rank's entities; -1: left out
  PetscInt total = 0;          ///< places in all
};

/// The numbers of all ranks' entities, `width` each, in their places on rank 0; places of nobody hold 0.
/// Empty on other ranks. @note Collective.
std::vector<double> bring_together(MPI_Comm comm, const Places& places, std::span<const double> mine,
                                   std::size_t width);

/// The other way round: fills `mine` from what rank 0 has; entities without a place keep what they have.
/// @param all  rank 0: `width` numbers for each place
/// @note Collective.
void deal_out(MPI_Comm comm, const Places& places, const std::vector<double>& all, std::size_t width,
              std::span<double> mine);

}  // namespace sweepvi
