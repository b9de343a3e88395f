// Steps that no attempt solves, taken in parts: h times an eigenvalue of the system is exactly 1, so that the
// step's matrix is singular, and that of half the step is not.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>

#include "dvi/runs.hpp"
#include "petsc/sparse.hpp"
#include "sweepvi/impact_oscillators.hpp"
#include "sweepvi/lagrangian.hpp"
#include "sweepvi/sweeping.hpp"
#include "sweepvi/zd_system.hpp"

namespace sweepvi::test {
namespace {

constexpr double h = 0.5;  // a power of two: h times 1/h is 1, and times are exact

/// What a march leaves: the state after each step, and what its steps sum up to.
struct Trace {
  std::vector<std::vector<double>> x, mu;
  std::vector<StepReport> reports;
  PetscInt events = 0;
  bool certified = false;
};

using Maker = std::function<std::unique_ptr<ConstrainedDvi>(const TimeGrid&)>;

std::vector<double> add(std::vector<double> a, const std::vector<double>& b) {
  for (std::size_t i = 0; i < a.size(); ++i)
    a[i] += b[i];
  return a;
}

Trace trace(const Maker& make, const TimeGrid& grid) {
  const auto dvi = make(grid);
  Trace run;
  std::vector<double> sum(dvi->mu().size(), 0.0);
  TimeMarch march(*dvi, grid);
  march.observe_parts([&](const Step&, const StepReport&) {
    sum = add(sum, dvi->mu());
    run.events += static_cast<PetscInt>(dvi->events().size());
  });
  march.observe([&](const Step& step, const StepReport& report) {
    EXPECT_EQ(step.t_new, grid.time(step.number));
    EXPECT_EQ(step.h, h * static_cast<double>(8) / static_cast<double>(grid.steps));
    run.x.push_back(everywhere(dvi->x()));
    run.mu.push_back(add(sum, dvi->mu()));
    run.events += static_cast<PetscInt>(dvi->events().size());
    std::fill(sum.begin(), sum.end(), 0.0);
    run.reports.push_back(report);
  });
  run.certified = march.run().certified;
  return run;
}

/// The march in steps of h is that in steps of h/2, seen after every other step: the same numbers, as the
/// same arithmetic leads to them.
void expect_halved(const Maker& make) {
  const Trace whole = trace(make, {0.0, 8 * h, 8});
  const Trace halves = trace(make, {0.0, 8 * h, 16});
  ASSERT_TRUE(whole.certified);
  ASSERT_TRUE(halves.certified);
  ASSERT_EQ(whole.x.size(), 8U);
  for (std::size_t k = 0; k < whole.x.size(); ++k) {
    EXPECT_EQ(whole.reports[k].rung, Rung::smaller_step);
    EXPECT_LT(halves.reports[2 * k].rung, Rung::smaller_step);
    EXPECT_LE(whole.reports[k].residual, 1e-14);
    // Starts of the solver differ (the failed attempts), and with them the last digit.
    for (std::size_t i = 0; i < whole.x[k].size(); ++i)
      EXPECT_NEAR(whole.x[k][i], halves.x[2 * k + 1][i], 1e-13 * (1.0 + std::abs(whole.x[k][i])));
    const std::vector<double> sum = add(halves.mu[2 * k], halves.mu[2 * k + 1]);
    for (std::size_t i = 0; i < sum.size(); ++i)
      EXPECT_NEAR(whole.mu[k][i], sum[i], 1e-13 * (1.0 + std::abs(sum[i])));
  }
  EXPECT_EQ(whole.events, halves.events);
  PetscInt events = whole.events;
  MPI_Allreduce(MPI_IN_PLACE, &events, 1, MPIU_INT, MPI_SUM, PETSC_COMM_WORLD);
  EXPECT_GT(events, 0);  // or nothing was compared
}

// x1' = x1 / (h theta) beside x2'' = -2 + lambda, 0 <= x2 from 1 m: it lands at 1 s.
void expect_halved_linear(double theta) {
  LinearSystem system = LinearSystem::dense(PETSC_COMM_WORLD, {.A = {1 / (h * theta), 0, 0, 0, 0, 1, 0, 0, 0},
                                                               .B = {0, 0, 1},
                                                               .C = {0, 1, 0},
                                                               .x0 = {1, 1, 0},
                                                               .f = {{0.0}, {0.0}, {-2.0}}});
  RelativeDegree degree = analyse_relative_degree(system);
  distribute(system, degree);
  for (const Form form : {Form::box_on_z, Form::primal_dual}) {
    const Maker make = [&](const TimeGrid& grid) {
      return make_linear_dvi(system, degree, Scheme::homsp, form, grid, theta);
    };
    expect_halved(make);
    const Trace run = trace(make, {0.0, 8 * h, 8});
    const double half = (1.0 + (1.0 - theta) / (2.0 * theta)) / (1.0 - 0.5);
    for (std::size_t k = 0; k < run.x.size(); ++k) {
      const double expected = std::pow(half, 2 * (k + 1));
      EXPECT_NEAR(in_scene_order(system, run.x[k])[0], expected, 1e-14 * expected);
    }
  }
}

TEST(SmallerStep, LinearSystemsInBothForms) {
  for (const double theta : {1.0, 0.5})
    expect_halved_linear(theta);
}

// Implicit in position, with M = 1 and K = -1 / h^2: M + h^2 K = 0. Beside it a bouncing ball.
TEST(SmallerStep, MoreauJean) {
  LagrangianSystem system = LagrangianSystem::dense(PETSC_COMM_WORLD, {.M = {1, 0, 0, 1},
                                                                       .K = {-1 / (h * h), 0, 0, 0},
                                                                       .H = {0, 1},
                                                                       .q0 = {1e-3, 1.0},
                                                                       .v0 = {0.0, 0.0},
                                                                       .f = {{0.0}, {-2.0}},
                                                                       .e = {0.5}});
  distribute(system);
  expect_halved([&](const TimeGrid& grid) { return make_moreau_jean(system, {.theta = 1.0}, grid); });
}

TEST(SmallerStep, SweepingProcesses) {
  const std::vector<double> A = {1 / h, 0, 0, 0};
  SweepingSystem box = SweepingSystem::dense(
      PETSC_COMM_WORLD, {.u0 = {1, 1}, .f = {{0.0}, {-1.0}}, .A = A, .lower = {{-HUGE_VAL}, {0.0}}});
  distribute(box);
  expect_halved([&](const TimeGrid& grid) { return make_sweeping_dvi(box, grid); });
  SweepingSystem polyhedron = SweepingSystem::dense(
      PETSC_COMM_WORLD, {.u0 = {1, 1}, .f = {{0.0}, {-1.0}}, .A = A, .G = {0, 1}, .g = {{0.0}}});
  distribute(polyhedron);
  expect_halved([&](const TimeGrid& grid) { return make_sweeping_dvi(polyhedron, grid); });
}

/// xi' = f(t, xi) on rank 0; beside it z' = -1 + lambda, z >= 0.
class Alone final : public ZdSystem {
public:
  using Function = double (*)(double t, double xi);
  Alone(Function f, Function by_xi) : f_(f), by_xi_(by_xi) { MPI_Comm_rank(PETSC_COMM_WORLD, &rank_); }
  std::vector<Constraint> constraints() const override {
    return rank_ == 0 ? std::vector<Constraint>{{{0}, HUGE_VAL}} : std::vector<Constraint>{};
  }
  Vector initial_state() const override {
    Vector u = make_vector(PETSC_COMM_WORLD, rank_ == 0 ? 2 : 0);
    check(VecSet(u.get(), 1.0));
    return u;
  }
  void rates(double t, Vec u, Vec rates) const override {
    const ReadArray values(u);
    const WriteArray f(rates);
    if (f.size() == 0) return;
    f[0] = -1.0;
    f[1] = f_(t, values[1]);
  }
  Matrix pattern() const override {
    RowBuilder rows;
    for (PetscInt i = 0; rank_ == 0 && i < 2; ++i) {
      rows.add(i, 1.0);
      rows.end_row();
    }
    return rows.finish(PETSC_COMM_WORLD, rank_ == 0 ? 2 : 0);
  }
  bool jacobian(double t, Vec u, Mat jacobian) const override {
    if (rank_ == 0) {
      const ReadArray values(u);
      check(MatSetValue(jacobian, 0, 0, 0.0, INSERT_VALUES));
      check(MatSetValue(jacobian, 1, 1, by_xi_(t, values[1]), INSERT_VALUES));
    }
    check(MatAssemblyBegin(jacobian, MAT_FINAL_ASSEMBLY));
    check(MatAssemblyEnd(jacobian, MAT_FINAL_ASSEMBLY));
    return true;
  }

private:
  Function f_, by_xi_;
  int rank_ = 0;
};

/// xi' = a(t) xi, a = 1 / h at 3 h and 0.1 elsewhere.
double growth(double t, double) {
  return std::abs(t - 3 * h) < h / 8 ? 1 / h : 0.1;
}
double grown(double t, double xi) {
  return growth(t, xi) * xi;
}

// One step of five is divided; those after it are as long as before.
TEST(SmallerStep, OnlyWhereItIsNeeded) {
  const Alone system(grown, growth);
  const TimeGrid grid{0.0, 5 * h, 5};
  const auto dvi = make_zd_dvi(system, grid);
  TimeMarch march(*dvi, grid);
  std::vector<Rung> rungs;
  int parts = 0;
  march.observe_parts([&](const Step& part, const StepReport&) {
    ++parts;
    EXPECT_EQ(part.number, 3);
    EXPECT_EQ(part.t_new, 2.5 * h);
  });
  march.observe([&](const Step&, const StepReport& report) { rungs.push_back(report.rung); });
  ASSERT_TRUE(march.run().certified);
  EXPECT_EQ(parts, 1);
  ASSERT_EQ(rungs.size(), 5U);
  for (std::size_t k = 0; k < 5; ++k)
    EXPECT_EQ(rungs[k] == Rung::smaller_step, k == 2);
  double expected = 1.0;
  for (const double factor : {0.1 * h, 0.1 * h, 0.05 * h, 0.5, 0.1 * h, 0.1 * h})
    expected /= 1.0 - factor;
  const std::vector<double> x = everywhere(dvi->x());
  EXPECT_NEAR(x[1], expected, 1e-14 * expected);  // a dozen operations
  EXPECT_EQ(x[0], 0.0);                           // landed after two steps
}

// Without division the step fails, with the cause, and leaves its problem behind.
TEST(SmallerStep, WhereItIsNotWanted) {
  const ScopedOption never("-sweepvi_halvings", "0");
  const Alone system(grown, growth);
  const TimeGrid grid{0.0, 5 * h, 5};
  const auto dvi = make_zd_dvi(system, grid);
  TimeMarch march(*dvi, grid);
  const StepReport report = march.run();
  EXPECT_FALSE(report.certified);
  EXPECT_EQ(march.steps_taken(), 2);
  EXPECT_NE(report.linear_failure.find("singular"), std::string::npos) << report.linear_failure;
  const StepProblem problem = march.problem();
  EXPECT_TRUE(problem.affine);
  const std::vector<double> q = everywhere(problem.q.get());
  EXPECT_NEAR(q[1], -1.0 / ((1.0 - 0.1 * h) * (1.0 - 0.1 * h)), 1e-14);  // F = 0 xi - xi_2
  EXPECT_EQ(everywhere(problem.lower.get())[0], 0.0);
  double largest = 0.0;
  check(MatNorm(problem.M.get(), NORM_INFINITY, &largest));
  EXPECT_EQ(largest, 1.0);  // of z; that of xi is 0
}

// xi' = c (1 + xi^2): for c h = 50 and more, no real xi solves xi = 1 + c h (1 + xi^2). After all parts have
// failed everything is as before.
TEST(SmallerStep, InVain) {
  constexpr double c = 1e5;  // 1e5 h / 1024 = 50
  const Alone system([](double, double xi) { return c * (1.0 + xi * xi); },
                     [](double, double xi) { return 2.0 * c * xi; });
  const TimeGrid grid{0.0, 5 * h, 5};
  const auto dvi = make_zd_dvi(system, grid);
  TimeMarch march(*dvi, grid);
  const StepReport report = march.run();
  EXPECT_FALSE(report.certified);
  EXPECT_EQ(march.steps_taken(), 0);
  EXPECT_EQ(everywhere(dvi->x()), (std::vector<double>{1, 1}));
  // The problem left is that of the whole step, linearised: F = xi - 1 - c h (1 + xi^2), M = 1 - 2 c h xi.
  const StepProblem problem = march.problem();
  EXPECT_FALSE(problem.affine);
  const double xi = everywhere(problem.u0.get())[1];
  const double M = 1.0 - 2.0 * c * h * xi;
  const double F = xi - 1.0 - c * h * (1.0 + xi * xi);
  EXPECT_NEAR(everywhere(problem.q.get())[1], F - M * xi, 1e-12 * std::abs(F - M * xi));
}

}  // namespace
}  // namespace sweepvi::test
