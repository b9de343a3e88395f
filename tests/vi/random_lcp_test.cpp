// Random box VIs through the whole ladder: what is certified is a solution, by a judge of its own; P-matrices
// are solved whatever their kind, and of small problems without structure all that have a solution are.
// ranks: 1 2
// several: *-RandomLcp.MurtysFamily
#include "vi/random_runs.hpp"

namespace sweepvi::test {
namespace {

bool alone() {
  int ranks = 1;
  MPI_Comm_size(PETSC_COMM_WORLD, &ranks);
  return ranks == 1;
}

TEST(RandomLcp, PMatricesAreSolved) {
  solve_p_matrices(1, alone() ? 15 : 3, alone() ? 60 : 10);  // more ranks have nothing to do but wait
}

TEST(RandomLcp, WithoutStructureNothingWrongNothingMissed) {
  solve_without_structure(1, alone() ? 15 : 2, alone() ? 5 : 3);
}

// Triangular with 2 below the diagonal, its product with its transpose, and right sides on which one or the
// other pivoting rule visits 2^n bases (K. G. Murty, Opns. Res. Verf. 31 (1978) 547-561; Y. Fathi, Math.
// Program. 17 (1979) 335-344).
TEST(RandomLcp, MurtysFamily) {
  for (const Index n : {2, 5, 8, 12, 16}) {
    MatrixXd L = MatrixXd::Identity(n, n);
    L.triangularView<Eigen::StrictlyLower>().setConstant(2.0);
    for (const MatrixXd& M : {MatrixXd(L), MatrixXd(L.transpose()), MatrixXd(L * L.transpose())}) {
      VectorXd powers(n);
      VectorXd sums(n);
      for (Index i = 0; i < n; ++i) {
        powers[i] = -std::pow(4.0, static_cast<double>(n - i));
        sums[i] = -std::pow(2.0, static_cast<double>(n)) + std::pow(2.0, static_cast<double>(i));
      }
      for (const VectorXd& q : {VectorXd(VectorXd::Constant(n, -1.0)), powers, sums}) {
        const AffineBox box{M, q, VectorXd::Zero(n), VectorXd::Constant(n, PETSC_INFINITY)};
        const Solved solved = solve(box);
        EXPECT_TRUE(solved.report.certified) << "n = " << n;
        EXPECT_LE(judge(box, solved.u), certified_to) << "n = " << n;
      }
    }
  }
}

// A ray is called a ray.
TEST(RandomLcp, NoSolution) {
  const AffineBox box{MatrixXd::Constant(1, 1, -1.0), VectorXd::Constant(1, -1.0), VectorXd::Zero(1),
                      VectorXd::Constant(1, PETSC_INFINITY)};
  const Solved solved = solve(box);
  EXPECT_FALSE(solved.report.certified);
  EXPECT_NE(solved.report.reason.find("no solution found: secondary ray"), std::string::npos)
      << solved.report.reason;
}

}  // namespace
}  // namespace sweepvi::test
