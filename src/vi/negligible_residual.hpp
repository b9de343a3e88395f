#pragma once

#include <limits>

namespace sweepvi {

/// Residuals up to this count as zero, whatever the terms of their row: 1e10 times the smallest number,
/// 5e-314. Numbers below DBL_MIN (2e-308) are known to 5e-324 only, so that terms down there are no measure
/// of rounding; coefficients, steps or stiffnesses of up to 1e10 lift what is lost to no more than this.
inline constexpr double negligible_residual = 1e10 * std::numeric_limits<double>::denorm_min();

}  // namespace sweepvi
