// The certificate against the data: what has no solution is not certified, however far out the point is at
// which residuals look small; what is stiff, or grows, is. ranks: 1 2
#include "vi/data_runs.hpp"

#include "vi/row_data.hpp"
#include "vi/twofold.hpp"

namespace sweepvi::test {
namespace {

bool alone() {
  int ranks = 1;
  MPI_Comm_size(PETSC_COMM_WORLD, &ranks);
  return ranks == 1;
}

TEST(Twofold, KeepsWhatDoublesLose) {
  const Twofold sum = Twofold{1e16, 0.0} + Twofold{1.0, 0.0} + Twofold{1e-14, 0.0} + Twofold{-1e16, 0.0};
  // 1e16 x 2^-104 is 5e-16; 1 + 1e-14 itself is rounded by 1e-16.
  EXPECT_NEAR(sum.value() - 1.0, 1e-14, 1e-15);
  // (1 + e) (1 - e) = 1 - e^2, e = 2^-52
  const double e = 0x1p-52;
  const Twofold square = (1.0 + e) * Twofold{1.0 - e, 0.0} + Twofold{-1.0, 0.0};
  EXPECT_EQ(square.value(), -e * e);
}

TEST(Data, OnlyWhatHasASolutionIsCertified) {
  certify_only_what_has_a_solution(1, alone() ? 6 : 2, alone() ? 25 : 8);  // more ranks only wait
}

// Rows add up to 0 <= -0.5: rows 0 and 1 say so.
TEST(Data, WhoContradictsWhomIsNamed) {
  for (const double start : {0.0, 1e3, 1e6}) {
    DataProblem problem(2);
    problem.rows[0] = {{0, 1.0}, {1, -1.0}};
    problem.rows[1] = {{0, -1.0}, {1, 1.0}};
    problem.q = {-1.0, 0.5};
    problem.u0 = {start, start};
    const Solved solved = solve(problem);
    EXPECT_FALSE(solved.report.certified);
    EXPECT_NE(solved.report.diagnosis.find("there is no solution: what F has to be in rows 0, 1"),
              std::string::npos)
        << solved.report.diagnosis;
  }
}

// Four dimensions of u change no row of K, and rows exclude every u (in rationals, by enumeration). At 1e15
// corrections gain u 15 digits each, so that at 1e30 the residual is 1e-27 of the terms, in which doubled
// precision rounds by more than all data.
TEST(Data, GrowingTermsAreNoContraction) {
  MatrixXd K(8, 8);
  K << 13, 2, 21, -2, 6, 15, 5, 3,  //
      -14, 5, -2, -9, -9, -25, 2, -4, -21, 2, 9, -4, -8, -1, -35, 3, 2, 11, -10, 7, -1, -7, 30, -8, 6, 3, 6,
      3, 3, 9, 6, 0, -3, 19, -9, 19, -1, 10, 23, -9, 11, -2, 33, -28, 0, -21, 13, 3, 1, 0, -1, 6, 2, 11, -5,
      1;
  DataProblem problem(8);
  for (std::size_t i = 0; i < 8; ++i)
    for (std::size_t j = 0; j < 8; ++j)
      problem.rows[i][static_cast<PetscInt>(j)] = K(static_cast<Index>(i), static_cast<Index>(j));
  problem.q = {0, 3, 0, 2, -2, 0, 2, -3};
  problem.free = {0, 0, 0, 0, 1, 0, 1, 0};
  problem.u0 = {0, 0, 1, -1, 0, 0, 2, 0};
  const Solved solved = solve(problem);
  EXPECT_FALSE(solved.report.certified) << "largest u " << solved.u.cwiseAbs().maxCoeff();
}

// Only the last of these rows has data, and none of the others has any near: a chain in series, pulled at its
// end. Soft springs among stiff ones, 1 ... 2^30, make rows cancel.
TEST(Data, RowsFarFromDataAreCertified) {
  constexpr std::size_t n = 400;
  for (const bool bounded : {true, false}) {
    DataProblem problem(n);
    problem.add(0, 0, 1.0);
    for (std::size_t i = 1; i < n; ++i) {
      const double k = i % 3 == 0 ? 0x1p30 : 1.0;
      problem.add(i, i, k);
      problem.add(i - 1, i - 1, k);
      problem.add(i, i - 1, -k);
      problem.add(i - 1, i, -k);
    }
    problem.q[n - 1] = -1.0;
    problem.free.assign(n, bounded ? 0 : 1);
    const Solved solved = solve(problem);
    EXPECT_TRUE(solved.report.certified) << solved.report.reason;
    // In series: 1 from the ground, and as much in each soft spring; rounding by 1e-16 x 2^30 x n in each.
    EXPECT_NEAR(solved.u[n - 1], 1.0 + (n - 1 - (n - 1) / 3), 1e-2);
  }
}

/// The estimate of the error that goes with a solution: of equations M u = M e, e of ones.
std::optional<double> estimate(const MatrixXd& M) {
  const Index n = M.rows();
  const AffineBox box{M, -(M * VectorXd::Ones(n)), VectorXd::Constant(n, PETSC_NINFINITY),
                      VectorXd::Constant(n, PETSC_INFINITY)};
  const auto vi = affine_vi(box);
  NonlinearSolver snes;
  check(SNESCreate(PETSC_COMM_WORLD, snes.put()));
  StepSolver solver(snes.get(), *vi);
  EXPECT_TRUE(solver.solve({1, 0.0, 0.0, 0.0}).certified);
  const auto error = solver.refine();
  if (!error) return std::nullopt;
  return error->of_largest;
}

TEST(Data, AnErrorOfTheSizeOfTheSolutionIsTold) {
  MatrixXd hilbert(12, 12);  // condition 1.7e16: rounding of the entries alone changes u by some 10 %
  for (Index i = 0; i < 12; ++i)
    for (Index j = 0; j < 12; ++j)
      hilbert(i, j) = 1.0 / static_cast<double>(i + j + 1);
  const std::optional<double> ill = estimate(hilbert);
  EXPECT_TRUE(!ill || *ill > 1e-3);
  const MatrixXd good = MatrixXd::Identity(12, 12) * 2.0 + MatrixXd::Ones(12, 12);  // condition 7
  const std::optional<double> well = estimate(good);
  ASSERT_TRUE(well.has_value());
  EXPECT_LT(*well, 1e-14);  // 7 x 2e-16, and room
}

/// D / T of RowData in the worst row of K at u with data d.
double least_explained(const std::vector<std::vector<double>>& K, const std::vector<double>& u,
                       const std::vector<double>& d) {
  const auto n = static_cast<PetscInt>(u.size());
  RowBuilder rows;
  for (const auto& row : K) {
    for (PetscInt j = 0; j < n; ++j)
      if (row[static_cast<std::size_t>(j)] != 0.0) rows.add(j, row[static_cast<std::size_t>(j)]);
    rows.end_row();
  }
  const Matrix matrix = rows.finish(PETSC_COMM_SELF, n);
  const auto vector = [&](const std::vector<double>& values) {
    Vector result = make_vector(PETSC_COMM_SELF, n);
    const WriteArray to(result.get());
    std::copy(values.begin(), values.end(), to.data());
    return result;
  };
  const Vector data = vector(d);
  const Vector terms = vector(d);
  const std::vector<double> none(u.size(), PETSC_INFINITY);
  std::vector<double> minus = none;
  for (double& value : minus)
    value = PETSC_NINFINITY;
  RowData(matrix.get())
      .evaluate(vector(u).get(), vector(minus).get(), vector(none).get(), vector(d).get(), data.get(),
                terms.get());
  const ReadArray some(data.get());
  const ReadArray all(terms.get());
  double least = 1.0;
  for (PetscInt i = 0; i < n; ++i)
    least = std::min(least, some[i] / all[i]);
  return least;
}

TEST(RowData, ExplainsAFrontAndNoNullDirection) {
  constexpr std::size_t n = 100;
  std::vector<std::vector<double>> K(n, std::vector<double>(n, 0.0));
  std::vector<double> front(n);
  std::vector<double> d(n, 0.0);
  std::vector<double> far(n, 1e15);
  for (std::size_t i = 0; i < n; ++i) {
    K[i][i] = 2.0;
    if (i > 0) K[i][i - 1] = -1.0;
    if (i + 1 < n) K[i][i + 1] = -1.0;
    front[i] = std::pow(1e-3, static_cast<double>(i));  // decays to 1e-300
  }
  d[0] = 1.0;
  // Each row passes on 0.98 of a thousandth, at worst: 1e-3 x 0.98^100 = 1.3e-4.
  EXPECT_GT(least_explained(K, front, d), 1e-4);
  K[0][0] = K[n - 1][n - 1] = 1.0;
  for (double& value : d)
    value = 1.0;
  // T = 4e15: what data explain is no more than what some of them add up to.
  EXPECT_LT(least_explained(K, far, d), 1e-13);
}

}  // namespace
}  // namespace sweepvi::test
