#include "measure/mean_norm.hpp"

#include <cmath>

namespace sweepvi {

namespace {

double dot(const double* p, const double* q, std::size_t n) {
  double sum = 0.0;
  for (std::size_t i = 0; i < n; ++i)
    sum += p[i] * q[i];
  return sum;
}

}  // namespace

// The line from p to q, of length l, passes the origin at a distance r, from a to b = a + l along it: the
// mean is that of sqrt(w^2 + r^2), w from a to b,
//
//     1/(2 l) [ w sqrt(w^2 + r^2) + r^2 asinh(w/r) ]_a^b.
//
// Both differences cancel when l is small against a or r. With P = ||p||, Q = ||q||, S = P + Q and
// Q - P = l (a + b) / S they are, divided by 2 l,
//
//     S/4 + (a + b)^2 / (4 S)      and      r^2 asinh(l g) / (2 l),     l g = (b P - a Q) / r^2,
//
// where g = [1 + (a^2 + b^2 + r^2) / (P Q + a b)] / S = (r^2 + P Q - a b) / (r^2 S): the first for a b > 0,
// the second else, are sums of positive terms.
double mean_norm(const double* p, const double* q, std::size_t n) {
  const double norm_p = std::sqrt(dot(p, p, n)), norm_q = std::sqrt(dot(q, q, n)), sum = norm_p + norm_q;
  double l = 0.0, a = 0.0, b = 0.0;
  for (std::size_t i = 0; i < n; ++i) {
    const double step = q[i] - p[i];
    l += step * step;
    a += p[i] * step;
    b += q[i] * step;
  }
  l = std::sqrt(l);
  if (l == 0.0 || sum == 0.0) return 0.5 * sum;
  a /= l;
  b /= l;
  double r2 = 0.0;  // from the nearer end, so that little is subtracted
  const bool from_p = std::abs(a) < std::abs(b);
  for (std::size_t i = 0; i < n; ++i) {
    const double foot = from_p ? p[i] - a / l * (q[i] - p[i]) : q[i] - b / l * (q[i] - p[i]);
    r2 += foot * foot;
  }
  const double mean = 0.25 * sum + 0.25 * (a + b) * (a + b) / sum;
  if (r2 <= 1e-200 * sum * sum) return mean;  // so that r2 g does not overflow; it adds nothing
  const double g = a * b > 0.0 ? (1.0 + (a * a + b * b + r2) / (norm_p * norm_q + a * b)) / sum
                               : (1.0 + (norm_p * norm_q - a * b) / r2) / sum;
  const double x = l * g;
  return mean + 0.5 * r2 * g * (x > 0.0 ? std::asinh(x) / x : 1.0);
}

}  // namespace sweepvi
