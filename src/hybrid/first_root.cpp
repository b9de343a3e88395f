#include "hybrid/first_root.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace sweepvi {

namespace {

constexpr int deepest = 52;  // halvings: pieces as short as rounding of the interval

// q on [0, 1]: the part of the interval from its begin.
std::optional<double> descend(std::vector<double> q, int depth) {
  if (q[0] < 0.0) return 0.0;
  double all = 0.0, bends = 0.0, end = q[0];
  for (std::size_t k = 1; k < q.size(); ++k) {
    all += std::abs(q[k]);
    end += q[k];
    if (k > 1) bends += static_cast<double>(k) * std::abs(q[k]);
  }
  if (q[0] >= all) return std::nullopt;
  const bool monotone = q.size() < 2 || std::abs(q[1]) >= bends;
  if (monotone || depth == deepest) {
    if (end >= 0.0) return std::nullopt;
    double low = 0.0, high = 1.0;  // not negative, negative
    for (int i = 0; i < 60 && low < high; ++i) {
      const double middle = 0.5 * (low + high);
      (polynomial(q, middle) < 0.0 ? high : low) = middle;
    }
    return high;
  }
  double scale = 1.0;
  for (double& coefficient : q) {
    coefficient *= scale;
    scale *= 0.5;
  }
  if (const auto root = descend(q, depth + 1)) return 0.5 * *root;
  for (std::size_t first = 0; first + 1 < q.size(); ++first)  // to 1 as the new begin
    for (std::size_t k = q.size() - 1; k > first; --k)
      q[k - 1] += q[k];
  if (const auto root = descend(std::move(q), depth + 1)) return 0.5 + 0.5 * *root;
  return std::nullopt;
}

}  // namespace

double polynomial(std::span<const double> coefficients, double tau) {
  double value = 0.0;
  for (std::size_t k = coefficients.size(); k-- > 0;)
    value = value * tau + coefficients[k];
  return value;
}

std::optional<double> first_crossing(std::span<const double> coefficients, double length, double noise) {
  const std::optional<double> root = first_root(coefficients, length);
  if (!root || noise == 0.0) return root;
  std::vector<double> q(coefficients.begin(), coefficients.end());
  q[0] += noise;
  std::optional<double> end = first_root(q, length);
  if (!end) {
    if (polynomial(coefficients, length) >= 0.0) return std::nullopt;
    end = length;
  }
  // Backwards from there to where it is not negative: as a polynomial in (end - tau)/end.
  double scale = -1.0;
  q.assign(coefficients.begin(), coefficients.end());
  for (double& coefficient : q) {
    coefficient *= scale;
    scale *= *end;
  }
  for (std::size_t first = 0; first + 1 < q.size(); ++first)
    for (std::size_t k = q.size() - 1; k > first; --k)
      q[k - 1] += q[k];
  for (std::size_t k = 1; k < q.size(); k += 2)
    q[k] = -q[k];
  q[0] = std::max(q[0], 0.0);
  double low = *end * (1.0 - first_root(q, 1.0).value_or(1.0)), high = *end;
  if (low <= *root || polynomial(coefficients, low) < 0.0) return root;
  for (int i = 0; i < 60 && low < high; ++i) {
    const double middle = 0.5 * (low + high);
    (polynomial(coefficients, middle) < 0.0 ? high : low) = middle;
  }
  return high;
}

std::optional<double> first_root(std::span<const double> coefficients, double length) {
  const auto leading =
      std::find_if(coefficients.begin(), coefficients.end(), [](double c) { return c != 0.0; });
  if (leading == coefficients.end()) return std::nullopt;
  if (*leading < 0.0) return 0.0;
  std::vector<double> q(leading, coefficients.end());
  double scale = 1.0;
  for (double& coefficient : q) {
    coefficient *= scale;
    scale *= length;
  }
  const auto root = descend(q, 0);
  if (!root) return std::nullopt;
  // A bisection of shifted coefficients knows the root up to their rounding: bisect the original around it.
  const double width = 64.0 * std::numeric_limits<double>::epsilon();
  double low = std::max(0.0, *root - width), high = std::min(1.0, *root + width);
  if (polynomial(q, low) < 0.0 || polynomial(q, high) >= 0.0) return *root * length;
  for (int i = 0; i < 12; ++i) {
    const double middle = 0.5 * (low + high);
    (polynomial(q, middle) < 0.0 ? high : low) = middle;
  }
  return high * length;
}

}  // namespace sweepvi
