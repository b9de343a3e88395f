#pragma once

#include "sweepvi/linear_system.hpp"

namespace sweepvi {

/// Merges constraints that say the opposite of another one, C_b = -s C_a, B_b = -t B_a with s, t > 0, into
/// its upper wall: 0 <= w_a <= w0_a + w0_b / s. As two constraints their Markov matrix would be singular.
/// What was merged stands in `system.opposite`. Systems with D are left alone.
/// @throws Error (bad_input) on every rank if the walls leave no room, or an opposite row has a wmax of its
/// own
/// @note Collective.
void merge_opposite_constraints(LinearSystem& system);

}  // namespace sweepvi
