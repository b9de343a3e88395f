#pragma once

#include "io/recording.hpp"
#include "io/scene.hpp"
#include "sweepvi/lagrangian.hpp"

namespace sweepvi {

/// What a run of moreau-jean records: /x (all q, then all v), /w (gaps), /mu, /level, /energy, /work and
/// events.
/// @param names  of a coordinate and its velocity, for chains; else empty
/// @note Collective. What it reads from must outlive it.
Recording mechanical_recording(const OutputSpec& output, const LagrangianSystem& system, MechanicalDvi& dvi,
                               std::vector<std::string> names);

}  // namespace sweepvi
