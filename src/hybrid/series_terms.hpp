#pragma once

#include <algorithm>
#include <array>
#include <vector>

#include "sweepvi/petsc.hpp"

namespace sweepvi {

constexpr int enough_terms = 40;  // of any series
constexpr double tie = 1e-12;     // a derivative that is this small, relative to its terms, is zero
constexpr double lost = 1e-16;    // by rounding of a sum, relative to its largest term

inline double factorial(int k) {
  static const auto table = [] {
    std::array<double, enough_terms + 2> values{1.0};
    for (std::size_t i = 1; i < values.size(); ++i)
      values[i] = values[i - 1] * static_cast<double>(i);
    return values;
  }();
  return table[static_cast<std::size_t>(k)];
}

inline void copy_to(Vec from, std::vector<double>& values) {
  const ReadArray array(from);
  values.assign(array.data(), array.data() + array.size());
}

}  // namespace sweepvi
