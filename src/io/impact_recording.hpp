#pragma once

#include "io/recording.hpp"
#include "io/scene.hpp"
#include "sweepvi/impact_oscillators.hpp"
#include "sweepvi/linear_system.hpp"

namespace sweepvi {

/// What a run of impact oscillators records: /x (all x, then all x'), /z (all s, then all v), /w (x),
/// /lambda, /energy and events, in scene order.
/// @param system  the chain that the oscillators are made of; all three must outlive the recording
/// @note Collective on the system's communicator.
Recording impact_recording(const OutputSpec& output, const LinearSystem& system,
                           const ImpactOscillators& oscillators, const ImpactDvi& dvi);

}  // namespace sweepvi
