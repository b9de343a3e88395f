#include "vi/tridiagonal_lcp.hpp"

#include <algorithm>
#include <utility>

namespace sweepvi {

TridiagonalLcp::TridiagonalLcp(std::vector<double> lower, std::vector<double> diagonal,
                               std::vector<double> upper)
    : lower_(std::move(lower)),
      diagonal_(std::move(diagonal)),
      upper_(std::move(upper)),
      factor_(diagonal_.size()) {
  constexpr double least_pivot = 1e-13;  // of its diagonal
  const std::size_t n = size();
  if (n == 0) {
    is_m_matrix_ = true;
    return;
  }
  lower_.front() = 0.0;
  upper_.back() = 0.0;
  is_m_matrix_ = true;
  double pivot = 1.0;
  for (std::size_t i = 0; i < n; ++i) {
    pivot = diagonal_[i] - (i > 0 ? lower_[i] * upper_[i - 1] / pivot : 0.0);
    if (!(lower_[i] <= 0.0 && upper_[i] <= 0.0 && pivot > least_pivot * diagonal_[i])) {
      is_m_matrix_ = false;
      return;
    }
  }
}

TridiagonalLcp::Run TridiagonalLcp::single(std::ptrdiff_t i, double q) const {
  const double c = 1.0 / diagonal_[static_cast<std::size_t>(i)];
  return {i, i, {-q * c, c, c}, {-q * c, c, c}};
}

// Of neighbours: with x the last component of `left` and y the first of `right`, which act on each other,
// x = b0 + b1 s + b2 U y and y = a0' + a1' L x + a2' t.
TridiagonalLcp::Run TridiagonalLcp::join(const Run& left, const Run& right) const {
  const double U = -upper_[static_cast<std::size_t>(left.last)];
  const double L = -lower_[static_cast<std::size_t>(right.first)];
  const double to_left = left.b[2] * U;
  const double to_right = right.a[1] * L;
  const double c = 1.0 / (1.0 - to_left * to_right);
  const double x[3] = {c * (left.b[0] + to_left * right.a[0]), c * left.b[1], c * to_left * right.a[2]};
  const double y[3] = {c * (right.a[0] + to_right * left.b[0]), c * to_right * left.b[1], c * right.a[2]};
  Run both{left.first, right.last, {}, {}};
  const double on_left = left.a[2] * U;
  const double on_right = right.b[1] * L;
  both.a[0] = left.a[0] + on_left * y[0];
  both.a[1] = left.a[1] + on_left * y[1];
  both.a[2] = on_left * y[2];
  both.b[0] = right.b[0] + on_right * x[0];
  both.b[1] = on_right * x[1];
  both.b[2] = right.b[2] + on_right * x[2];
  return both;
}

void TridiagonalLcp::find_runs(std::span<const double> w, std::span<const double> x) {
  runs_.clear();
  const auto n = static_cast<std::ptrdiff_t>(size());
  const auto at = [](std::span<const double> values, std::ptrdiff_t i) {
    return values[static_cast<std::size_t>(i)];
  };
  // w at x = 0
  const auto known = [&](std::ptrdiff_t i) {
    double q = at(w, i) - at(diagonal_, i) * at(x, i);
    if (i > 0) q -= at(lower_, i) * at(x, i - 1);
    if (i + 1 < n) q -= at(upper_, i) * at(x, i + 1);
    return q;
  };
  const auto ends_at = [&](std::ptrdiff_t i) { return !runs_.empty() && runs_.back().last == i; };
  for (std::ptrdiff_t i = 0; i < n; ++i) {
    const double q = known(i);
    const double pushed = ends_at(i - 1) ? at(lower_, i) * runs_.back().b[0] : 0.0;
    if (!(q + pushed < 0.0)) continue;
    Run run = single(i, q);
    for (;;) {
      if (ends_at(run.first - 1)) {
        run = join(runs_.back(), run);
        runs_.pop_back();
      }
      const std::ptrdiff_t before = run.first - 1;  // at its bound so far
      if (before < 0 || at(upper_, before) == 0.0) break;
      const double q_before = known(before);
      const double from_left = ends_at(before - 1) ? at(lower_, before) * runs_.back().b[0] : 0.0;
      if (!(q_before + from_left + at(upper_, before) * run.a[0] < 0.0)) break;
      run = join(single(before, q_before), run);
    }
    runs_.push_back(run);
  }
}

// T y = -w on [first, last], where y beyond is given.
void TridiagonalLcp::eliminate(std::ptrdiff_t first, std::ptrdiff_t last, std::span<const double> w,
                               std::span<double> y) {
  const auto n = static_cast<std::ptrdiff_t>(size());
  const auto begin = static_cast<std::size_t>(first);
  const auto end = static_cast<std::size_t>(last) + 1;
  double right = -w[begin] - (first > 0 ? lower_[begin] * y[begin - 1] : 0.0);
  double inverse = 1.0 / diagonal_[begin];
  for (std::size_t i = begin;; ++i) {
    if (i + 1 == end) {
      if (last + 1 < n) right -= upper_[i] * y[i + 1];
      y[i] = right * inverse;
      break;
    }
    y[i] = right * inverse;
    factor_[i] = upper_[i] * inverse;
    right = -w[i + 1] - lower_[i + 1] * y[i];
    inverse = 1.0 / (diagonal_[i + 1] - lower_[i + 1] * factor_[i]);
  }
  for (std::size_t i = end - 1; i-- > begin;)
    y[i] -= factor_[i] * y[i + 1];
}

void TridiagonalLcp::solve(std::span<const double> w, std::span<const double> x, std::span<double> y) {
  find_runs(w, x);
  std::transform(x.begin(), x.end(), y.begin(), [](double value) { return -value; });
  for (const Run& run : runs_)
    eliminate(run.first, run.last, w, y);
}

void TridiagonalLcp::solve_free(std::span<const double> w, std::span<double> y) {
  if (size() > 0) eliminate(0, static_cast<std::ptrdiff_t>(size()) - 1, w, y);
}

}  // namespace sweepvi
