// Distances of trajectories at equal times, and of their events: hand-made cases with known answers.
#include "sweepvi/trajectory_error.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <random>

#include "measure/mean_norm.hpp"
#include "sweepvi/error.hpp"

namespace sweepvi {
namespace {

constexpr double eps = 2.3e-16;

TrajectoryError between(StoredTrajectory a, StoredTrajectory b, const std::vector<TimeSpan>& jumps = {}) {
  return trajectory_error(MPI_COMM_WORLD, a, b, jumps);
}

double norm(const std::vector<long double>& x) {
  long double sum = 0.0L;
  for (const long double value : x)
    sum += value * value;
  return static_cast<double>(std::sqrt(sum));
}

/// The integral of a norm along a line, by Simpson's rule on pieces that shrink towards the point nearest to
/// the origin, in extended precision.
double searched(const std::vector<double>& p, const std::vector<double>& q) {
  const auto value = [&](long double s) {
    std::vector<long double> x;
    for (std::size_t i = 0; i < p.size(); ++i)
      x.push_back((1.0L - s) * p[i] + s * q[i]);
    return static_cast<long double>(norm(x));
  };
  long double pq = 0.0L, ll = 0.0L;
  for (std::size_t i = 0; i < p.size(); ++i) {
    const long double l = static_cast<long double>(q[i]) - p[i];
    pq -= p[i] * l;
    ll += l * l;
  }
  const long double nearest = ll > 0.0L ? std::min(std::max(pq / ll, 0.0L), 1.0L) : 0.0L;
  long double sum = 0.0L;
  for (const long double end : {0.0L, 1.0L}) {
    long double far = end;
    for (int piece = 0; piece < 60; ++piece) {  // halves, down to 2^-60 of the whole
      const long double near = piece == 59 ? nearest : 0.5L * (far + nearest);
      for (int i = 0; i < 64; ++i) {
        const long double a = far + (near - far) * i / 64, b = far + (near - far) * (i + 1) / 64;
        sum += std::abs(b - a) / 6.0L * (value(a) + 4.0L * value(0.5L * (a + b)) + value(b));
      }
      far = near;
    }
  }
  return static_cast<double>(sum);
}

TEST(MeanNorm, AgreesWithQuadrature) {
  std::mt19937 random(2);
  std::normal_distribution<double> number;
  for (int trial = 0; trial < 60; ++trial) {
    const std::size_t n = 1 + static_cast<std::size_t>(trial % 4);
    std::vector<double> p(n), q(n);
    const double close = trial % 3 == 0 ? 1.0 : std::pow(10.0, -(trial % 15));
    for (std::size_t i = 0; i < n; ++i) {
      p[i] = number(random);
      // Close to p; close to its opposite, past the origin; or anywhere.
      q[i] = (trial % 3 == 1 ? p[i] : trial % 3 == 2 ? -2.0 * p[i] : 0.0) + close * number(random);
    }
    const double exact = searched(p, q);
    // Simpson's error on 64 parts of a piece is below (1/64)^4 / 2880 of it; the values are rounded.
    EXPECT_NEAR(mean_norm(p.data(), q.data(), n), exact, 4e-11 * exact) << "trial " << trial;
  }
}

TEST(MeanNorm, KeepsItsDigitsWhereTheFormulaWouldCancel) {
  // Nearly constant: 1 + l/2 exactly along the line, sqrt(1 + l^2/3) = 1 + l^2/6 across.
  for (const double l : {1e-3, 1e-8, 1e-12, 1e-16, 0.0}) {
    const double p[] = {1.0, 0.0}, along[] = {1.0 + l, 0.0}, across[] = {1.0, l};
    EXPECT_NEAR(mean_norm(p, along, 2), 1.0 + 0.5 * (along[0] - 1.0), 4 * eps) << l;
    EXPECT_NEAR(mean_norm(p, across, 2), 1.0 + l * l / 6.0, 4 * eps + l * l * l * l) << l;
  }
  // Past the origin, at any distance: (1 + 4)/2 / 3 of the way from -1 to 2, and next to nothing of it aside.
  for (const double r : {0.0, 1e-160, 1e-20, 1e-9}) {
    const double p[] = {-1.0, r}, q[] = {2.0, r};
    EXPECT_NEAR(mean_norm(p, q, 2), 5.0 / 6.0, 4 * eps + 20.0 * r * r) << r;  // r^2 log(1/r), and so on
  }
  // A difference that is small against both ends: only its own size counts.
  const double p[] = {1e8}, q[] = {1e8 + 2.0};
  EXPECT_EQ(mean_norm(p, q, 1), 1e8 + 1.0);
  EXPECT_EQ(mean_norm(p, p, 1), 1e8);
  const double nothing[] = {0.0, 0.0};
  EXPECT_EQ(mean_norm(nothing, nothing, 2), 0.0);
}

TEST(TrajectoryError, OfTwoLines) {
  // (3, 4) t against 0, on [0, 2] and [-1, 1]: 5 t over the common time [0, 1].
  const TrajectoryError found =
      between({{0.0, 2.0}, {0.0, 0.0, 6.0, 8.0}}, {{-1.0, 1.0}, {0.0, 0.0, 0.0, 0.0}});
  EXPECT_EQ(found.start, 0.0);
  EXPECT_EQ(found.end, 1.0);
  EXPECT_NEAR(found.sup.value(), 5.0, 10 * eps);
  EXPECT_EQ(found.sup_t, 1.0);
  EXPECT_NEAR(found.l1, 2.5, 10 * eps);
  EXPECT_NEAR(found.final, 5.0, 10 * eps);
  EXPECT_EQ(found.left_out, 0.0);
}

TEST(TrajectoryError, CountsBothLimitsAtAJump) {
  // A spike of height 3 at t = 1 has no area, and is the supremum of neither: its feet are.
  const TrajectoryError spike =
      between({{0.0, 1.0, 1.0, 1.0, 2.0}, {0.0, 0.0, 3.0, 0.0, 0.0}}, {{0.0, 2.0}, {0.0, 0.0}});
  EXPECT_EQ(spike.sup.value(), 0.0);
  EXPECT_EQ(spike.l1, 0.0);
  // A step from 0 to 3 at t = 1 against 1: before 1, after 2.
  const TrajectoryError step =
      between({{0.0, 1.0, 1.0, 2.0}, {0.0, 0.0, 3.0, 3.0}}, {{0.0, 2.0}, {1.0, 1.0}});
  EXPECT_EQ(step.sup.value(), 2.0);
  EXPECT_NEAR(step.l1, 3.0, 10 * eps);
  // The same jump at the same time, seen on both sides.
  const TrajectoryError same = between({{0.0, 1.0, 1.0, 2.0}, {0.0, 0.0, 3.0, 3.0}},
                                       {{0.0, 0.5, 1.0, 1.0, 2.0}, {0.5, 0.5, 0.5, 3.0, 3.0}});
  EXPECT_EQ(same.sup.value(), 0.5);
  EXPECT_NEAR(same.l1, 0.5, 10 * eps);
  EXPECT_EQ(same.final, 0.0);
}

TEST(TrajectoryError, LeavesOutWhatIsNearJumps) {
  // Steps of height 5 that end at 1 and at 1.5, rows every 1/8 and every 1/4; elsewhere 0.01 apart, from t =
  // 2 on 0.02.
  std::vector<double> s, x, t, y;
  for (int k = 0; k <= 24; ++k) {
    s.push_back(k / 8.0);
    x.push_back(k >= 8 ? 5.0 : 0.0);
  }
  for (int k = 0; k <= 12; ++k) {
    t.push_back(k / 4.0);
    y.push_back((k >= 6 ? 5.0 : 0.0) + (k >= 8 ? 0.02 : 0.01));
  }
  const EventErrors events = compare_events({{1.0, 0, 1, true}}, {{1.5, 0, 1, true}});
  EXPECT_EQ(events.matched, 1U);
  EXPECT_EQ(events.largest, 0.5);
  const TrajectoryError found = between({s, x}, {t, y}, events.spans);
  EXPECT_NEAR(found.sup.value(), 0.02, 30 * eps);  // x is 5
  EXPECT_GE(found.sup_t, 2.0);
  // From 0.75, the row of B before 1, to 1.75, its next after 1.5.
  EXPECT_NEAR(found.left_out, 1.0 / 3.0, 10 * eps);
  EXPECT_NEAR(between({s, x}, {t, y}).sup.value(), 5.0, 0.02);  // not left out, it is the jump
  // All of the time is near a jump: there is no supremum.
  const TrajectoryError none = between({s, x}, {t, y}, {{0.0, 3.0}});
  EXPECT_FALSE(none.sup);
  EXPECT_EQ(none.left_out, 1.0);
  EXPECT_EQ(none.l1, found.l1);  // which leaves nothing out
}

TEST(TrajectoryError, AgreesWithTheMergedGridByHand) {
  // Random polylines on grids that do not meet: sums over the merged grid, by hand.
  std::mt19937 random(7);
  std::normal_distribution<double> number;
  std::uniform_real_distribution<double> step(0.01, 0.2);
  const auto polyline = [&](std::size_t rows) {
    std::vector<double> t{0.0}, x{number(random), number(random)};
    while (t.size() < rows) {
      t.push_back(t.back() + step(random));
      x.push_back(number(random));
      x.push_back(number(random));
    }
    return StoredTrajectory(t, x);
  };
  StoredTrajectory a = polyline(100), b = polyline(70);
  const auto at = [](StoredTrajectory& graph, double t, int i) {
    std::size_t k = 0;
    while (k + 2 < graph.rows() && graph.t()[k + 1] <= t)
      ++k;
    const double part = (t - graph.t()[k]) / (graph.t()[k + 1] - graph.t()[k]);
    return graph.row(k)[i] + part * (graph.row(k + 1)[i] - graph.row(k)[i]);
  };
  const double end = std::min(a.t().back(), b.t().back());
  std::vector<double> merged;
  for (const auto* t : {&a.t(), &b.t()})
    std::copy_if(t->begin(), t->end(), std::back_inserter(merged), [&](double s) { return s <= end; });
  std::sort(merged.begin(), merged.end());
  double sup = 0.0, l1 = 0.0;
  for (std::size_t k = 0; k < merged.size(); ++k) {
    const auto difference = [&](double t) {
      return std::array{at(a, t, 0) - at(b, t, 0), at(a, t, 1) - at(b, t, 1)};
    };
    const auto d = difference(merged[k]);
    sup = std::max(sup, std::hypot(d[0], d[1]));
    if (k == 0) continue;
    const auto c = difference(merged[k - 1]);
    l1 += (merged[k] - merged[k - 1]) * mean_norm(c.data(), d.data(), 2);
  }
  const TrajectoryError found = trajectory_error(MPI_COMM_WORLD, a, b, {});
  EXPECT_NEAR(found.sup.value(), sup, 100 * eps);  // interpolated in another order
  EXPECT_NEAR(found.l1, l1, 1000 * eps * l1);
  EXPECT_EQ(found.end, end);
}

TEST(TrajectoryError, TakesAnInstantAndRefusesWhatCannotBeCompared) {
  const TrajectoryError instant = between({{1.0}, {2.0}}, {{0.0, 2.0}, {0.0, 4.0}});
  EXPECT_EQ(instant.sup.value(), 0.0);
  EXPECT_EQ(between({{1.0}, {2.0}}, {{1.0}, {5.0}}).sup.value(), 3.0);
  EXPECT_EQ(between({{1.0}, {2.0}}, {{1.0}, {5.0}}).l1, 0.0);
  EXPECT_THROW(between({{0.0}, {1.0}}, {{0.0}, {1.0, 2.0}}), Error);
  EXPECT_THROW(between({{0.0, 1.0}, {1.0, 1.0}}, {{2.0, 3.0}, {1.0, 1.0}}), Error);
}

TEST(Events, ArePairedByConstraintLevelAndKind) {
  const std::vector<EventTime> a = {
      {1.0, 0, 1, true}, {2.0, 0, 2, true}, {3.0, 0, 3, false}, {4.0, 1, 1, true}};
  const std::vector<EventTime> b = {{1.25, 0, 1, true}, {2.0, 0, 1, true}, {3.5, 0, 1, false}};
  const EventErrors found = compare_events(a, b);
  EXPECT_EQ(found.matched, 2U);  // a lift-off is one from all levels
  EXPECT_EQ(found.unmatched_a, 2U);
  EXPECT_EQ(found.unmatched_b, 1U);
  EXPECT_EQ(found.largest, 0.5);
  EXPECT_EQ(found.t, 3.0);
  ASSERT_EQ(found.spans.size(), 5U);
  EXPECT_EQ(found.spans[0].first, 1.0);
  EXPECT_EQ(found.spans[0].last, 1.25);
  EXPECT_EQ(compare_events(b, a).t, 3.5);
}

TEST(Events, LeavesOverThoseWithoutWhichTheOthersAreNearest) {
  const auto impacts = [](const std::vector<double>& times) {
    std::vector<EventTime> events;
    for (const double t : times)
      events.push_back({t, 0, 1, true});
    return events;
  };
  // One missed in the middle, one at the beginning; everything 0.01 late.
  const EventErrors found = compare_events(impacts({1.0, 2.0, 3.0, 4.0, 5.0}), impacts({2.01, 3.01, 5.01}));
  EXPECT_EQ(found.matched, 3U);
  EXPECT_EQ(found.unmatched_a, 2U);
  EXPECT_NEAR(found.largest, 0.01, 5 * eps);
  EXPECT_EQ(compare_events({}, impacts({1.0})).unmatched_b, 1U);
  EXPECT_EQ(compare_events({}, {}).matched, 0U);

  // Against every choice.
  std::mt19937 random(9);
  std::uniform_real_distribution<double> time(0.0, 1.0);
  for (int trial = 0; trial < 50; ++trial) {
    std::vector<double> few(4), many(7);
    for (std::vector<double>* times : {&few, &many}) {
      for (double& t : *times)
        t = time(random);
      std::sort(times->begin(), times->end());
    }
    double least = 1e9;
    for (unsigned chosen = 0; chosen < 128; ++chosen) {
      double sum = 0.0;
      std::size_t i = 0;
      for (std::size_t j = 0; j < 7; ++j) {
        if ((chosen >> j & 1U) == 0) continue;
        if (i < 4) sum += std::abs(few[i] - many[j]);
        ++i;
      }
      if (i == 4) least = std::min(least, sum);
    }
    double sum = 0.0;
    for (const TimeSpan& span : compare_events(impacts(many), impacts(few)).spans)
      sum += span.last - span.first;
    EXPECT_NEAR(sum, least, 20 * eps) << "trial " << trial;
  }
}

TEST(TrajectoryError, EachComponentHasItsOwnUnit) {
  // A position in metres off by 1 in 1000, and a small angle off by 1 in 4, which one norm does not see.
  const TrajectoryError error = between({{0.0, 1.0, 2.0}, {0.0, 0.0, 500.0, 2e-3, 1000.0, 3e-3}},
                                        {{0.0, 2.0}, {0.0, 0.0, 1001.0, 4e-3}});
  EXPECT_NEAR(error.sup.value(), 1.0, 1e-6);
  EXPECT_NEAR(error.relative.value(), 0.25, 4 * eps);  // 1e-3 of 4e-3
  EXPECT_EQ(error.relative_component, 1U);
  // A component that is 0 in both is not apart, and what is all the same is not, either.
  const TrajectoryError none =
      between({{0.0, 1.0}, {0.0, 2.0, 0.0, 3.0}}, {{0.0, 1.0}, {0.0, 2.0, 0.0, 3.0}});
  EXPECT_EQ(none.relative.value(), 0.0);
}

}  // namespace
}  // namespace sweepvi
