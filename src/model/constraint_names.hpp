#pragma once

#include <string>

#include "sweepvi/linear_system.hpp"

namespace sweepvi {

/// How messages call an owned constraint: by its number in the scene.
inline std::string constraint_name(const LinearSystem& system, std::size_t local) {
  return "constraint " + std::to_string(system.constraint_order[local]);
}

}  // namespace sweepvi
