// ranks: 1 2 3
// several: ZdSystem.RanksDoNotMatter:ZdSystem.*FiniteDifferences*:ZdSystem.TwoWalls*:ZdSystem.WhatMakes*
// three: ZdSystem.RanksDoNotMatter
// timeout: 240

#include "sweepvi/zd_system.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>

#include "../../examples/pendulum_chain/pendulum_chain.hpp"
#include "dvi/systems.hpp"
#include "sweepvi/partition.hpp"

namespace sweepvi::test {
namespace {

using Parameters = PendulumChain::Parameters;

/// What a run leaves at each step, on every rank, in the order of the elements.
struct History {
  std::vector<std::vector<double>> z, mu;
  std::vector<std::vector<double>> level;
};

std::vector<double> gathered(MPI_Comm comm, const std::vector<double>& mine) {
  Vector vector;
  check(VecCreateMPI(comm, static_cast<PetscInt>(mine.size()), PETSC_DETERMINE, vector.put()));
  {
    const WriteArray values(vector.get());
    std::copy(mine.begin(), mine.end(), values.data());
  }
  return everywhere(vector.get());
}

History march(MPI_Comm comm, ConstrainedDvi& dvi, const TimeGrid& grid) {
  History run;
  const auto record = [&] {
    run.z.push_back(gathered(comm, dvi.z()));
    run.mu.push_back(gathered(comm, dvi.mu()));
    run.level.push_back(gathered(comm, {dvi.level().begin(), dvi.level().end()}));
  };
  record();
  TimeMarch time_march(dvi, grid);
  time_march.observe([&](const Step&, const StepReport&) { record(); });
  EXPECT_TRUE(time_march.run().certified);
  EXPECT_EQ(time_march.steps_taken(), grid.steps);
  return run;
}

History march(MPI_Comm comm, const Parameters& parameters, const TimeGrid& grid, double theta = 1.0) {
  const PendulumChain chain(comm, parameters);
  const auto dvi = make_zd_dvi(chain, grid, theta);
  return march(comm, *dvi, grid);
}

double largest_difference(const std::vector<std::vector<double>>& a,
                          const std::vector<std::vector<double>>& b) {
  EXPECT_EQ(a.size(), b.size());
  double worst = 0.0;
  for (std::size_t k = 0; k < std::min(a.size(), b.size()); ++k) {
    EXPECT_EQ(a[k].size(), b[k].size());
    for (std::size_t i = 0; i < std::min(a[k].size(), b[k].size()); ++i)
      worst = std::max(worst, std::abs(a[k][i] - b[k][i]));
  }
  return worst;
}

double most(const std::vector<std::vector<double>>& values) {
  double result = 0.0;
  for (const auto& row : values)
    for (const double value : row)
      result = std::max(result, std::abs(value));
  return result;
}

/// The linearised chain in physical coordinates (q, p, q', p') of each element, straight from its equations.
LinearSystem physical(const Parameters& p) {
  const auto n = static_cast<std::size_t>(4 * p.count);
  const auto m = static_cast<std::size_t>(p.count);
  DenseSystem dense;
  dense.A.assign(n * n, 0.0);
  dense.B.assign(n * m, 0.0);
  dense.C.assign(m * n, 0.0);
  dense.x0.assign(n, 0.0);
  dense.f.assign(n, Signal{});
  for (std::size_t i = 0; i < m; ++i) {
    const std::size_t q = 4 * i, motor = q + 1, dq = q + 2, dp = q + 3;
    const auto a = [&](std::size_t row, std::size_t column) -> double& { return dense.A[row * n + column]; };
    a(q, dq) = a(motor, dp) = 1.0;
    a(dq, q) = -p.gravity - p.joint;
    a(dq, motor) = p.joint;
    a(dp, q) = p.motor;
    a(dp, motor) = -p.motor;
    for (const std::size_t j : {i - 1, i + 1}) {  // i - 1 wraps around for 0
      if (j >= m) continue;
      a(dq, 4 * j) += p.coupling;
      a(dq, q) -= p.coupling;
    }
    dense.f[dp].offset = p.torque;
    dense.B[dp * m + i] = 1.0;
    dense.C[i * n + q] = 1.0;
    dense.x0[q] = dense.x0[motor] = 0.5 + 0.1 * static_cast<double>(i % 3);
  }
  return LinearSystem::dense(PETSC_COMM_WORLD, dense);
}

// Both make the same steps in other unknowns. Values of order 10 in z_4; rounding of 400 steps in contact,
// where z_4 is found through 1/h^3 from z_1 at worst: 1e-16 / h^... stays below 1e-11 because held outputs
// are exact.
TEST(ZdSystem, LinearCaseIsTheLinearSystem) {
  const TimeGrid grid{0.0, 4.0, 400};
  const Parameters parameters{.count = 3, .sine = 0.0};
  LinearSystem system = physical(parameters);
  RelativeDegree degree = analyse_relative_degree(system);
  ASSERT_EQ(degree.lowest, 4);
  distribute(system, degree);
  ASSERT_EQ(choose_form(system, degree, Scheme::homsp), Form::box_on_z);
  for (const auto& [form, theta] :
       {std::pair{Form::box_on_z, 1.0}, {Form::primal_dual, 1.0}, {Form::box_on_z, 0.5}}) {
    const auto linear = make_linear_dvi(system, degree, Scheme::homsp, form, grid, theta);
    History expected = march(PETSC_COMM_WORLD, *linear, grid);
    // From the order of the ranks to that of the elements.
    std::vector<double> order(system.constraint_order.begin(), system.constraint_order.end());
    order = gathered(PETSC_COMM_WORLD, order);
    const auto reorder = [&](std::vector<std::vector<double>>& rows, std::size_t width) {
      for (auto& row : rows) {
        const std::vector<double> old = row;
        for (std::size_t k = 0; k < order.size(); ++k)
          std::copy_n(
              old.begin() + static_cast<std::ptrdiff_t>(k * width), width,
              row.begin() + static_cast<std::ptrdiff_t>(order[k]) * static_cast<std::ptrdiff_t>(width));
      }
    };
    reorder(expected.z, 4);
    reorder(expected.mu, 4);
    reorder(expected.level, 1);
    const History nonlinear = march(PETSC_COMM_WORLD, parameters, grid, theta);
    EXPECT_GT(most(nonlinear.mu), 0.01);  // they do hit
    EXPECT_LE(largest_difference(expected.z, nonlinear.z), 1e-11);
    EXPECT_LE(largest_difference(expected.mu, nonlinear.mu), 1e-11);
    EXPECT_EQ(largest_difference(expected.level, nonlinear.level), 0.0);
  }
}

// Forward differences: sqrt(eps) of values up to 100 over row entries up to 100.
TEST(ZdSystem, JacobianIsThatOfFiniteDifferences) {
  const Parameters parameters{.count = 5};
  const PendulumChain chain(PETSC_COMM_WORLD, parameters);
  ZdJacobian derivative(chain);
  const TimeGrid grid{0.0, 1.5, 60};
  const auto dvi = make_zd_dvi(chain, grid);
  TimeMarch time_march(*dvi, grid);
  double worst = 0.0;
  time_march.observe([&](const Step& step, const StepReport&) {
    if (step.number % 12 == 0) worst = std::max(worst, derivative.error(step.t_new, dvi->x()));
  });
  EXPECT_TRUE(time_march.run().certified);
  EXPECT_LE(worst, 1e-6);
  EXPECT_GT(worst, 0.0);  // differences are never exact here
}

TEST(ZdSystem, ARunByFiniteDifferencesIsTheSame) {
  const TimeGrid grid{0.0, 1.2, 60};
  const History own = march(PETSC_COMM_WORLD, Parameters{.count = 3}, grid);
  const History differences = march(PETSC_COMM_WORLD, Parameters{.count = 3, .own_jacobian = false}, grid);
  EXPECT_GT(most(own.mu), 0.01);  // they do hit
  // The solution does not depend on the Jacobian, but for the jumps that neighbours get: coefficients good to
  // 1e-7.
  EXPECT_LE(largest_difference(own.z, differences.z), 1e-5);
  EXPECT_EQ(largest_difference(own.level, differences.level), 0.0);
}

TEST(ZdSystem, RanksDoNotMatter) {
  const TimeGrid grid{0.0, 1.5, 75};
  const Parameters parameters{.count = 7};
  const History together = march(PETSC_COMM_WORLD, parameters, grid);
  const History alone = march(PETSC_COMM_SELF, parameters, grid);
  EXPECT_LE(largest_difference(together.z, alone.z), 1e-10);  // rounding of other factorizations
  EXPECT_LE(largest_difference(together.mu, alone.mu), 1e-10);
  EXPECT_EQ(largest_difference(together.level, alone.level), 0.0);
  EXPECT_GT(most(alone.mu), 0.01);  // they do hit
}

// The certificate stands whatever the solver is told to aim at: Newton's iterations on long steps, which
// would stop at 1e-5 of the terms, go on to 1e-10.
TEST(ZdSystem, ATargetDoesNotLowerTheCertificate) {
  const ScopedOption target("-sweepvi_target_rtol", "1e-3");
  const TimeGrid grid{0.0, 1.2, 12};
  const PendulumChain chain(PETSC_COMM_WORLD, Parameters{.count = 2});
  const auto dvi = make_zd_dvi(chain, grid);
  TimeMarch time_march(*dvi, grid);
  time_march.observe([&](const Step&, const StepReport& report) { EXPECT_LE(report.residual, 1e-10); });
  EXPECT_TRUE(time_march.run().certified);
}

/// L1 distance of w of element 0 from a finer run whose steps are `ratio` times as many.
double distance_in_w(const History& coarse, const History& fine, std::size_t ratio, double h) {
  double sum = 0.0;
  for (std::size_t k = 0; k < coarse.z.size(); ++k)
    sum += h * std::abs(coarse.z[k][0] - fine.z[k * ratio][0]);
  return sum;
}

// First order: three runs, each ten times as fine as the one before. The distance between the last two is a
// tenth of that between the first two (Richardson); where an impact falls within its step moves that by some
// per cent.
TEST(ZdSystem, OrderOne) {
  const ScopedOption petsc_lu("-pc_factor_mat_solver_type", "petsc");  // tiny systems
  const double end = 1.2;
  const auto run = [&](PetscInt steps) {
    return march(PETSC_COMM_SELF, Parameters{.count = 2}, TimeGrid{0.0, end, steps});
  };
  const History coarse = run(60);
  const History middle = run(600);
  const History fine = run(6000);
  EXPECT_GT(most(fine.mu), 0.01);
  const double first = distance_in_w(coarse, middle, 10, end / 60);
  const double second = distance_in_w(middle, fine, 10, end / 600);
  EXPECT_NEAR(std::log10(first / second), 1.0, 0.1);
  EXPECT_LT(second, 5e-3);  // h = 2e-3 times speeds of 1.5, over 1.2 s
}

// A neighbour's impact is felt through springs only: the velocity of a motor that nothing pushes,
//     p' = z2 + (z4 + g cos(z1) z2 - c S(z2)) / k,
// moves by O(h) in a step. Without the jumps that z_{a,2} makes in z_{b,4} it would jump by c / k of the
// impact's velocity, 0.1 * 1.5.
TEST(ZdSystem, MotorsOfNeighboursDoNotJump) {
  const TimeGrid grid{0.0, 2.0, 500};
  const Parameters p{.count = 5};
  const History run = march(PETSC_COMM_WORLD, p, grid);
  const auto motor_velocity = [&](std::size_t k, std::size_t i) {
    const std::vector<double>& z = run.z[k];
    double pull = 0.0;
    for (const std::size_t j : {i - 1, i + 1})
      if (j < 5) pull += z[4 * j + 1] - z[4 * i + 1];
    return z[4 * i + 1] +
           (z[4 * i + 3] + p.gravity * std::cos(z[4 * i]) * z[4 * i + 1] - p.coupling * pull) / p.joint;
  };
  double worst = 0.0;
  double largest_impact = 0.0;
  for (std::size_t k = 1; k < run.z.size(); ++k) {
    for (std::size_t i = 0; i < 5; ++i) {
      double measures = 0.0;
      for (std::size_t level = 0; level < 4; ++level)
        measures += std::abs(run.mu[k][4 * i + level]);
      largest_impact = std::max(largest_impact, run.mu[k][4 * i + 1]);
      if (measures == 0.0) worst = std::max(worst, std::abs(motor_velocity(k, i) - motor_velocity(k - 1, i)));
    }
  }
  EXPECT_GT(largest_impact, 1.0);
  EXPECT_LE(worst, 0.06);  // |p''| = |k_m (q - p) + torque| < 15, times h = 4e-3
}

/// A driven Duffing oscillator between two walls (r = 2) with zero dynamics xi' = -xi + z1^2.
class Duffing final : public ZdSystem {
public:
  explicit Duffing(double sign = 1.0, double gain = 2.0) : sign_(sign), gain_(gain) {}
  std::vector<Constraint> constraints() const override {
    if (!first()) return {};
    return {{.levels = {0, 1}, .wmax = 1.0}};
  }
  Vector initial_state() const override {
    Vector u;
    check(VecCreateMPI(PETSC_COMM_WORLD, first() ? 3 : 0, PETSC_DETERMINE, u.put()));
    const WriteArray values(u.get());
    if (first()) values[0] = sign_ > 0.0 ? 0.3 : 0.7, values[1] = 0.0, values[2] = 0.0;
    return u;
  }
  void rates(double t, Vec u, Vec rates) const override {
    const ReadArray z(u);
    const WriteArray rate(rates);
    if (!first()) return;
    const double x = sign_ * (z[0] - 0.5);  // from the middle
    rate[1] = sign_ * (x - 4.0 * x * x * x + 6.0 * std::sin(3.0 * t)) - 0.1 * z[1];
    rate[2] = -z[2] + x * x;
  }
  void gains(double, Vec, std::vector<double>& m) const override { m.assign(m.size(), gain_); }
  Matrix pattern() const override {
    Matrix matrix;
    const PetscInt local = first() ? 3 : 0;
    check(MatCreateAIJ(PETSC_COMM_WORLD, local, local, 3, 3, 3, nullptr, 3, nullptr, matrix.put()));
    if (first()) {
      for (const auto& [row, column] : {std::pair{1, 0}, {1, 1}, {2, 0}, {2, 2}})
        check(MatSetValue(matrix.get(), row, column, 1.0, INSERT_VALUES));
    }
    check(MatAssemblyBegin(matrix.get(), MAT_FINAL_ASSEMBLY));
    check(MatAssemblyEnd(matrix.get(), MAT_FINAL_ASSEMBLY));
    return matrix;
  }

private:
  static bool first() {
    int rank = 0;
    MPI_Comm_rank(PETSC_COMM_WORLD, &rank);
    return rank == 0;
  }
  double sign_, gain_;
};

// Mirrored at the middle, the same motion and opposite measures; both walls are hit and never passed.
TEST(ZdSystem, TwoWallsAreMirrorImages) {
  const TimeGrid grid{0.0, 6.0, 600};
  std::vector<History> runs;
  for (const double sign : {1.0, -1.0}) {
    const Duffing system(sign);
    const auto dvi = make_zd_dvi(system, grid);
    runs.push_back(march(PETSC_COMM_WORLD, *dvi, grid));
  }
  double least = 1.0, greatest = 0.0;
  for (std::size_t k = 0; k < runs[0].z.size(); ++k) {
    const double w = runs[0].z[k][0];
    least = std::min(least, w);
    greatest = std::max(greatest, w);
    EXPECT_NEAR(w, 1.0 - runs[1].z[k][0], 1e-12);  // rounding of 600 steps
    EXPECT_NEAR(runs[0].z[k][1], -runs[1].z[k][1], 1e-11);
    EXPECT_NEAR(runs[0].mu[k][1], -runs[1].mu[k][1], 1e-10);
  }
  EXPECT_EQ(least, 0.0);
  EXPECT_EQ(greatest, 1.0);
}

void expect_bad_input(const std::function<void()>& action) {
  try {
    action();
    ADD_FAILURE() << "nothing was thrown";
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ExitCode::bad_input) << error.what();
  }
}

TEST(ZdSystem, WhatMakesNoSenseIsRefused) {
  class Wrong final : public ZdSystem {
  public:
    explicit Wrong(std::vector<Constraint> constraints) : constraints_(std::move(constraints)) {}
    std::vector<Constraint> constraints() const override { return constraints_; }
    Vector initial_state() const override { return chain_.initial_state(); }
    void rates(double t, Vec u, Vec rates) const override { chain_.rates(t, u, rates); }
    Matrix pattern() const override { return chain_.pattern(); }

  private:
    PendulumChain chain_{PETSC_COMM_SELF, Parameters{}};
    std::vector<Constraint> constraints_;
  };
  const TimeGrid grid{0.0, 1.0, 10};
  for (const std::vector<ZdSystem::Constraint>& constraints :
       {std::vector<ZdSystem::Constraint>{{.levels = {0, 1, 2, 4}}},
        {{.levels = {0, 1, 1}}},
        {{.levels = {}}},
        {{.levels = {0, 1}}, {.levels = {1, 2}}},
        {{.levels = {0, 1, 2, 3}, .wmax = 0.0}}}) {
    const Wrong system(constraints);
    expect_bad_input([&] { make_zd_dvi(system, grid); });
  }
  const Duffing without_push(1.0, 0.0);
  expect_bad_input([&] { make_zd_dvi(without_push, grid); });
}

}  // namespace
}  // namespace sweepvi::test
