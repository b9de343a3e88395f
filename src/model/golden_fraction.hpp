#pragma once

#include <cmath>
#include <cstdint>

namespace sweepvi {

/// A number in [0, 1) per element, spread evenly whatever the count.
inline double golden_fraction(std::int64_t i) {
  const double golden = static_cast<double>(i) * 0.6180339887498949;
  return golden - std::floor(golden);
}

}  // namespace sweepvi
