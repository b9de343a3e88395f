// Lemke's method on affine box VIs: against enumeration of all bases, and on matrices of every kind.
// ranks: 1
#include <gtest/gtest.h>
#include <petscsys.h>

#include <Eigen/Dense>
#include <random>

#include "vi/affine_box.hpp"

namespace sweepvi::test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

class Numbers {
public:
  explicit Numbers(unsigned seed) : engine_(seed) {}
  double operator()() { return uniform_(engine_); }  // [-1, 1)
  VectorXd vector(Index n) {
    return VectorXd::NullaryExpr(n, [this] { return (*this)(); });
  }
  MatrixXd matrix(Index rows, Index columns) {
    return MatrixXd::NullaryExpr(rows, columns, [this] { return (*this)(); });
  }

private:
  std::mt19937 engine_;
  std::uniform_real_distribution<double> uniform_{-1.0, 1.0};
};

/// max |u - mid(l, b, u - F)|
double natural_residual(const AffineBox& box, const VectorXd& u) {
  const VectorXd F = box.M * u + box.q;
  return (u - (u - F).cwiseMax(box.lower).cwiseMin(box.upper)).cwiseAbs().maxCoeff();
}

AffineBox with_bounds(MatrixXd M, VectorXd q, double lower, double upper) {
  const Index n = q.size();
  return {std::move(M), std::move(q), VectorXd::Constant(n, lower), VectorXd::Constant(n, upper)};
}

/// All solutions of the LCP w = M z + q: one for each of the 2^n choices of what may be positive.
std::vector<VectorXd> enumerate(const MatrixXd& M, const VectorXd& q) {
  const Index n = q.size();
  std::vector<VectorXd> solutions;
  for (unsigned chosen = 0; chosen < 1U << n; ++chosen) {
    MatrixXd basis = MatrixXd::Identity(n, n);
    for (Index i = 0; i < n; ++i)
      if ((chosen >> i & 1U) != 0) basis.col(i) = -M.col(i);
    const Eigen::FullPivLU<MatrixXd> factor(basis);
    if (!factor.isInvertible()) continue;
    const VectorXd values = factor.solve(q);
    if (values.minCoeff() < 0.0) continue;
    VectorXd z = VectorXd::Zero(n);
    for (Index i = 0; i < n; ++i)
      if ((chosen >> i & 1U) != 0) z[i] = values[i];
    solutions.push_back(z);
  }
  return solutions;
}

// Data of size 1 and up to 8 unknowns: rounding errors of the final solve, condition numbers below 1e5.
constexpr double exact = 1e-10;

TEST(AffineBox, PMatricesAgainstEnumeration) {
  Numbers random(1);
  for (int trial = 0; trial < 200; ++trial) {
    const Index n = 1 + trial % 6;
    const MatrixXd root = random.matrix(n, n);
    const MatrixXd skew = random.matrix(n, n);
    // Positive definite, hence P, and not symmetric.
    const MatrixXd M = root * root.transpose() + 0.1 * MatrixXd::Identity(n, n) + skew - skew.transpose();
    const VectorXd q = random.vector(n);
    const auto expected = enumerate(M, q);
    ASSERT_EQ(expected.size(), 1U);
    const AffineBoxSolution found = solve_affine_box(with_bounds(M, q, 0.0, PETSC_INFINITY));
    ASSERT_TRUE(found.solved) << "trial " << trial;
    EXPECT_LE((found.u - expected.front()).cwiseAbs().maxCoeff(), exact) << "trial " << trial;
  }
}

TEST(AffineBox, SemidefiniteMatricesAreSolvedWhereverThereIsASolution) {
  Numbers random(2);
  int solvable = 0;
  int unsolvable = 0;
  for (int trial = 0; trial < 300; ++trial) {
    const Index n = 2 + trial % 5;
    const MatrixXd root = random.matrix(n, n / 2);
    const MatrixXd skew = random.matrix(n, n);
    const MatrixXd M = root * root.transpose() + (trial % 2) * (skew - skew.transpose());
    const VectorXd q = random.vector(n);
    const AffineBox box = with_bounds(M, q, 0.0, PETSC_INFINITY);
    const AffineBoxSolution found = solve_affine_box(box);
    const bool expected = !enumerate(M, q).empty();
    ASSERT_EQ(found.solved, expected) << "trial " << trial;
    if (found.solved) {
      EXPECT_LE(natural_residual(box, found.u), exact) << "trial " << trial;
    }
    (expected ? solvable : unsolvable) += 1;
  }
  EXPECT_GE(solvable, 100);
  EXPECT_GE(unsolvable, 30);
}

// With two bounds on each unknown there is always a solution, and always one that is found.
TEST(AffineBox, AnyMatrixInABoundedBox) {
  Numbers random(3);
  for (int trial = 0; trial < 2000; ++trial) {
    const Index n = 1 + trial % 12;
    AffineBox box = with_bounds(random.matrix(n, n), random.vector(n), -1.0, 1.0);
    if (trial % 3 == 0) box.M.row(trial % n).setZero();  // what inclusions look like before their states
    if (trial % 5 == 0) box.M *= -1.0 / (1.0 + box.M.norm());
    if (trial % 7 == 0) box.q.setZero();         // many solutions
    box.upper[0] = trial % 4 == 0 ? -1.0 : 1.0;  // fixed
    const AffineBoxSolution found = solve_affine_box(box);
    ASSERT_TRUE(found.solved) << "trial " << trial;
    // A random block may be ill-conditioned: residuals grow with the size of its terms, not of its inverse.
    EXPECT_LE(natural_residual(box, found.u), exact) << "trial " << trial;
  }
}

// Unknowns without bounds, with one and with two; a definite matrix, hence one solution and no ray.
TEST(AffineBox, EveryKindOfBound) {
  Numbers random(4);
  for (int trial = 0; trial < 300; ++trial) {
    const Index n = 4 + trial % 5;
    const MatrixXd root = random.matrix(n, n);
    AffineBox box = with_bounds(root * root.transpose() + 0.1 * MatrixXd::Identity(n, n),
                                3.0 * random.vector(n), PETSC_NINFINITY, PETSC_INFINITY);
    for (Index i = 0; i < n; ++i) {
      if (i % 4 == 1 || i % 4 == 3) box.lower[i] = random() - 1.0;
      if (i % 4 == 2 || i % 4 == 3) box.upper[i] = random() + 1.0;
    }
    const AffineBoxSolution found = solve_affine_box(box);
    ASSERT_TRUE(found.solved) << "trial " << trial;
    EXPECT_LE(natural_residual(box, found.u), exact) << "trial " << trial;
  }
}

// Degenerate all over, and Murty's example, where some rules visit 2^n bases; the solution is e_1.
TEST(AffineBox, NoCyclesAndFewPivots) {
  constexpr Index n = 16;
  MatrixXd M = MatrixXd::Identity(n, n);
  M.triangularView<Eigen::StrictlyLower>().setConstant(2.0);
  const AffineBoxSolution murty =
      solve_affine_box(with_bounds(M, VectorXd::Constant(n, -1.0), 0.0, PETSC_INFINITY));
  ASSERT_TRUE(murty.solved);
  EXPECT_LE((murty.u - VectorXd::Unit(n, 0)).cwiseAbs().maxCoeff(), 0.0);  // small integers
  EXPECT_LE(murty.pivots, 2 * n);

  // Equal rows of signs: all ratios tie. The certificate is the residual.
  const AffineBox ties = with_bounds(MatrixXd::Ones(n, n), VectorXd::Constant(n, -1.0), 0.0, 1.0);
  const AffineBoxSolution found = solve_affine_box(ties);
  ASSERT_TRUE(found.solved);
  EXPECT_LE(natural_residual(ties, found.u), exact);
}

// What has no solution is said to have none: u >= 0 with -u - 1 >= 0, and an open unknown without an
// equation.
TEST(AffineBox, NoSolution) {
  const MatrixXd one = MatrixXd::Ones(1, 1);
  const VectorXd minus = VectorXd::Constant(1, -1.0);
  EXPECT_FALSE(solve_affine_box(with_bounds(-one, minus, 0.0, PETSC_INFINITY)).solved);
  EXPECT_FALSE(solve_affine_box(with_bounds(0.0 * one, minus, PETSC_NINFINITY, PETSC_INFINITY)).solved);
}

}  // namespace
}  // namespace sweepvi::test
