#pragma once

namespace sweepvi {

/// A time as the sum of two numbers, `high` its nearest: events a millionth of a nanosecond apart stay in
/// order after a day, and sums of a million flights are as exact as one.
struct Clock {
  double high = 0.0, low = 0.0;  ///< [s]

  void advance(double by) {
    const double sum = high + by, part = sum - high;
    const double lost = (high - (sum - part)) + (by - part) + low;
    high = sum + lost;
    low = lost - (high - sum);
  }
  /// How long it is until t.
  double until(double t) const { return (t - high) - low; }
};

}  // namespace sweepvi
