#pragma once

#include <cmath>

namespace sweepvi {

/// An unevaluated sum hi + lo of two doubles, |lo| <= ulp(hi) / 2: about 106 bits. Sums and products of such
/// numbers are exact up to 2^-104. Source: T. J. Dekker, Numer. Math. 18 (1971) 224-242; D. E. Knuth, TAOCP
/// 2, 4.2.2.
struct Twofold {
  double hi = 0.0, lo = 0.0;

  double value() const { return hi + lo; }
};

/// a + b without error. @pre |a| >= |b|, or a = 0
inline Twofold quick_sum(double a, double b) {
  const double sum = a + b;
  return {sum, b - (sum - a)};
}

/// a + b without error, whatever their sizes.
inline Twofold exact_sum(double a, double b) {
  const double sum = a + b;
  const double part = sum - a;
  return {sum, (a - (sum - part)) + (b - part)};
}

/// a b without error (but for underflow).
inline Twofold exact_product(double a, double b) {
  const double product = a * b;
  return {product, std::fma(a, b, -product)};
}

inline Twofold operator+(const Twofold& a, const Twofold& b) {
  const Twofold high = exact_sum(a.hi, b.hi);
  const Twofold low = exact_sum(a.lo, b.lo);
  const Twofold partly = quick_sum(high.hi, high.lo + low.hi);
  return quick_sum(partly.hi, partly.lo + low.lo);
}

inline Twofold operator*(double a, const Twofold& b) {
  Twofold product = exact_product(a, b.hi);
  product.lo += a * b.lo;
  return quick_sum(product.hi, product.lo);
}

}  // namespace sweepvi
