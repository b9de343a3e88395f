// The Hausdorff distance of filled-in graphs, AB (66)-(69): against brute force, hand-made cases, and known
// bounds.
#include "sweepvi/filled_graph.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "measure/segment.hpp"
#include "sweepvi/error.hpp"

namespace sweepvi {
namespace {

double between(StoredTrajectory a, StoredTrajectory b, double tolerance = 1e-9) {
  return filled_graph_distance(MPI_COMM_WORLD, a, b, tolerance).value;
}

/// Least distance of p from a graph: every segment.
double brute_nearest(const GraphPoint& p, Trajectory& graph) {
  double best = distance(p, {graph.t()[0], graph.row(0)}, graph.components());
  for (std::size_t k = 0; k + 1 < graph.rows(); ++k)
    best = std::min(best, distance_to_segment(p, {graph.t()[k], graph.row(k)},
                                              {graph.t()[k + 1], graph.row(k + 1)}, graph.components()));
  return best;
}

/// Points so close to each other that the distance from the other graph is missed by at most `error`, for it
/// changes by at most as much as the point.
double brute_excess(Trajectory& a, Trajectory& b, double error) {
  const std::size_t n = a.components();
  double worst = 0.0;
  std::vector<double> x(n);
  for (std::size_t k = 0; k + 1 < a.rows(); ++k) {
    const double length = distance({a.t()[k], a.row(k)}, {a.t()[k + 1], a.row(k + 1)}, n);
    const int parts = 1 + static_cast<int>(length / (2.0 * error));
    for (int i = 0; i <= parts; ++i) {
      const double q = static_cast<double>(i) / parts;
      for (std::size_t j = 0; j < n; ++j)
        x[j] = (1.0 - q) * a.row(k)[j] + q * a.row(k + 1)[j];
      worst = std::max(worst, brute_nearest({(1.0 - q) * a.t()[k] + q * a.t()[k + 1], x.data()}, b));
    }
  }
  return worst;
}

/// The distance from a segment by golden sections of a convex function: no formula in common.
double searched(const GraphPoint& p, const GraphPoint& a, const GraphPoint& b, std::size_t n) {
  std::vector<double> x(n);
  const auto at = [&](double q) {
    for (std::size_t j = 0; j < n; ++j)
      x[j] = (1.0 - q) * a.x[j] + q * b.x[j];
    return distance(p, {(1.0 - q) * a.t + q * b.t, x.data()}, n);
  };
  double low = 0.0, high = 1.0;
  for (int i = 0; i < 200; ++i) {
    const double l = low + (high - low) / 3.0, r = high - (high - low) / 3.0;
    (at(l) < at(r) ? high : low) = at(l) < at(r) ? r : l;
  }
  return std::min({at(0.0), at(1.0), at(0.5 * (low + high))});
}

TEST(Segment, AgreesWithASearchAlongIt) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> number(-1.0, 1.0);
  for (int trial = 0; trial < 3000; ++trial) {
    const std::size_t n = 1 + static_cast<std::size_t>(trial % 4);
    std::vector<double> p(n), a(n), b(n);
    for (std::size_t j = 0; j < n; ++j) {
      p[j] = number(random);
      a[j] = number(random);
      b[j] = trial % 5 == 0 ? a[j] : number(random);
    }
    const double s = number(random), duration = trial % 3 == 0 ? 0.0 : std::abs(number(random));
    const GraphPoint from{number(random), p.data()}, first{s, a.data()}, last{s + duration, b.data()};
    // The search ends where a convex function is flat to rounding: the square root of it.
    EXPECT_NEAR(distance_to_segment(from, first, last, n), searched(from, first, last, n), 1e-8);
    EXPECT_LE(distance_to_segment(from, first, last, n) - searched(from, first, last, n), 1e-14);
  }
}

TEST(Segment, KeepsItsDigitsBesideALongJump) {
  const double p[] = {0.3, 1e-9}, a[] = {-1e3, 0.0}, b[] = {1e3, 0.0};
  // 1e3 * rounding: that much the foot of the perpendicular moves, and the distance by its square.
  EXPECT_NEAR(distance_to_segment({1.0, p}, {1.0, a}, {1.0, b}, 2), 1e-9, 1e-15);
}

StoredTrajectory random_polyline(std::mt19937& random, std::size_t rows, std::size_t components) {
  std::uniform_real_distribution<double> step(0.0, 1.0);
  std::normal_distribution<double> move(0.0, 1.0);
  std::vector<double> t{0.0}, x(components);
  for (std::size_t k = 1; k < rows; ++k) {
    const bool jump = step(random) < 0.3;
    t.push_back(t.back() + (jump ? 0.0 : step(random)));
    for (std::size_t j = 0; j < components; ++j)
      x.push_back(x[x.size() - components] + (jump ? 3.0 : 0.5) * move(random));
  }
  return {t, x};
}

TEST(FilledGraph, AgreesWithBruteForceOnRandomPolylinesWithJumps) {
  std::mt19937 random(11);
  constexpr double error = 1e-3;
  double inside = 0.0;
  for (int trial = 0; trial < 60; ++trial) {
    const std::size_t components = 1 + static_cast<std::size_t>(trial % 5);
    StoredTrajectory a = random_polyline(random, 20, components);
    StoredTrajectory b = random_polyline(random, 25, components);
    const double brute = std::max(brute_excess(a, b, error), brute_excess(b, a, error));
    const GraphDistance found = filled_graph_distance(MPI_COMM_WORLD, a, b, 1e-6);
    EXPECT_NEAR(found.value, brute, error + 1e-6) << "trial " << trial;
    EXPECT_GE(found.value + 1e-6, brute) << "trial " << trial;  // brute force only knows attained distances
    double vertices = 0.0;
    for (std::size_t k = 0; k < a.rows(); ++k)
      vertices = std::max(vertices, brute_nearest({a.t()[k], a.row(k)}, b));
    for (std::size_t k = 0; k < b.rows(); ++k)
      vertices = std::max(vertices, brute_nearest({b.t()[k], b.row(k)}, a));
    inside = std::max(inside, found.value - vertices);
  }
  EXPECT_GT(inside, 0.05) << "no distance was reached inside a segment: the cases are too easy";
}

TEST(FilledGraph, FindsWhatIsFarInsideASegment) {
  // From (0, 0) to (4, 0), and a detour through (0, 0), (0, 2), (4, 2), (4, 0): the middle is 2 away from it,
  // in time.
  const StoredTrajectory straight({0.0, 4.0}, {0.0, 0.0});
  const StoredTrajectory detour({0.0, 0.0, 4.0, 4.0}, {0.0, 2.0, 2.0, 0.0});
  EXPECT_NEAR(between(straight, detour), 2.0, 1e-9);
  const StoredTrajectory low({0.0, 10.0}, {0.0, 0.0});
  const StoredTrajectory high({0.0, 0.0, 10.0, 10.0}, {0.0, 3.0, 3.0, 0.0});
  EXPECT_NEAR(between(low, high), 3.0, 1e-9);
}

TEST(FilledGraph, OfAJumpThatComesLaterIsItsDelay) {
  constexpr double delay = 1e-3;
  const StoredTrajectory early({0.0, 1.0, 1.0, 2.0}, {0.0, 0.0, 50.0, 50.0});
  const StoredTrajectory late({0.0, 1.0 + delay, 1.0 + delay, 2.0}, {0.0, 0.0, 50.0, 50.0});
  EXPECT_NEAR(between(early, late), delay, 1e-9 + 1e-15);
  // Recorded in steps it is a steep segment.
  const StoredTrajectory steep({0.0, 1.0, 1.0 + delay, 2.0}, {0.0, 0.0, 50.0, 50.0});
  EXPECT_NEAR(between(early, steep), delay, delay * 0.5);
}

TEST(FilledGraph, OfShiftedCurvesIsTheSmallerOfShiftAndDifference) {
  // x = t against x = t + 1: at slope 1 both halves, in time and in space, are 1/2.
  EXPECT_NEAR(between({{0.0, 9.0}, {0.0, 9.0}}, {{0.0, 9.0}, {1.0, 10.0}}), 1.0, 1e-9);  // at the ends
  EXPECT_NEAR(between({{0.0, 9.0}, {0.0, 0.0}}, {{0.0, 9.0}, {0.25, 0.25}}), 0.25, 1e-9);
}

TEST(FilledGraph, OfAGraphAndItselfIsZero) {
  std::mt19937 random(3);
  const StoredTrajectory a = random_polyline(random, 200, 3);
  EXPECT_LE(between(a, a), 1e-13);  // feet of perpendiculars, to rounding of x
}

TEST(FilledGraph, IsTheSameWhicheverComesFirst) {
  std::mt19937 random(4);
  for (int trial = 0; trial < 10; ++trial) {
    const StoredTrajectory a = random_polyline(random, 60, 2), b = random_polyline(random, 40, 2);
    EXPECT_NEAR(between(a, b), between(b, a), 1e-9);
  }
}

TEST(FilledGraph, TakesGraphsOfOneRow) {
  EXPECT_NEAR(between({{1.0}, {2.0}}, {{1.0, 2.0}, {2.0, 5.0}}), 3.0, 1e-9);
  EXPECT_NEAR(between({{1.0}, {2.0}}, {{4.0}, {2.5}}), 3.0, 1e-9);
}

TEST(FilledGraph, RefusesWhatHasNoDistance) {
  EXPECT_THROW(between({{0.0}, {1.0}}, {{0.0}, {1.0, 2.0}}), Error);
  EXPECT_THROW(between({{0.0}, {1.0}}, {{0.0}, {1.0}}, 0.0), Error);
  EXPECT_THROW(StoredTrajectory({1.0, 0.0}, {1.0, 2.0}), Error);
  EXPECT_THROW(StoredTrajectory({0.0, 1.0}, {1.0, NAN}), Error);
  EXPECT_THROW(StoredTrajectory({}, {}), Error);
}

}  // namespace
}  // namespace sweepvi
