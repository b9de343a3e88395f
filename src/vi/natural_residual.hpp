#pragma once

#include <cmath>
#include <limits>

#include "sweepvi/dvi.hpp"
#include "vi/negligible_residual.hpp"

namespace sweepvi {

/// What row i makes of u: the natural residual u - mid(l, b, u - F), in the form
///
///     max(min(F, u - l), u - b),
///
/// in which a large u cannot swallow a small F. Bounds at PETSC_INFINITY and beyond are absent: that number
/// itself is no bound to rest on.
inline double natural_residual(double u, double f, double lower, double upper) {
  const double from_lower = lower > PETSC_NINFINITY ? u - lower : std::numeric_limits<double>::infinity();
  const double from_upper = upper < PETSC_INFINITY ? u - upper : -std::numeric_limits<double>::infinity();
  const double below = from_lower < f ? from_lower : f;  // keeps NaN in f
  return from_upper > below ? from_upper : below;
}

/// What evaluating a row of these terms in double precision may leave in F.
inline double evaluation_error(double terms) {
  return 8.0 * std::numeric_limits<double>::epsilon() * terms;
}

/// How far a row may be from being solved if F is only known up to `error`.
inline double largest_residual(double u, double f, double lower, double upper, double error) {
  const double natural = std::abs(natural_residual(u, f, lower, upper));
  return natural == 0.0 && std::abs(f) >= error ? 0.0 : natural + error;
}

/// Judges rows one after the other.
class RowJudge {
public:
  void look_at(double u, double f, double lower, double upper, double terms) {
    not_finite_ += 0.0 * u + 0.0 * f + 0.0 * terms;
    const double natural = std::abs(natural_residual(u, f, lower, upper));
    if (natural > ratios_.worst * terms && natural > negligible_residual)
      ratios_.worst = natural / terms;  // terms = 0: infinite, as it should be
    if (natural < std::abs(f) && natural != 0.0) ratios_.by_distance = true;
    if (!(u >= lower && u <= upper)) ratios_.outside = true;
  }
  /// The same without bounds.
  void look_at_free(double u, double f, double terms) {
    not_finite_ += 0.0 * u + 0.0 * f + 0.0 * terms;
    const double natural = std::abs(f);
    if (natural > ratios_.worst * terms && natural > negligible_residual) ratios_.worst = natural / terms;
  }
  RowRatios ratios() const {
    RowRatios result = ratios_;
    if (std::isnan(not_finite_)) result.worst = std::numeric_limits<double>::infinity();
    return result;
  }

private:
  RowRatios ratios_;
  double not_finite_ = 0.0;  // or NaN
};

/// Of all rows of this rank.
RowRatios judge_rows(Vec u, Vec f, Vec lower, Vec upper, Vec terms);

}  // namespace sweepvi
