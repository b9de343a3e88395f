// Definiteness by dominance, factorization and Lanczos' method, against eigenvalues.
#include "model/definiteness.hpp"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <random>

#include "model/dense_parts.hpp"

namespace sweepvi::test {
namespace {

using How = Definiteness::How;

Matrix distributed(const Eigen::MatrixXd& dense) {
  const auto n = static_cast<PetscInt>(dense.rows());
  std::vector<double> entries;
  for (Eigen::Index i = 0; i < dense.rows(); ++i)
    for (Eigen::Index j = 0; j < dense.cols(); ++j)
      entries.push_back(dense(i, j));
  const LocalRange rows = share(PETSC_COMM_WORLD, n);
  return rows_of(PETSC_COMM_WORLD, entries, rows, n, rows.size());
}

TEST(DefinitenessOf, RandomMatricesIsThatOfTheirEigenvalues) {
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  int definite = 0;
  int factored = 0;
  constexpr int cases = 60;
  for (int k = 0; k < cases; ++k) {
    const Eigen::Index n = 2 + k % 9;
    Eigen::MatrixXd a(n, n);
    for (double& entry : a.reshaped())
      entry = random() % 3 == 0 ? 0.0 : normal(random);
    a.diagonal().array() += (0.6 + 0.2 * (k % 5)) * std::sqrt(static_cast<double>(n));
    Eigen::VectorXd units(n);  // of coordinates: they are not to count
    for (double& unit : units)
      unit = std::exp2(static_cast<double>(random() % 40) - 20.0);
    a = units.asDiagonal() * a * units.asDiagonal();
    const Definiteness found = examine_definiteness(distributed(a).get());
    const Eigen::MatrixXd symmetric = 0.5 * (a + a.transpose());
    const Eigen::VectorXd inverse = units.cwiseInverse();
    const double smallest = Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(
                                Eigen::MatrixXd(inverse.asDiagonal() * symmetric * inverse.asDiagonal()))
                                .eigenvalues()(0);
    ASSERT_GT(std::abs(smallest), 1e-6) << "a case that rounding decides";
    EXPECT_EQ(found.definite, smallest > 0.0) << k;
    EXPECT_NE(found.how, How::estimated);
    definite += found.definite ? 1 : 0;
    factored += found.how == How::factored ? 1 : 0;
    if (found.definite) continue;
    EXPECT_LT(found.form, 0.0) << k;
    EXPECT_FALSE(found.largest.empty());
  }
  EXPECT_GT(definite, 10);
  EXPECT_LT(definite, cases - 10);
  EXPECT_GT(factored, 15);
}

TEST(DefinitenessOf, SingularMatricesIsNotGiven) {
  // x' A x = 0 for x = (1, -1), in doubles or up to their rounding.
  Eigen::MatrixXd ones = Eigen::MatrixXd::Ones(2, 2);
  for (const double scale : {1.0, 1.0 / 3.0, 1e-20}) {
    const Definiteness found = examine_definiteness(distributed(scale * ones).get());
    EXPECT_FALSE(found.definite);
    EXPECT_EQ(found.largest, (std::vector<PetscInt>{0, 1}));
    EXPECT_NEAR(found.form, 0.0, 1e-15 * scale);
  }
  // A ring of springs without ground: dominant, but not strictly.
  constexpr Eigen::Index n = 40;
  Eigen::MatrixXd ring = Eigen::MatrixXd::Zero(n, n);
  for (Eigen::Index i = 0; i < n; ++i) {
    ring(i, i) = 2.0;
    ring(i, (i + 1) % n) = ring((i + 1) % n, i) = -1.0;
  }
  EXPECT_FALSE(examine_definiteness(distributed(ring).get()).definite);
  ring(7, 7) += 1e-6;  // one spring to the ground
  const Definiteness held = examine_definiteness(distributed(ring).get());
  EXPECT_TRUE(held.definite);
  EXPECT_EQ(held.how, How::factored);
  ring.diagonal().array() += 1e-6;
  EXPECT_EQ(examine_definiteness(distributed(ring).get()).how, How::dominance);
}

TEST(DefinitenessOf, AMatrixWithTooMuchFillIsEstimated) {
  constexpr PetscInt n = 60;  // dense: 60^3 / 6 = 36000 multiplications
  constexpr double allowed = 20000.0;
  for (const double shift : {0.5, -0.5}) {
    // 1 on the diagonal, c / n elsewhere: eigenvalues 1 - c/n and 1 + (n - 1) c / n.
    RowBuilder rows;
    const LocalRange range = share(PETSC_COMM_WORLD, n);
    const double off = (shift > 0.0 ? 2.0 : -2.0) / static_cast<double>(n);
    for (PetscInt i = range.first; i < range.last; ++i) {
      for (PetscInt j = 0; j < n; ++j)
        rows.add(j, i == j ? 1.0 : off);
      rows.end_row();
    }
    const Matrix matrix = rows.finish(PETSC_COMM_WORLD, range.size());
    const Definiteness found = examine_definiteness(matrix.get(), allowed);
    EXPECT_EQ(found.how, How::estimated);
    EXPECT_EQ(found.definite, shift > 0.0);
    // Lanczos finds both eigenvalues of such a matrix in two steps: 1 - 2/n, or 1 - 2 (n - 1)/n.
    const auto size = static_cast<double>(n);
    EXPECT_NEAR(found.form, shift > 0.0 ? 1.0 - 2.0 / size : 1.0 - 2.0 * (size - 1.0) / size, 1e-10);
  }
}

}  // namespace
}  // namespace sweepvi::test
