#pragma once

#include "sweepvi/relative_degree.hpp"

namespace sweepvi {

/// Fills `pivot` and `has_pivots`: a state for each output such that x follows from the outputs and the other
/// states by substitution. Output by output, in as many rounds as there are levels: an output that reads just
/// one state not yet known takes its place. So positions are known first, then velocities, then what
/// accelerations depend on, and so forth; x is never more than that many substitutions away, and W^{-1} is as
/// local as W.
/// @note Collective.
void find_pivots(const LinearSystem& system, RelativeDegree& relative_degree);

}  // namespace sweepvi
