#pragma once

#include <cmath>
#include <numbers>

namespace sweepvi {

/// offset + amplitude sin(2 pi frequency t + phase): a force whose derivatives are known in closed form.
struct Signal {
  double offset = 0.0;
  double amplitude = 0.0;
  double frequency = 0.0;  ///< [Hz]
  double phase = 0.0;      ///< [rad]

  bool varies() const { return amplitude != 0.0 && frequency != 0.0; }
  bool is_zero() const { return !varies() && value(0.0) == 0.0; }

  /// The same signal, `factor` times as large.
  Signal scaled(double factor) const { return {factor * offset, factor * amplitude, frequency, phase}; }

  /// A bound of the `order`-th time derivative.
  double bound(int order = 0) const {
    const double wave = std::abs(amplitude) * std::pow(2.0 * std::numbers::pi * std::abs(frequency), order);
    return order == 0 ? std::abs(offset) + wave : wave;
  }

  /// The `order`-th time derivative at t [s].
  double value(double t, int order = 0) const {
    const double omega = 2.0 * std::numbers::pi * frequency;
    const double quarter_turns = 0.5 * std::numbers::pi * (order % 4);
    const double wave = amplitude * std::pow(omega, order) * std::sin(omega * t + phase + quarter_turns);
    return order == 0 ? offset + wave : wave;
  }
};

}  // namespace sweepvi
