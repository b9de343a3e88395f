#pragma once

#include <gtest/gtest.h>

#include <Eigen/QR>

#include "vi/random_problems.hpp"

namespace sweepvi::test {

/// What the certificate allows, 1e-10, and a unit in the last place for each of its terms.
inline constexpr double certified_to = 1.01e-10;

/// `count` problems of each family, LCPs and mixed ones, of 2 ... `largest` unknowns.
inline void solve_p_matrices(unsigned seed, int count, Index largest) {
  Random random(seed);
  std::array<int, StepSolver::rung_names.size()> rungs{};
  for (const bool mixed : {false, true}) {
    for (const Family& family : p_matrices) {
      for (int k = 0; k < count; ++k) {
        const Index n = random_size(random, largest);
        const AffineBox box = mixed ? random_mixed(random, family, n) : random_lcp(random, family, n);
        const Solved solved = solve(box);
        ASSERT_TRUE(solved.report.certified)
            << family.name << (mixed ? ", mixed, " : ", ") << "number " << k << ", n = " << n << ": "
            << solved.report.reason << ", " << solved.report.residual;
        ASSERT_LE(judge(box, solved.u), certified_to) << family.name << ", number " << k << ", n = " << n;
        ++rungs[static_cast<std::size_t>(solved.report.rung)];
      }
    }
  }
  for (std::size_t i = 0; i < rungs.size(); ++i)
    if (rungs[i] > 0) testing::Test::RecordProperty(StepSolver::rung_names[i], rungs[i]);
}

/// Whether the LCP w = M z + q has a solution: some choice of w_i, z_i, or none of them for each i, with
/// independent columns, has q as a nonnegative combination. Every solvable one has such a choice.
inline bool has_solution(const MatrixXd& M, const VectorXd& q) {
  constexpr double exact = 1e-10;  // data of size 1, at most 8 unknowns
  const Index n = q.size();
  Index choices = 1;
  for (Index i = 0; i < n; ++i)
    choices *= 3;
  for (Index choice = 0; choice < choices; ++choice) {
    MatrixXd basis(n, n);
    Index columns = 0;
    for (Index i = 0, rest = choice; i < n; ++i, rest /= 3) {
      if (rest % 3 == 1) basis.col(columns++) = VectorXd::Unit(n, i);
      if (rest % 3 == 2) basis.col(columns++) = -M.col(i);
    }
    if (columns == 0) {
      if (q.isZero(0.0)) return true;
      continue;
    }
    const Eigen::ColPivHouseholderQR<MatrixXd> factor(basis.leftCols(columns));
    if (factor.rank() < columns) continue;
    const VectorXd values = factor.solve(q);
    const double left = (basis.leftCols(columns) * values - q).cwiseAbs().maxCoeff();
    if (values.minCoeff() >= -exact && left <= exact) return true;
  }
  return false;
}

/// `count` LCPs of each of five kinds of matrices, of 1 ... `largest` unknowns: certified ones are solutions,
/// and the others have none.
inline void solve_without_structure(unsigned seed, int count, Index largest) {
  Random random(seed);
  int solvable = 0;
  int unsolvable = 0;
  int searched = 0;
  for (int kind = 0; kind < 5; ++kind) {
    for (int k = 0; k < count; ++k) {
      const Index n = 1 + random.below(largest);
      MatrixXd M = random.matrix(n, n);
      VectorXd q = random.vector(n);
      if (kind == 1) M.diagonal().setZero();
      if (kind == 2 || kind == 3) {  // small integers: singular blocks and ties all over
        for (double& value : M.reshaped())
          value = kind == 3 && random.chance(0.5) ? 0.0 : static_cast<double>(random.below(5) - 2);
        for (double& value : q)
          value = static_cast<double>(random.below(5) - 2);
      }
      if (kind == 4) M = random.matrix(n, (n + 1) / 2) * random.matrix((n + 1) / 2, n);
      const AffineBox box{M, q, VectorXd::Zero(n), VectorXd::Constant(n, PETSC_INFINITY)};
      const Solved solved = solve(box);
      if (solved.report.certified) {
        ++solvable;
        searched += solved.report.rung == Rung::enumeration ? 1 : 0;
        ASSERT_LE(judge(box, solved.u), certified_to) << "kind " << kind << ", number " << k;
      } else {
        ++unsolvable;
        ASSERT_FALSE(has_solution(M, q)) << "kind " << kind << ", number " << k << "\n" << M << "\n" << q;
      }
    }
  }
  EXPECT_GT(solvable, 0);
  EXPECT_GT(unsolvable, 0);
  testing::Test::RecordProperty("solvable", solvable);
  testing::Test::RecordProperty("unsolvable", unsolvable);
  testing::Test::RecordProperty("found by search only", searched);
}

}  // namespace sweepvi::test
