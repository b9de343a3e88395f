#pragma once

#include <cstddef>

namespace sweepvi {

/// A point (t, x) of a graph in R^(1+n).
struct GraphPoint {
  double t;
  const double* x;
};

/// max(|t - s|, ||x - y||_2).
double distance(const GraphPoint& p, const GraphPoint& q, std::size_t components);

/// The distance of p from the segment from a to b, to rounding.
///
/// On the line a + tau (b - a) both parts of the distance are convex: their maximum is least where one of
/// them is least and the other smaller, or where they are equal.
double distance_to_segment(const GraphPoint& p, const GraphPoint& a, const GraphPoint& b,
                           std::size_t components);

}  // namespace sweepvi
