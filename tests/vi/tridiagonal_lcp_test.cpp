// The LCP of a tridiagonal M-matrix, against all sets of small problems, closed forms of large ones, and its
// own definition.
//
// ranks: 1
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "vi/tridiagonal_lcp.hpp"

namespace sweepvi::test {
namespace {

struct Tridiagonal {
  std::vector<double> lower, diagonal, upper;
  std::size_t size() const { return diagonal.size(); }
  std::vector<double> times(const std::vector<double>& x) const {
    std::vector<double> y(size());
    for (std::size_t i = 0; i < size(); ++i)
      y[i] = diagonal[i] * x[i] + (i > 0 ? lower[i] * x[i - 1] : 0.0) +
             (i + 1 < size() ? upper[i] * x[i + 1] : 0.0);
    return y;
  }
};

/// An M-matrix, not symmetric, in pieces where `cut` says so.
Tridiagonal random_matrix(std::size_t n, std::mt19937& generator, double cut) {
  std::uniform_real_distribution<double> number(0.0, 1.0);
  Tridiagonal T;
  for (std::size_t i = 0; i < n; ++i) {
    T.lower.push_back(number(generator) < cut ? 0.0 : -number(generator));
    T.upper.push_back(number(generator) < cut ? 0.0 : -number(generator));
    T.diagonal.push_back(-T.lower[i] - T.upper[i] + 0.01 + 0.1 * number(generator));
  }
  return T;
}

/// The one solution of 0 <= x _|_ T x + q >= 0, by trying all sets with Gauss's elimination.
std::vector<double> by_enumeration(const Tridiagonal& T, const std::vector<double>& q) {
  const std::size_t n = q.size();
  for (unsigned set = 0; set < 1U << n; ++set) {
    std::vector<std::vector<double>> a(n, std::vector<double>(n + 1, 0.0));
    for (std::size_t i = 0; i < n; ++i) {
      if ((set >> i & 1U) == 0) {
        a[i][i] = 1.0;
        continue;
      }
      a[i][i] = T.diagonal[i];
      if (i > 0) a[i][i - 1] = T.lower[i];
      if (i + 1 < n) a[i][i + 1] = T.upper[i];
      a[i][n] = -q[i];
    }
    for (std::size_t k = 0; k < n; ++k)
      for (std::size_t i = 0; i < n; ++i) {
        if (i == k) continue;
        const double factor = a[i][k] / a[k][k];
        for (std::size_t j = 0; j <= n; ++j)
          a[i][j] -= factor * a[k][j];
      }
    std::vector<double> x(n);
    bool good = true;
    for (std::size_t i = 0; i < n; ++i) {
      x[i] = a[i][n] / a[i][i];
      good = good && x[i] >= 0.0;
    }
    const std::vector<double> y = T.times(x);
    for (std::size_t i = 0; i < n; ++i)
      good = good && ((set >> i & 1U) != 0 || y[i] + q[i] >= 0.0);
    if (good) return x;
  }
  return {};
}

std::vector<double> solve(const Tridiagonal& T, const std::vector<double>& q,
                          const std::vector<double>& start) {
  TridiagonalLcp lcp(T.lower, T.diagonal, T.upper);
  EXPECT_TRUE(lcp.is_m_matrix());
  std::vector<double> w = T.times(start);
  for (std::size_t i = 0; i < w.size(); ++i)
    w[i] += q[i];
  std::vector<double> x(q.size());
  lcp.solve(w, start, x);
  for (std::size_t i = 0; i < x.size(); ++i)
    x[i] += start[i];
  return x;
}

TEST(TridiagonalLcp, IsThatOfAllSets) {
  std::mt19937 generator(1);
  std::uniform_real_distribution<double> number(-1.0, 1.0);
  for (int problem = 0; problem < 400; ++problem) {
    const std::size_t n = 1 + static_cast<std::size_t>(problem) % 9;
    const Tridiagonal T = random_matrix(n, generator, problem % 3 == 0 ? 0.3 : 0.0);
    std::vector<double> q(n), start(n, 0.0);
    for (std::size_t i = 0; i < n; ++i) {
      q[i] = number(generator) + 0.3;
      if (problem % 2 == 1) start[i] = std::max(0.0, number(generator));
    }
    const std::vector<double> exact = by_enumeration(T, q);
    ASSERT_EQ(exact.size(), n);
    const std::vector<double> x = solve(T, q, start);
    for (std::size_t i = 0; i < n; ++i) {
      EXPECT_NEAR(x[i], exact[i], 1e-12 * (1.0 + exact[i]));
      EXPECT_EQ(x[i] == 0.0, exact[i] == 0.0);
    }
  }
}

TEST(TridiagonalLcp, MeetsItsDefinitionWhereItIsLarge) {
  constexpr std::size_t n = 20000;
  std::mt19937 generator(2);
  std::normal_distribution<double> number(0.0, 1.0);
  const Tridiagonal T = random_matrix(n, generator, 0.0);
  for (const double mean : {-1.0, 0.0, 0.5, 1.0}) {
    std::vector<double> q(n);
    for (double& value : q)
      value = mean + number(generator);
    const std::vector<double> x = solve(T, q, std::vector<double>(n, 0.0));
    const std::vector<double> y = T.times(x);
    std::size_t positive = 0;
    for (std::size_t i = 0; i < n; ++i) {
      const double w = y[i] + q[i];
      positive += x[i] > 0.0 ? 1 : 0;
      EXPECT_GE(x[i], 0.0);
      if (x[i] > 0.0)
        EXPECT_LE(std::abs(w), 1e-12 * (1.0 + x[i]));
      else
        EXPECT_GE(w, 0.0);
    }
    EXPECT_GT(positive, n / 20);  // of both kinds
    EXPECT_LT(positive, n);
  }
}

// A row of touching balls hit at one end: the impulse goes through contact by contact, each of which would be
// open without it. 0 <= x _|_ (2, -1) x + q >= 0 with q = (-1, tiny, tiny, ...). Without ties, and from
// either end.
TEST(TridiagonalLcp, FollowsAPushThroughALongRow) {
  constexpr std::size_t n = 3000;
  constexpr double gap = 1e-9;
  Tridiagonal T;
  T.lower.assign(n, -1.0);
  T.upper.assign(n, -1.0);
  T.diagonal.assign(n, 2.0);
  // x_i = (1 - i/m) - gap (...): the continuous problem x'' = gap with x(-1) = 1 ends where x = x' = 0.
  for (const bool from_left : {true, false}) {
    std::vector<double> q(n, gap);
    q[from_left ? 0 : n - 1] = -1.0;
    const std::vector<double> x = solve(T, q, std::vector<double>(n, 0.0));
    const std::vector<double> y = T.times(x);
    for (std::size_t k = 0; k < n; ++k) {
      EXPECT_GT(x[k], 0.0);
      EXPECT_LE(std::abs(y[k] + q[k]), 1e-14);
      // x = a - (a/(n+1) - gap stuff): exact by superposition
      const double s = static_cast<double>(from_left ? k + 1 : n - k);
      const double m = static_cast<double>(n) + 1.0;
      const double exact = (1.0 + gap) * (1.0 - s / m) - 0.5 * gap * s * (m - s);
      EXPECT_NEAR(x[k], exact, 1e-9);
    }
  }
}

// A column under its weight: all contacts closed, of condition n^2. From a start near it only the change is
// solved for, to rounding of that change.
TEST(TridiagonalLcp, IsAsAccurateAsTheChange) {
  constexpr std::size_t n = 1000;
  Tridiagonal T;
  T.lower.assign(n, -1.0);
  T.upper.assign(n, -1.0);
  T.diagonal.assign(n, 2.0);
  T.diagonal.front() = 1.0;  // on the ground
  TridiagonalLcp lcp(T.lower, T.diagonal, T.upper);
  std::vector<double> load(n), y(n), w(n, 0.0);
  for (std::size_t i = 0; i < n; ++i)
    load[i] = 1e6 * static_cast<double>(n - i);
  w[n / 2] = -1e-12;  // far below the rounding of T load
  lcp.solve(w, load, y);
  const std::vector<double> change = T.times(y);
  for (std::size_t i = 0; i < n; ++i)
    EXPECT_NEAR(change[i] + w[i], 0.0, 1e-24);
  EXPECT_GT(y[0], 1e-10);
}

TEST(TridiagonalLcp, LeavesOutWhatIsPinned) {
  Tridiagonal T{{0, -1, -1}, {2, 2, 2}, {-1, -1, 0}};
  TridiagonalLcp lcp(T.lower, T.diagonal, T.upper);
  const std::vector<double> w = {-1.0, HUGE_VAL, -4.0}, x(3, 0.0);
  std::vector<double> y(3);
  lcp.solve(w, x, y);
  EXPECT_EQ(y, (std::vector<double>{0.5, 0.0, 2.0}));
}

TEST(TridiagonalLcp, KnowsWhatIsNoMMatrix) {
  EXPECT_TRUE(TridiagonalLcp({}, {}, {}).is_m_matrix());
  EXPECT_TRUE(TridiagonalLcp({0, -1}, {1, 1.1}, {-1, 0}).is_m_matrix());
  EXPECT_FALSE(TridiagonalLcp({0, -1}, {1, 1}, {-1, 0}).is_m_matrix());  // singular
  EXPECT_FALSE(TridiagonalLcp({0, 1}, {2, 2}, {-1, 0}).is_m_matrix());
  EXPECT_FALSE(TridiagonalLcp({0, -1}, {2, -2}, {-1, 0}).is_m_matrix());
}

}  // namespace
}  // namespace sweepvi::test
