// ranks: 1 2 3
// Which systems have outputs from which their states follow by substitution: those that can be a box on z.
#include <gtest/gtest.h>

#include <random>
#include <set>

#include "chain/chain_scene.hpp"
#include "dvi/runs.hpp"
#include "petsc/sparse.hpp"

namespace sweepvi::test {
namespace {

std::string obstacle(const LinearSystem& system, const RelativeDegree& degree) {
  return against_box_on_z(system, degree, Scheme::homsp);
}

/// Every output has a pivot of its own that it reads, and W = (outputs, other states) is invertible.
void expect_valid(const LinearSystem& system, const RelativeDegree& degree) {
  ASSERT_TRUE(degree.has_pivots);
  const LocalRange outputs = row_range(degree.Z.get());
  ASSERT_EQ(degree.pivot.size(), static_cast<std::size_t>(outputs.size()));
  std::vector<PetscInt> pivots = gather(PETSC_COMM_WORLD, degree.pivot);
  broadcast(PETSC_COMM_WORLD, pivots);
  EXPECT_EQ(static_cast<PetscInt>(pivots.size()), degree.outputs);
  EXPECT_EQ(std::set<PetscInt>(pivots.begin(), pivots.end()).size(), pivots.size())
      << "two outputs in one place";

  struct Entry {
    PetscInt row, column;
    double value;
  };
  std::vector<Entry> entries;
  for (PetscInt q = outputs.first; q < outputs.last; ++q) {
    bool reads_pivot = false;
    const PetscInt pivot = degree.pivot[static_cast<std::size_t>(q - outputs.first)];
    for (const auto& [column, value] : get_row(degree.Z.get(), q)) {
      entries.push_back({pivot, column, value});
      reads_pivot = reads_pivot || (column == pivot && value != 0.0);
    }
    EXPECT_TRUE(reads_pivot);
  }
  entries = gather(PETSC_COMM_WORLD, entries);
  broadcast(PETSC_COMM_WORLD, entries);
  Eigen::MatrixXd w = Eigen::MatrixXd::Identity(system.states(), system.states());
  for (const PetscInt pivot : pivots)
    w.row(pivot).setZero();
  for (const Entry& entry : entries)
    w(entry.row, entry.column) = entry.value;
  EXPECT_GT(w.fullPivLu().rcond(), 1e-6);
}

/// The same on every rank, whatever it owns.
RelativeDegree analysed(const LinearSystem& system) {
  RelativeDegree degree = analyse_relative_degree(system);
  int flags[2] = {degree.has_pivots ? 1 : 0, degree.has_pivots ? 0 : -1};
  const int mine = flags[0];
  MPI_Allreduce(MPI_IN_PLACE, flags, 1, MPI_INT, MPI_MAX, PETSC_COMM_WORLD);
  EXPECT_EQ(mine, flags[0]) << "the ranks disagree";
  if (!degree.has_pivots) {
    EXPECT_TRUE(degree.pivot.empty());
  }
  return degree;
}

TEST(Pivots, JerkChainsAreStatesAlready) {
  LinearSystem system = chain_system("element = \"jerk\"\ncount = 7\ncoupling = 0.5\n");
  RelativeDegree degree = analysed(system);
  EXPECT_TRUE(degree.outputs_are_states);
  expect_valid(system, degree);
  distribute(system, degree);
  EXPECT_EQ(obstacle(system, degree), "");
}

TEST(Pivots, FlexibleChainsHaveThem) {
  LinearSystem system = chain_system("element = \"flexible\"\ncount = 7\ncoupling = 1.0\n");
  RelativeDegree degree = analysed(system);
  EXPECT_FALSE(degree.outputs_are_states);
  expect_valid(system, degree);
  distribute(system, degree);
  EXPECT_TRUE(degree.has_pivots);
  EXPECT_EQ(obstacle(system, degree), "");
}

TEST(Pivots, ColumnsOfBallsShareTheirInputs) {
  LinearSystem system = chain_system("element = \"contact\"\ncount = 7\n");
  RelativeDegree degree = analysed(system);
  EXPECT_FALSE(degree.has_pivots);
  EXPECT_FALSE(degree.outputs_are_states);
  distribute(system, degree);
  EXPECT_NE(obstacle(system, degree).find("the Markov matrix is not diagonal"), std::string::npos);
}

/// x' = T S T^{-1} x of a triple integrator with one more state.
LinearSystem turned(const Eigen::MatrixXd& t) {
  Eigen::MatrixXd a = Eigen::MatrixXd::Zero(4, 4);
  a(0, 1) = a(1, 2) = 1.0;
  a(3, 3) = -1.0;
  const Eigen::MatrixXd inverse = t.inverse();
  return LinearSystem::dense(PETSC_COMM_WORLD, {.A = row_major(t * a * inverse),
                                                .B = row_major(t.col(2)),
                                                .C = row_major(inverse.row(0)),
                                                .x0 = {1, 1, 1, 1}});
}

TEST(Pivots, RandomDenseCoordinatesHaveNone) {
  for (const unsigned seed : {1U, 2U, 3U}) {
    std::mt19937 generator(seed);
    std::normal_distribution<double> normal;
    const Eigen::MatrixXd random = Eigen::MatrixXd::NullaryExpr(4, 4, [&] { return normal(generator); });
    const LinearSystem system = turned(Eigen::HouseholderQR<Eigen::MatrixXd>(random).householderQ());
    const RelativeDegree degree = analysed(system);
    EXPECT_EQ(degree.highest, 3);
    EXPECT_FALSE(degree.has_pivots);
    EXPECT_NE(obstacle(system, degree), "");
  }
}

// A triangular change leaves one new state per level: three rounds, each pivot the next state.
TEST(Pivots, TriangularCoordinatesHaveThem) {
  Eigen::MatrixXd t = Eigen::MatrixXd::Identity(4, 4);
  t(1, 0) = 0.5, t(2, 0) = -0.25, t(2, 1) = 2.0, t(3, 0) = 1.0, t(3, 2) = -0.5;
  const LinearSystem system = turned(t);
  const RelativeDegree degree = analysed(system);
  expect_valid(system, degree);
  EXPECT_FALSE(degree.outputs_are_states);
  std::vector<PetscInt> pivots = gather(PETSC_COMM_WORLD, degree.pivot);
  broadcast(PETSC_COMM_WORLD, pivots);
  EXPECT_EQ(pivots, (std::vector<PetscInt>{0, 1, 2}));
}

// w = x_0 + c x_1 where nothing else gives x_1: two unknown states in the first output. A coefficient of
// rounding size is too small to divide by, and too large to drop.
TEST(Pivots, NoOutputToBeginWith) {
  for (const double c : {1.0, 1e-3, 1e-9}) {
    const LinearSystem system =
        LinearSystem::dense(PETSC_COMM_WORLD, {.A = {0, 0, 0, 0}, .B = {1, 0}, .C = {1, c}, .x0 = {1, 1}});
    EXPECT_FALSE(analysed(system).has_pivots) << c;
  }
}

// (w_0, w_1) = (x_0, x_0 + c x_1): x_1 follows from w_1 once x_0 is known, unless c is below 1e-4, where
// dividing by it would amplify rounding. Degree 2 for two rounds.
TEST(Pivots, SmallOnesAreRefused) {
  for (const double c : {1.0, 2e-4, 0.5e-4}) {
    // q_0, v_0, q_1, v_1; w_1 = q_0 + c q_1 is pushed by its own force alone where that of w_0 is balanced.
    const LinearSystem system =
        LinearSystem::dense(PETSC_COMM_WORLD, {.A = {0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0},
                                               .B = {0, 0, 1, 0, 0, 0, -1 / c, 1 / c},
                                               .C = {1, 0, 0, 0, 1, 0, c, 0},
                                               .x0 = {1, 0, 1, 0}});
    const RelativeDegree degree = analysed(system);
    EXPECT_EQ(degree.highest, 2);
    EXPECT_EQ(degree.has_pivots, c > 1e-4) << c;
    if (degree.has_pivots) {
      EXPECT_EQ(degree.outputs, 4);
    }
  }
}

TEST(Pivots, DegreeZeroHasNoOutputs) {
  const LinearSystem system =
      LinearSystem::dense(PETSC_COMM_WORLD, {.A = {-1}, .B = {1}, .C = {1}, .x0 = {1}, .D = {1}});
  const RelativeDegree degree = analysed(system);
  EXPECT_FALSE(degree.has_pivots);
  EXPECT_EQ(obstacle(system, degree), "some constraint has relative degree 0");
}

}  // namespace
}  // namespace sweepvi::test
