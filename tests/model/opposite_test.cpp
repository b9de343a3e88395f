// ranks: 1 2 3
// Opposite rows of a scene become one constraint with two walls: which do, with which scales, and which are
// refused.
#include "model/opposite.hpp"

#include <gtest/gtest.h>

#include <map>

#include "dvi/runs.hpp"
#include "petsc/sparse.hpp"

namespace sweepvi::test {
namespace {

constexpr double inf = PETSC_INFINITY;

/// A system of constraints that read C and push B; what A does is of no concern here.
LinearSystem system_of(const Eigen::MatrixXd& c, const Eigen::MatrixXd& b, const std::vector<double>& w0,
                       const std::vector<double>& wmax = {}, const std::vector<double>& d = {}) {
  const Eigen::Index n = c.cols();
  return LinearSystem::dense(PETSC_COMM_WORLD, {.A = row_major(Eigen::MatrixXd::Identity(n, n)),
                                                .B = row_major(b),
                                                .C = row_major(c),
                                                .x0 = std::vector<double>(static_cast<std::size_t>(n), 1.0),
                                                .D = d,
                                                .w0 = w0,
                                                .wmax = wmax});
}

struct Merged {
  PetscInt number = -1;  // scene number of the row that went, -1: none
  double output_scale = 0.0, multiplier_scale = 0.0;
  double w0 = 0.0, wmax = inf;
  bool operator==(const Merged&) const = default;
};

/// Scene number of each constraint that is left -> what stands there, on every rank.
std::map<PetscInt, Merged> constraints_of(const LinearSystem& system) {
  struct Row {
    PetscInt constraint;
    Merged merged;
  };
  std::vector<Row> rows;
  const ReadArray w0(system.w0.get());
  for (std::size_t a = 0; a < system.constraint_order.size(); ++a) {
    Row row{system.constraint_order[a], {.w0 = w0[static_cast<PetscInt>(a)]}};
    if (system.wmax) row.merged.wmax = ReadArray(system.wmax.get())[static_cast<PetscInt>(a)];
    for (const OppositeRow& opposite : system.opposite) {
      if (opposite.constraint != static_cast<PetscInt>(a)) continue;
      EXPECT_EQ(row.merged.number, -1) << "two rows merged into one";
      row.merged.number = opposite.number;
      row.merged.output_scale = opposite.output_scale;
      row.merged.multiplier_scale = opposite.multiplier_scale;
    }
    rows.push_back(row);
  }
  rows = gather(PETSC_COMM_WORLD, rows);
  broadcast(PETSC_COMM_WORLD, rows);
  std::map<PetscInt, Merged> result;
  for (const Row& row : rows)
    EXPECT_TRUE(result.emplace(row.constraint, row.merged).second)
        << "constraint " << row.constraint << " twice";
  return result;
}

/// C and B of the constraints left are the rows and columns of the scene's, in order.
void expect_rows_kept(const LinearSystem& system, const Eigen::MatrixXd& c, const Eigen::MatrixXd& b) {
  const LocalRange rows = row_range(system.C.get());
  ASSERT_EQ(static_cast<std::size_t>(rows.size()), system.constraint_order.size());
  EXPECT_EQ(column_range(system.B.get()).first, rows.first);
  EXPECT_EQ(column_range(system.B.get()).last, rows.last);
  const Matrix pushed = transpose(system.B.get());
  const auto expect_row = [&](Mat matrix, PetscInt row, const Eigen::VectorXd& expected) {
    Eigen::VectorXd found = Eigen::VectorXd::Zero(expected.size());
    for (const auto& [column, value] : get_row(matrix, row))
      found(column) = value;
    EXPECT_EQ(found, expected);
  };
  for (PetscInt a = 0; a < rows.size(); ++a) {
    const PetscInt number = system.constraint_order[static_cast<std::size_t>(a)];
    expect_row(system.C.get(), rows.first + a, c.row(number).transpose());
    expect_row(pushed.get(), rows.first + a, b.col(number));
  }
}

template <class Work>
void expect_bad_input(Work&& work, const std::vector<std::string>& fragments) {
  try {
    work();
    ADD_FAILURE() << "accepted";
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ExitCode::bad_input);
    for (const std::string& fragment : fragments)
      EXPECT_NE(std::string(error.what()).find(fragment), std::string::npos) << error.what();
  }
}

TEST(Opposite, OnePairWithScales) {
  Eigen::MatrixXd c(2, 2);
  Eigen::MatrixXd b(2, 2);
  c << 1.0, -0.5, -4.0, 2.0;  // s = 4
  b << 0.0, 0.0, 1.0, -3.0;   // t = 3
  LinearSystem system = system_of(c, b, {0.5, 6.0});
  merge_opposite_constraints(system);
  EXPECT_EQ(system.constraints(), 1);
  EXPECT_EQ(system.scene_constraints(), 2);
  EXPECT_EQ(constraints_of(system), (std::map<PetscInt, Merged>{{0, {1, 4.0, 3.0, 0.5, 0.5 + 6.0 / 4.0}}}));
  expect_rows_kept(system, c, b);
}

// Thirds are not exact: the scale holds up to rounding, and the first row is the one that stays.
TEST(Opposite, ScalesUpToRounding) {
  Eigen::MatrixXd c(2, 3);
  Eigen::MatrixXd b(3, 2);
  c.row(0) << 0.1, 0.7, -0.3;
  c.row(1) = c.row(0) / -3.0;
  b.col(0) << 0.2, 0.0, 0.9;
  b.col(1) = b.col(0) * (-1.0 / 7.0);
  LinearSystem system = system_of(c, b, {0.0, 1.0});
  merge_opposite_constraints(system);
  const auto left = constraints_of(system);
  ASSERT_EQ(left.size(), 1U);
  const Merged& merged = left.at(0);
  EXPECT_EQ(merged.number, 1);
  // One division and one product.
  EXPECT_NEAR(merged.output_scale, 1.0 / 3.0, 1e-15);
  EXPECT_NEAR(merged.multiplier_scale, 1.0 / 7.0, 1e-15);
  EXPECT_NEAR(merged.wmax, 3.0, 1e-14);
}

// Off by more than rounding, 1e-12, they are two constraints that nearly depend on each other: not ours to
// merge.
TEST(Opposite, NothingThatIsNotOpposite) {
  struct Case {
    const char* what;
    std::vector<double> c, b;
  };
  const Case cases[] = {{"the same output", {1, 1, 2, 2}, {0, 0, 1, -1}},
                        {"opposite outputs, the same input", {1, 1, -1, -1}, {0, 0, 1, 1}},
                        {"opposite outputs, another input", {1, 1, -1, -1}, {0, -1, 1, 0}},
                        {"opposite inputs, another output", {1, 1, -1, -2}, {0, 0, 1, -1}},
                        {"nearly opposite outputs", {1, 1, -1, -1 - 1e-12}, {0, 0, 1, -1}},
                        {"nearly opposite inputs", {1, 1, -1, -1}, {1, -1 - 1e-12, 1, -1}},
                        {"fewer entries", {1, 1, -1, 0}, {0, 0, 1, -1}}};
  for (const Case& one : cases) {
    SCOPED_TRACE(one.what);
    const Eigen::MatrixXd c = Eigen::Map<const Eigen::Matrix<double, 2, 2, Eigen::RowMajor>>(one.c.data());
    const Eigen::MatrixXd b = Eigen::Map<const Eigen::Matrix<double, 2, 2, Eigen::RowMajor>>(one.b.data());
    LinearSystem system = system_of(c, b, {1.0, 1.0});
    merge_opposite_constraints(system);
    EXPECT_EQ(system.scene_constraints(), 2);
    EXPECT_FALSE(system.wmax);
    EXPECT_EQ(constraints_of(system), (std::map<PetscInt, Merged>{{0, {.w0 = 1.0}}, {1, {.w0 = 1.0}}}));
    expect_rows_kept(system, c, b);
  }
}

TEST(Opposite, SystemsWithDAreLeftAlone) {
  Eigen::MatrixXd c(2, 1);
  Eigen::MatrixXd b(1, 2);
  c << 1, -1;
  b << 1, -1;
  LinearSystem system = system_of(c, b, {0.0, 1.0}, {}, {1, 0, 0, 1});
  merge_opposite_constraints(system);
  EXPECT_EQ(system.constraints(), 2);
  EXPECT_TRUE(system.opposite.empty());
}

// Seven rows over eight states, pairs far apart: on several ranks they start on different ones.
Eigen::MatrixXd many_reads() {
  Eigen::MatrixXd c = Eigen::MatrixXd::Zero(7, 8);
  c(0, 0) = 1.0, c(6, 0) = -2.0;                                 // 0 and 6
  c(1, 2) = 1.0, c(1, 3) = -1.0, c(5, 2) = -0.5, c(5, 3) = 0.5;  // 1 and 5
  c(2, 4) = 3.0;                                                 // alone, with an upper limit of its own
  c(3, 5) = -1.0, c(4, 5) = 8.0;                                 // 3 and 4
  return c;
}

Eigen::MatrixXd many_pushes() {
  Eigen::MatrixXd b = Eigen::MatrixXd::Zero(8, 7);
  b(1, 0) = 1.0, b(1, 6) = -0.25;
  b(2, 1) = 1.0, b(3, 1) = -1.0, b(2, 5) = -4.0, b(3, 5) = 4.0;
  b(4, 2) = 1.0;
  b(5, 3) = -1.0, b(5, 4) = 2.0;
  return b;
}

TEST(Opposite, SeveralPairsOverAllRanks) {
  const Eigen::MatrixXd c = many_reads();
  const Eigen::MatrixXd b = many_pushes();
  LinearSystem system =
      system_of(c, b, {0.0, 1.0, -1.0, 4.0, 8.0, 0.5, 6.0}, {inf, inf, 2.5, inf, inf, inf, inf});
  merge_opposite_constraints(system);
  const std::map<PetscInt, Merged> expected = {{0, {6, 2.0, 0.25, 0.0, 3.0}},
                                               {1, {5, 0.5, 4.0, 1.0, 2.0}},
                                               {2, {-1, 0.0, 0.0, -1.0, 2.5}},
                                               {3, {4, 8.0, 2.0, 4.0, 5.0}}};
  EXPECT_EQ(constraints_of(system), expected);
  EXPECT_EQ(system.constraints(), 4);
  EXPECT_EQ(system.scene_constraints(), 7);
  expect_rows_kept(system, c, b);
}

// distribute() moves constraints between ranks; what was merged goes along.
TEST(Opposite, MergedRowsFollowTheirConstraint) {
  const Eigen::MatrixXd c = many_reads();
  Eigen::MatrixXd b = Eigen::MatrixXd::Zero(8, 7);
  b(0, 0) = 1.0, b(0, 6) = -0.25;  // all of degree 1
  b(2, 1) = 1.0, b(2, 5) = -4.0;
  b(4, 2) = 1.0;
  b(5, 3) = -1.0, b(5, 4) = 2.0;
  LinearSystem system =
      system_of(c, b, {0.0, 1.0, -1.0, 4.0, 8.0, 0.5, 6.0}, {inf, inf, 2.5, inf, inf, inf, inf});
  merge_opposite_constraints(system);
  const auto before = constraints_of(system);
  EXPECT_EQ(before.at(0).number, 6);
  RelativeDegree degree = analyse_relative_degree(system);
  distribute(system, degree);
  EXPECT_EQ(constraints_of(system), before);
  EXPECT_EQ(system.scene_constraints(), 7);
}

TEST(Opposite, WallsNeedRoom) {
  Eigen::MatrixXd c(3, 2);
  Eigen::MatrixXd b(2, 3);
  c << 1, 0, 0, 1, -2, 0;
  b << 1, 0, -1, 0, 1, 0;
  // w_0 = x + w0_0 goes from 0 to w0_0 + w0_2 / 2.
  for (const double w0 : {-2.0, -2.5}) {
    LinearSystem system = system_of(c, b, {1.0, 0.0, w0});
    const std::vector<std::string> said = {"constraints 0 and 2 are opposite and leave no room",
                                           w0 == -2.0 ? "w_0 from 0 to 0;" : "w_0 from 0 to -0.25;"};
    expect_bad_input([&] { merge_opposite_constraints(system); }, said);
  }
  LinearSystem system = system_of(c, b, {1.0, 0.0, -1.999});
  merge_opposite_constraints(system);
  EXPECT_NEAR(constraints_of(system).at(0).wmax, 0.0005, 1e-15);
}

TEST(Opposite, NoSecondUpperLimit) {
  Eigen::MatrixXd c(2, 1);
  Eigen::MatrixXd b(1, 2);
  c << 1, -1;
  b << 1, -1;
  for (const std::vector<double>& wmax : {std::vector<double>{1.0, inf}, {inf, 1.0}, {1.0, 1.0}}) {
    LinearSystem system = system_of(c, b, {0.0, 1.0}, wmax);
    expect_bad_input(
        [&] { merge_opposite_constraints(system); },
        {"model.wmax: constraints 0 and 1 are opposite", "write them as one constraint with wmax"});
  }
  LinearSystem system = system_of(c, b, {0.0, 1.0}, {inf, inf});
  merge_opposite_constraints(system);
  EXPECT_EQ(constraints_of(system).at(0).wmax, 1.0);
}

// A third row cannot be merged as well; the Markov matrix tells, by the scene's numbers.
TEST(Opposite, OnlyOnePartner) {
  LinearSystem system = LinearSystem::dense(PETSC_COMM_WORLD, {.A = {0, 1, 0, 0},
                                                               .B = {0, 0, 0, 1, -1, -1},
                                                               .C = {1, 0, -1, 0, -1, 0},
                                                               .x0 = {1, 0},
                                                               .w0 = {0, 1, 2}});
  merge_opposite_constraints(system);
  const auto left = constraints_of(system);
  EXPECT_EQ(left.size(), 2U);
  EXPECT_EQ(left.at(0).number, 1);
  EXPECT_EQ(left.at(2).number, -1);
  const RelativeDegree degree = analyse_relative_degree(system);
  expect_bad_input([&] { check_markov_matrix(system, degree); }, {"constraints 0, 2 depend on each other"});
}

}  // namespace
}  // namespace sweepvi::test
