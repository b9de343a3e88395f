// ranks: 1 2 3
// several: Coordinates.OutputsOnOtherRanks:Coordinates.TenCopies*:Coordinates.ForcedNeighbours*
// three: Coordinates.OutputsOnOtherRanks
// timeout: 200
// AB (65) behind changes of coordinates, alone and in mixed copies, forced and not: the outputs do not care.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <random>

#include "dvi/systems.hpp"
#include "sweepvi/partition.hpp"

namespace sweepvi::test {
namespace {

constexpr PetscInt steps = 1000;
const TimeGrid grid{0.0, 10.0, steps};

Eigen::MatrixXd a65() {
  Eigen::MatrixXd a(5, 5);
  a << 0, 1, 0, 0, 0, 0, 0, 1, 0, 0, -1, -1, -1, 0, 1, 0, 0, 0, 0, 1, 1, 0, 0, -1, 0;
  return a;
}

std::vector<double> row_major(const Eigen::MatrixXd& m) {
  std::vector<double> values;
  for (Eigen::Index i = 0; i < m.rows(); ++i)
    for (Eigen::Index j = 0; j < m.cols(); ++j)
      values.push_back(m(i, j));
  return values;
}

/// Orthogonal factors of random matrices around singular values in [1/2, 2]: condition 4 at most.
Eigen::MatrixXd random_dense(Eigen::Index n, unsigned seed) {
  std::mt19937 generator(seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform(0.5, 2.0);
  const auto orthogonal = [&] {
    const Eigen::MatrixXd random = Eigen::MatrixXd::NullaryExpr(n, n, [&] { return normal(generator); });
    return Eigen::MatrixXd(Eigen::HouseholderQR<Eigen::MatrixXd>(random).householderQ());
  };
  const Eigen::MatrixXd left = orthogonal();
  const Eigen::MatrixXd right = orthogonal();
  const Eigen::VectorXd values = Eigen::VectorXd::NullaryExpr(n, [&] { return uniform(generator); });
  return left * values.asDiagonal() * right;
}

/// A few entries per row beside the diagonal, small enough for a good condition.
Eigen::MatrixXd random_sparse(Eigen::Index n, unsigned seed) {
  std::mt19937 generator(seed);
  std::uniform_int_distribution<Eigen::Index> where(0, n - 1);
  std::uniform_real_distribution<double> what(-0.3, 0.3);
  Eigen::MatrixXd t = Eigen::MatrixXd::Identity(n, n);
  for (Eigen::Index i = 0; i < n; ++i)
    for (int k = 0; k < 2; ++k)
      t(i, where(generator)) += what(generator);
  return t;
}

struct Trajectory {
  std::vector<std::vector<double>> x;  // per step, in the system's coordinates
  std::vector<std::vector<double>> z;  // per step, constraint by constraint, this rank's
  std::vector<PetscInt> constraint;    // this rank's
  std::vector<int> degree;             // this rank's
  PetscInt unknowns = 0;
};

Trajectory march(LinearSystem system, const char* snes_type, const char* predictor = "active-set") {
  const ScopedOption type("-snes_type", snes_type);
  const ScopedOption guess("-sweepvi_predictor", predictor);
  RelativeDegree degree = analyse_relative_degree(system);
  distribute(system, degree);
  const auto dvi =
      make_linear_dvi(system, degree, Scheme::homsp, choose_form(system, degree, Scheme::homsp), grid);
  Trajectory trajectory;
  trajectory.constraint = system.constraint_order;
  trajectory.degree = degree.degree;
  check(VecGetSize(dvi->state(), &trajectory.unknowns));
  TimeMarch time_march(*dvi, grid);
  time_march.observe([&](const Step&, const StepReport&) {
    trajectory.x.push_back(in_scene_order(system, everywhere(dvi->x())));
    trajectory.z.push_back(dvi->z());
  });
  EXPECT_TRUE(time_march.run().certified);
  EXPECT_EQ(time_march.steps_taken(), steps);
  return trajectory;
}

/// x' = T A T^{-1} x + ..., w = C T^{-1} x for `copies` copies of AB (65) with starts scale_i (1, 0, 0, 0,
/// 0).
LinearSystem lifted(const Eigen::MatrixXd& t, int copies, const std::vector<Signal>& f) {
  const Eigen::Index n = 5 * copies;
  Eigen::MatrixXd a = Eigen::MatrixXd::Zero(n, n);
  Eigen::MatrixXd b = Eigen::MatrixXd::Zero(n, copies);
  Eigen::MatrixXd c = Eigen::MatrixXd::Zero(copies, n);
  Eigen::VectorXd x0 = Eigen::VectorXd::Zero(n);
  for (int i = 0; i < copies; ++i) {
    a.block(5 * i, 5 * i, 5, 5) = a65();
    b(5 * i + 2, i) = 1.0;
    c(i, 5 * i) = 1.0;
    x0(5 * i) = 1.0;
  }
  const Eigen::MatrixXd inverse = t.inverse();
  return LinearSystem::dense(PETSC_COMM_WORLD, {.A = row_major(t * a * inverse),
                                                .B = row_major(t * b),
                                                .C = row_major(c * inverse),
                                                .x0 = row_major(t * x0),
                                                .f = f});
}

/// The same run in the plain coordinates: 5 unknowns, box on z. Its x is (z1, z2 - g2, z3 - g3, xi).
Trajectory plain(const std::vector<Signal>& f) {
  return march(example65(PETSC_COMM_WORLD, f), SNESVINEWTONRSLS);
}

void expect_same(const Trajectory& reference, const Trajectory& trajectory, const Eigen::MatrixXd& t,
                 int copies) {
  ASSERT_EQ(reference.x.size(), trajectory.x.size());
  // Rounding of 1000 steps, through T and its inverse (condition below 10), on values of size 3: far below
  // 1e-9.
  double worst_x = 0.0;
  for (std::size_t k = 0; k < reference.x.size(); ++k) {
    Eigen::VectorXd z(5 * copies);
    for (int i = 0; i < 5 * copies; ++i)
      z(i) = reference.x[k][static_cast<std::size_t>(i % 5)];
    const Eigen::VectorXd x = t * z;
    for (Eigen::Index i = 0; i < x.size(); ++i)
      worst_x = std::max(worst_x, std::abs(x(i) - trajectory.x[k][static_cast<std::size_t>(i)]));
  }
  EXPECT_LE(worst_x, 1e-9);
  for (const int r : trajectory.degree)
    EXPECT_EQ(r, 3);
}

void expect_same_outputs(const Trajectory& reference, const Trajectory& trajectory) {
  // The scalar run's outputs live on the rank that owns its constraint; the others add zeros.
  std::vector<double> outputs(reference.x.size() * 3, 0.0);
  if (!reference.constraint.empty())
    for (std::size_t k = 0; k < reference.z.size(); ++k)
      std::copy(reference.z[k].begin(), reference.z[k].end(),
                outputs.begin() + static_cast<std::ptrdiff_t>(3 * k));
  MPI_Allreduce(MPI_IN_PLACE, outputs.data(), static_cast<int>(outputs.size()), MPI_DOUBLE, MPI_SUM,
                PETSC_COMM_WORLD);
  double worst = 0.0;
  for (std::size_t k = 0; k < trajectory.z.size(); ++k)
    for (std::size_t q = 0; q < trajectory.z[k].size(); ++q)
      worst = std::max(worst, std::abs(trajectory.z[k][q] - outputs[3 * k + q % 3]));
  EXPECT_LE(worst, 1e-9);
}

TEST(Coordinates, RandomChangeOfOneSystem) {
  const Trajectory reference = plain({});
  EXPECT_EQ(reference.unknowns, 5);
  const Eigen::MatrixXd t = random_dense(5, 7);
  for (const char* type : {SNESVINEWTONRSLS, SNESVINEWTONSSLS}) {
    const Trajectory trajectory = march(lifted(t, 1, {}), type, "none");
    EXPECT_EQ(trajectory.unknowns, 8);  // outputs are no states here: a multiplier per level
    expect_same(reference, trajectory, t, 1);
    expect_same_outputs(reference, trajectory);
  }
}

TEST(Coordinates, TenCopiesMixedBySparseCoordinates) {
  const Trajectory reference = plain({});
  const Eigen::MatrixXd t = random_sparse(50, 3);
  const Trajectory trajectory = march(lifted(t, 10, {}), SNESVINEWTONRSLS);
  EXPECT_EQ(trajectory.unknowns, 80);
  expect_same(reference, trajectory, t, 10);
  expect_same_outputs(reference, trajectory);
}

// Only z1 and z2 are mixed: in contact whole rows of x are made of residue.
TEST(Coordinates, RotationOfTheFirstTwoLevels) {
  const Trajectory reference = plain({});
  Eigen::MatrixXd t = Eigen::MatrixXd::Identity(5, 5);
  t.topLeftCorner(2, 2) << std::cos(0.7), -std::sin(0.7), std::sin(0.7), std::cos(0.7);
  for (const char* predictor : {"active-set", "none"}) {
    const Trajectory trajectory = march(lifted(t, 1, {}), SNESVINEWTONRSLS, predictor);
    expect_same(reference, trajectory, t, 1);
    expect_same_outputs(reference, trajectory);
  }
}

// Two flexible joints (r = 4) side by side, forced above their inputs: directions are no unit vectors and
// reach the neighbour's outputs. In free flight AB (32), z_{i,k+1} - z_{i,k} = h z_{i+1,k+1}, must hold to
// rounding all the same.
TEST(Coordinates, ForcedNeighboursKeepTheirKinematics) {
  std::vector<double> a(64, 0.0);
  const auto at = [&](int i, int j) -> double& { return a[static_cast<std::size_t>(8 * i + j)]; };
  for (int i = 0; i < 4; ++i)
    at(i, 4 + i) = 1.0;  // x = (q1, p1, q2, p2, velocities); joint 10, ground 1, coupling 1
  for (const int i : {0, 2}) {
    at(4 + i, i) = -13.0, at(4 + i, i + 1) = 10.0, at(4 + i, 2 - i) = 1.0;
    at(5 + i, i) = 10.0, at(5 + i, i + 1) = -10.0;
  }
  std::vector<double> b(16, 0.0);
  std::vector<double> c(16, 0.0);
  b[5 * 2] = b[7 * 2 + 1] = 1.0;
  c[0] = c[8 + 2] = 1.0;
  std::vector<Signal> f(8);
  f[4] = {-1.0, 0.4, 0.5, 0.0};
  f[6] = {-1.0, 0.2, 0.3, 0.0};
  LinearSystem system = LinearSystem::dense(
      PETSC_COMM_WORLD, {.A = a, .B = b, .C = c, .x0 = {0.5, 0.5, 0.6, 0.6, 0, 0, 0, 0}, .f = f});
  RelativeDegree degree = analyse_relative_degree(system);
  distribute(system, degree);
  const TimeGrid three_seconds{0.0, 3.0, 300};
  const auto dvi = make_linear_dvi(system, degree, Scheme::homsp, choose_form(system, degree, Scheme::homsp),
                                   three_seconds);
  TimeMarch time_march(*dvi, three_seconds);
  std::vector<double> before = dvi->z();
  double worst = 0.0;
  int free_steps = 0;
  time_march.observe([&](const Step& step, const StepReport&) {
    const std::vector<double>& z = dvi->z();
    double pushed = 0.0;
    for (const double mu : dvi->mu())
      pushed += mu;
    MPI_Allreduce(MPI_IN_PLACE, &pushed, 1, MPI_DOUBLE, MPI_SUM, PETSC_COMM_WORLD);
    if (pushed == 0.0) {
      ++free_steps;
      for (std::size_t q = 0; q < z.size(); ++q)
        if (q % 4 < 3) worst = std::max(worst, std::abs(z[q] - before[q] - step.h * z[q + 1]));
    }
    before = z;
  });
  EXPECT_TRUE(time_march.run().certified);
  EXPECT_GT(free_steps, 100);
  EXPECT_LT(free_steps, 300);  // and there is contact
  // Rounding of Z x, whose terms are of size 100 on level 4; without the completion it is h^2 f', about 1e-4.
  EXPECT_LE(worst, 1e-12);
}

// A wall at x_1 = 0.3, once as an offset w0, once by moving the origin, which leaves a constant force A (0.3,
// 0, ...).
TEST(Coordinates, AnOffsetIsAMovedOrigin) {
  const std::vector<double> a = row_major(a65());
  const std::vector<double> b = {0, 0, 1, 0, 0};
  const std::vector<double> c = {1, 0, 0, 0, 0};
  const auto run = [&](const std::vector<double>& x0, const std::vector<Signal>& f, double w0, Form form) {
    LinearSystem system =
        LinearSystem::dense(PETSC_COMM_WORLD, {.A = a, .B = b, .C = c, .x0 = x0, .f = f, .w0 = {w0}});
    RelativeDegree degree = analyse_relative_degree(system);
    distribute(system, degree);
    const auto dvi = make_linear_dvi(system, degree, Scheme::homsp, form, grid);
    TimeMarch time_march(*dvi, grid);
    EXPECT_TRUE(time_march.run().certified);
    EXPECT_EQ(time_march.steps_taken(), steps);
    return in_scene_order(system, everywhere(dvi->x()));
  };
  const std::vector<Signal> moved = {{}, {}, {-0.3}, {}, {0.3}};
  const std::vector<double> expected = run({1, 0, 0, 0, 0}, moved, 0.0, Form::box_on_z);
  for (const Form form : {Form::box_on_z, Form::primal_dual}) {
    std::vector<double> shifted = run({1.3, 0, 0, 0, 0}, {}, -0.3, form);
    shifted[0] -= 0.3;
    // The same numbers but for rounding: 1000 steps on values of size 3.
    EXPECT_LE(distance(shifted, expected), 1e-11) << name_of(form);
    EXPECT_LE(distance(run({1, 0, 0, 0, 0}, moved, 0.0, form), expected), 1e-11) << name_of(form);
  }
}

// Without distribute(), the outputs of a constraint may be states of other ranks.
TEST(Coordinates, OutputsOnOtherRanks) {
  const LinearSystem system = example65(PETSC_COMM_WORLD);
  const RelativeDegree degree = analyse_relative_degree(system);
  const auto dvi = make_linear_dvi(system, degree, Scheme::homsp, Form::primal_dual, grid);
  TimeMarch time_march(*dvi, grid);
  EXPECT_TRUE(time_march.run().certified);
  EXPECT_EQ(time_march.steps_taken(), steps);
  // The end of the run in one piece; the scheme's own error at this step is 0.0982 (order65.json).
  EXPECT_NEAR(distance(everywhere(dvi->x()), exact65_at_10), 0.09823539169334805, 1e-9);
}

// z1' = z2 with z2 = x2 + f1: the forcing enters the outputs with its derivatives. In contact z stays exactly
// zero.
TEST(Coordinates, ForcingAtLevelOneLeavesNoSpikesInContact) {
  const Signal wave{0.05, 0.2, 0.35, 0.4};
  const std::vector<Signal> f = {wave, {}, {}, {}, {}};
  const Trajectory reference = plain(f);
  PetscInt contact = 0;
  for (std::size_t k = 1; k < reference.z.size() && !reference.constraint.empty(); ++k) {
    const std::vector<double>& z = reference.z[k];
    const std::vector<double>& before = reference.z[k - 1];
    if (before[0] == 0.0 && before[1] == 0.0 && before[2] == 0.0 && z[0] == 0.0) {
      ++contact;
      EXPECT_EQ(z[1], 0.0) << k;
      EXPECT_EQ(z[2], 0.0) << k;
    }
  }
  if (!reference.constraint.empty()) {
    EXPECT_GT(contact, 50);
  }

  const Eigen::MatrixXd t = random_dense(5, 11);
  std::vector<Signal> mixed;  // T f: every row carries the same wave, scaled
  for (Eigen::Index i = 0; i < 5; ++i)
    mixed.push_back({t(i, 0) * wave.offset, t(i, 0) * wave.amplitude, wave.frequency, wave.phase});
  const Trajectory trajectory = march(lifted(t, 1, mixed), SNESVINEWTONRSLS);
  expect_same(reference, trajectory, t, 1);
  expect_same_outputs(reference, trajectory);
}

}  // namespace
}  // namespace sweepvi::test
