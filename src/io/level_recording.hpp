#pragma once

#include "io/recording.hpp"
#include "io/scene.hpp"
#include "sweepvi/dvi.hpp"
#include "sweepvi/linear_system.hpp"
#include "sweepvi/relative_degree.hpp"

namespace sweepvi {

/// States, outputs, measures and levels of a linear system, in scene order.
/// @param dvi  of that system; must outlive the recording, as the system must
/// @note Collective on the system's communicator.
Recording level_recording(const OutputSpec& output, const LinearSystem& system,
                          const RelativeDegree& relative_degree, const ConstrainedDvi& dvi);

}  // namespace sweepvi
