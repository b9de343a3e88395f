#pragma once

#include "sweepvi/linear_system.hpp"
#include "sweepvi/relative_degree.hpp"

namespace sweepvi {

/// Above this the box on z is not taken: rounding of a step would show in x beyond 1e-9 of its size.
inline constexpr double most_amplified = 1e6;

/// How much of a state's rounding the change of coordinates of the box on z makes of rounding of all,
///
///     max_i (|W^-1| |J| |J^-1| |W| s)_i / s_i,      J = W D the jumps that measures cause
///     (OutputCoordinates),
///
/// a condition number in the sense of Skeel, each state in its own unit: s_i is the larger of |x_i| at the
/// start and what its rate makes of the others in one step, h (|A| s)_i. Where an input reaches an output by
/// 1e-16 of what else it moves, it is 1e16. States that stay 0 do not count.
/// @pre  the pivots fit, `against_box_on_z`   @note Collective.
double coordinate_condition(const LinearSystem& system, const RelativeDegree& relative_degree, double h);

}  // namespace sweepvi
