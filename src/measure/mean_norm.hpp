#pragma once

#include <cstddef>

namespace sweepvi {

/// The integral over s from 0 to 1 of ||(1 - s) p + s q||_2, to rounding.
double mean_norm(const double* p, const double* q, std::size_t n);

}  // namespace sweepvi
