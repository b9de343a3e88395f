// Where a polynomial becomes negative first: against products of known roots.
// ranks: 1
#include "hybrid/first_root.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

namespace sweepvi {
namespace {

/// scale * product of (root - tau)
std::vector<double> with_roots(const std::vector<double>& roots, double scale = 1.0) {
  std::vector<double> c{scale};
  for (const double root : roots) {
    c.push_back(0.0);
    for (std::size_t k = c.size() - 1; k > 0; --k)
      c[k] = root * c[k] - c[k - 1];
    c[0] *= root;
  }
  return c;
}

TEST(FirstRoot, IsTheSmallestOne) {
  const auto root = first_root(with_roots({0.7, 0.3, 2.0}), 1.0);
  ASSERT_TRUE(root);
  EXPECT_NEAR(*root, 0.3, 1e-15);
}

TEST(FirstRoot, OfNoneInTheInterval) {
  EXPECT_FALSE(first_root(with_roots({1.1, 1.2, 1.3}), 1.0));
  EXPECT_FALSE(first_root(std::vector<double>{1.0, 0.0, 1.0}, 10.0));
  EXPECT_FALSE(first_root(std::vector<double>{0.0, 0.0, 0.0}, 1.0));
}

TEST(FirstRoot, OfADipBetweenPositiveEnds) {
  // Positive at 0 and at 1, negative between the two roots only.
  const auto root = first_root(with_roots({0.5, 0.5001}), 1.0);
  ASSERT_TRUE(root);
  EXPECT_NEAR(*root, 0.5, 1e-12);  // slope 1e-4: rounding of the coefficients over the slope
}

TEST(FirstRoot, OfATouchIsNone) {
  EXPECT_FALSE(first_root(std::vector<double>{1.0, -2.0, 1.0}, 2.0));  // (1 - tau)^2
}

TEST(FirstCrossing, IsNoDipBelowTheNoise) {
  // Below zero between the two roots by 2.5e-9, and on its way from 0.8.
  const std::vector<double> c = with_roots({0.5, 0.5001, 0.8});
  const double depth = 0.25e-8 * 0.3;
  EXPECT_NEAR(first_crossing(c, 1.0, 0.5 * depth).value(), 0.5, 1e-12);
  EXPECT_NEAR(first_crossing(c, 1.0, 2.0 * depth).value(), 0.8, 1e-14);
  EXPECT_FALSE(first_crossing(c, 0.7, 2.0 * depth));
  // It ends on its way.
  EXPECT_NEAR(first_crossing(with_roots({0.8}), 0.8 + 1e-9, 1e-6).value(), 0.8, 1e-15);
  EXPECT_EQ(first_crossing(std::vector<double>{0.0, -1.0, 5.0}, 1.0, 1e-3), 0.0);
  EXPECT_FALSE(first_crossing(std::vector<double>{0.0, -1e-17, 5.0}, 1.0, 1e-15));
}

TEST(FirstRoot, ThatBeginsAtZero) {
  // Leaves with tau^3, comes back at tau = 0.5.
  std::vector<double> c = with_roots({0.5});
  c.insert(c.begin(), 3, 0.0);
  const auto root = first_root(c, 1.0);
  ASSERT_TRUE(root);
  EXPECT_NEAR(*root, 0.5, 1e-15);
  EXPECT_EQ(first_root(std::vector<double>{0.0, -1.0, 5.0}, 1.0), 0.0);  // at once
  EXPECT_EQ(first_root(std::vector<double>{-1e-20, 1.0}, 1.0), 0.0);
}

TEST(FirstRoot, OfRandomPolynomials) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> number(0.05, 3.0);
  for (int trial = 0; trial < 2000; ++trial) {
    std::vector<double> roots;
    for (int k = 0; k <= trial % 7; ++k)
      roots.push_back(number(random));
    const std::vector<double> c = with_roots(roots, std::pow(10.0, trial % 9 - 4));
    std::sort(roots.begin(), roots.end());
    const auto root = first_root(c, 2.0);
    double slope = 1.0, size = 1.0;  // over the scale
    for (std::size_t k = 1; k < roots.size(); ++k) {
      slope *= roots[k] - roots[0];
      size *= roots[k] + roots[0];
    }
    if (roots[0] > 2.0) {
      EXPECT_FALSE(root) << "trial " << trial;
      continue;
    }
    ASSERT_TRUE(root) << "trial " << trial;
    // Rounding of the coefficients, over the slope; two roots that close cannot be told from none.
    EXPECT_NEAR(*root, roots[0], 1e-14 * size / slope * (1.0 + roots[0])) << "trial " << trial;
  }
}

}  // namespace
}  // namespace sweepvi
