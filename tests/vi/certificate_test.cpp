// What the certificate must not let pass: numbers that swallow each other, units that hide a distance, sums
// that overflow.
// ranks: 1
#include "vi/certificate.hpp"

#include <gtest/gtest.h>

#include "dvi/systems.hpp"
#include "vi/random_problems.hpp"

namespace sweepvi::test {
namespace {

constexpr double infinity = PETSC_INFINITY;

AffineBox one_unknown(double m, double q, double lower = 0.0, double upper = infinity) {
  return {MatrixXd::Constant(1, 1, m), VectorXd::Constant(1, q), VectorXd::Constant(1, lower),
          VectorXd::Constant(1, upper)};
}

/// Its worst ratio at u.
double ratio(const AffineBox& box, const VectorXd& u) {
  const auto vi = affine_vi(box);
  const CertificateOptions options;
  Certificate certificate(*vi, options);
  const Vector point = duplicate(vi->state());
  const Vector f = duplicate(vi->state());
  const Vector lower = duplicate(vi->state());
  const Vector upper = duplicate(vi->state());
  const Vector guess = duplicate(vi->state());
  vi->begin({1, 0.0, 0.0, 0.0}, lower.get(), upper.get(), guess.get());
  {
    const WriteArray values(point.get());
    for (PetscInt i = 0; i < values.size(); ++i)
      values[i] = u[i];
  }
  return certificate.worst_ratio(point.get(), lower.get(), upper.get(), f.get());
}
double ratio(const AffineBox& box, double u) {
  return ratio(box, VectorXd::Constant(1, u));
}

TEST(Certificate, LargeUnknownsDoNotSwallowForces) {
  // u = 2e20. At half of it F = -1 of terms 3, but u - F = u in floating point.
  EXPECT_NEAR(ratio(one_unknown(1e-20, -2.0), 1e20), 1.0 / 3.0, 1e-15);
  EXPECT_LE(ratio(one_unknown(1e-20, -2.0), 2e20), 1e-15);
}

TEST(Certificate, AnInfiniteBoundIsNoPlaceToRest) {
  // No solution: F = -1 everywhere that numbers reach.
  EXPECT_GT(ratio(one_unknown(0.0, -1.0), infinity), 0.1);
  EXPECT_GT(ratio(one_unknown(1e-320, -1.0), infinity), 0.1);
  const Solved solved = solve(one_unknown(1e-320, -1.0));
  EXPECT_FALSE(solved.report.certified);
}

TEST(Certificate, ADistanceCountsInTheUnitsOfTheRows) {
  // u = 1e-15; five times that is far away, though 5e-15 is little against the terms of F, 6.
  EXPECT_GT(ratio(one_unknown(1e15, -1.0), 5e-15), 0.1);
  EXPECT_LE(ratio(one_unknown(1e15, -1.0), 1e-15), 1e-15);
  // A mass of 1e-12 at rest, 1e-3 above its wall: no impulse, however small. (v, nu): 1e-12 v - nu, v + 1e-3.
  AffineBox mass{MatrixXd(2, 2), VectorXd(2), VectorXd(2), VectorXd::Constant(2, infinity)};
  mass.M << 1e-12, -1.0, 1.0, 0.0;
  mass.q << 0.0, 1e-3;
  mass.lower << PETSC_NINFINITY, 0.0;
  VectorXd kicked(2);
  kicked << 1.0, 1e-12;
  EXPECT_GT(ratio(mass, kicked), 0.1);
  EXPECT_EQ(ratio(mass, VectorXd::Zero(2)), 0.0);
}

TEST(Certificate, WhatIsNotFiniteCertifiesNothing) {
  AffineBox huge{MatrixXd::Constant(2, 2, 1.0), VectorXd::Constant(2, 1e300), VectorXd::Constant(2, -1.7e308),
                 VectorXd::Constant(2, 1.7e308)};
  huge.M(0, 1) = -1.0;  // F_0 = u_0 - u_1 + q, terms 3.4e308
  huge.q[0] = 0.0;
  EXPECT_EQ(ratio(huge, VectorXd::Constant(2, 1.7e308)), HUGE_VAL);
  for (const double bad : {HUGE_VAL, std::nan("")}) {
    EXPECT_EQ(ratio(one_unknown(1.0, bad), 0.0), HUGE_VAL);
    EXPECT_EQ(ratio(one_unknown(bad, 1.0), 0.0), HUGE_VAL);
    EXPECT_EQ(ratio(one_unknown(1.0, 1.0), bad), HUGE_VAL);
  }
}

// From a start that an absolute residual would take for the solution.
TEST(Certificate, TheSolverIsNotTakenInByASmallStart) {
  const ScopedOption none("-sweepvi_predictor", "none");
  for (const double m : {1e12, 1e15}) {
    const Solved solved = solve(one_unknown(m, -1.0), VectorXd::Constant(1, 5.0 / m));
    EXPECT_TRUE(solved.report.certified);
    EXPECT_NEAR(solved.u[0] * m, 1.0, 1e-10);
  }
}

TEST(Certificate, ExtremeScales) {
  const double tiny = std::numeric_limits<double>::denorm_min();
  struct Case {
    double m, q, lower, upper, u;
  };
  for (const Case& c : {Case{1e308, -1.7e308, 0, infinity, 1.7},
                        {1e300, -1e300, 0, infinity, 1},
                        {1e-300, -1e-300, 0, infinity, 1},
                        {1e300, 1e300, -1e300, 1e300, -1},
                        {1, -1e-310, 0, infinity, 1e-310},
                        {1, -tiny, 0, infinity, tiny},
                        {tiny, -tiny, 0, infinity, 1},
                        {1e-200, 1, 1e-200, infinity, 1e-200},
                        {1e200, 1, -1e200, infinity, -1e-200},
                        {0, 1, 0, infinity, 0}}) {
    const Solved solved = solve(one_unknown(c.m, c.q, c.lower, c.upper));
    EXPECT_TRUE(solved.report.certified) << c.m << " u + " << c.q;
    EXPECT_NEAR(solved.u[0], c.u, 1e-10 * std::abs(c.u)) << c.m << " u + " << c.q;
  }
  // The solution, 1e600, is no number.
  EXPECT_FALSE(solve(one_unknown(1e-300, -1e300)).report.certified);
}

}  // namespace
}  // namespace sweepvi::test
