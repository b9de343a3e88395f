#pragma once

#include <optional>
#include <span>

namespace sweepvi {

/// c_0 + c_1 tau + ... at tau.
double polynomial(std::span<const double> coefficients, double tau);

/// The first tau in (0, length] where a polynomial becomes negative; 0 if it begins so. Where its
/// coefficients begin with zeros, the sign right after 0 counts. A minimum that touches zero only up to
/// rounding is none.
///
/// No root is missed: pieces whose coefficients bound the polynomial away from zero are dropped, on monotone
/// ones the end decides, the others are halved.
std::optional<double> first_root(std::span<const double> coefficients, double length);

/// The same, of one whose values are known up to `noise`: where it falls below zero and not back again before
/// it has been below -noise or the interval ends.
std::optional<double> first_crossing(std::span<const double> coefficients, double length, double noise);

}  // namespace sweepvi
