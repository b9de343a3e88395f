#pragma once

#include <limits>

namespace sweepvi {

/// Residuals up to this count as zero, whatever the terms of their row: DBL_MIN / DBL_EPSILON, about 1e-292.
/// Below DBL_MIN numbers lose their digits one by one, so that terms down there are no measure of rounding; a
/// coefficient, a step or a stiffness of up to 1 / DBL_EPSILON lifts what is lost to no more than this.
inline constexpr double negligible_residual =
    std::numeric_limits<double>::min() / std::numeric_limits<double>::epsilon();

}  // namespace sweepvi
