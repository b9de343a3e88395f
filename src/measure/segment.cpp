#include "measure/segment.hpp"

#include <algorithm>
#include <cmath>

namespace sweepvi {

double distance(const GraphPoint& p, const GraphPoint& q, std::size_t components) {
  double square = 0.0;
  for (std::size_t i = 0; i < components; ++i) {
    const double c = p.x[i] - q.x[i];
    square += c * c;
  }
  return std::max(std::abs(p.t - q.t), std::sqrt(square));
}

double distance_to_segment(const GraphPoint& p, const GraphPoint& a, const GraphPoint& b,
                           std::size_t components) {
  const double time = a.t - p.t, rate = b.t - a.t;
  double ce = 0.0, ee = 0.0;
  for (std::size_t i = 0; i < components; ++i) {
    const double c = a.x[i] - p.x[i], e = b.x[i] - a.x[i];
    ce += c * e;
    ee += e * e;
  }
  const auto space = [&](double tau) {
    double square = 0.0;
    for (std::size_t i = 0; i < components; ++i) {
      const double c = (a.x[i] - p.x[i]) + tau * (b.x[i] - a.x[i]);
      square += c * c;
    }
    return std::sqrt(square);
  };
  // The point of the segment that is least far in space, then from there toward the one at the same time,
  // away from it, up to where both are equal: least^2 + 2 slope delta + ee delta^2 = rate^2 (away - delta)^2.
  double tau = ee > 0.0 ? std::clamp(-ce / ee, 0.0, 1.0) : 0.0;
  const double least = space(tau), gap = std::abs(time + rate * tau);
  if (gap > least && rate > 0.0) {
    const double away = -time / rate - tau, direction = std::copysign(1.0, away), square = rate * rate;
    const double product = (gap - least) * (gap + least);
    const double slope = std::max(0.0, direction * (ce + ee * tau));  // less: rounding, or out of the segment
    const double half = square * std::abs(away) + slope;
    const double root = std::sqrt(std::max(0.0, half * half - (square - ee) * product));
    tau += direction * std::min(product / (half + root), std::abs(away));
  }
  tau = std::clamp(tau, 0.0, 1.0);
  return std::max(std::abs(time + rate * tau), space(tau));
}

}  // namespace sweepvi
