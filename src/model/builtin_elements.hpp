#pragma once

#include <vector>

#include "sweepvi/element.hpp"

namespace sweepvi {

/// The elements every scene knows: `jerk`, `wall`, `contact`, `flexible`.
std::vector<Element> builtin_elements();

}  // namespace sweepvi
