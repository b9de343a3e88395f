#pragma once

#include <mpi.h>

#include "io/scene.hpp"

namespace sweepvi {

/// Periods of a signal in a step above which the step does not see its shape: ten samples a period.
inline constexpr double most_periods_in_step = 0.1;

/// Counts the signals of the scene that its steps do not resolve, frequency * h > 0.1, into
/// `scene.time.unresolved_signals`, and their highest frequency. None with the scheme hybrid, which
/// integrates signals exactly. @note Collective.
void find_unresolved_signals(MPI_Comm comm, Scene& scene);

}  // namespace sweepvi
