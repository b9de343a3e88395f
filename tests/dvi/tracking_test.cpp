// Tracking through impacts, HO (4)-(8): the paper's data, closed forms, invariances, what is taken of many
// solutions.
#include "sweepvi/tracking.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <random>
#include <sstream>

#include "dvi/systems.hpp"
#include "petsc/sparse.hpp"

namespace sweepvi::test {
namespace {

/// The data of HO, section V.B.
TrackingProblem paper() {
  return {.plant = {.kappa = 0.5, .x0 = 6.0, .velocity0 = 5.0, .force = Signal{-9.81}},
          .reference = {.kappa = 0.5, .x0 = 3.0, .velocity0 = 3.0, .force = Signal{-19.81}},
          .gains = {30.0, 17.0}};
}

struct Motion {
  bool certified = false;
  PetscInt taken = 0, predicted = 0, iterations = 0;
  double worst = 0.0;
  std::vector<TrackingState> states;  // after each step; the same on every rank
  std::vector<StepEvent> events;      // of all steps, on rank 0
};

Motion march(const TrackingProblem& problem, const TimeGrid& grid, const TrackingOptions& options = {}) {
  const auto dvi = make_tracking_dvi(PETSC_COMM_WORLD, problem, options);
  TimeMarch march(*dvi, grid);
  Motion run;
  march.observe([&](const Step&, const StepReport& report) {
    TrackingState state = dvi->tracked();
    MPI_Bcast(&state, sizeof state, MPI_BYTE, 0, PETSC_COMM_WORLD);
    run.states.push_back(state);
    run.predicted += report.predicted ? 1 : 0;
    run.iterations += report.iterations;
    run.worst = std::max(run.worst, report.residual);
    run.events.insert(run.events.end(), dvi->events().begin(), dvi->events().end());
  });
  run.certified = march.run().certified;
  run.taken = march.steps_taken();
  return run;
}

double error(const TrackingState& state) {
  return std::max(std::abs(state.s - state.s_ref), std::abs(state.v - state.v_ref));
}

std::vector<std::vector<double>> reference_rows() {
  std::ifstream file(std::string(std::getenv("SWEEPVI_SOURCE")) + "/tests/reference/tracking_xdot.csv");
  std::string line;
  std::getline(file, line);
  std::vector<std::vector<double>> rows;
  while (std::getline(file, line)) {
    std::stringstream words(line);
    std::vector<double> row;
    for (std::string word; std::getline(words, word, ',');)
      row.push_back(std::stod(word));
    rows.push_back(row);
  }
  return rows;
}

TEST(Tracking, ThePapersData) {
  const Motion run = march(paper(), {0.0, 4.0, 4000});
  EXPECT_TRUE(run.certified);
  // The guess by branches is the solution. In one step v_ref, from sums of the data, is zero up to rounding,
  // and becomes zero: what that leaves in its row may be polished.
  EXPECT_GE(run.predicted, 3999);
  const auto rows = reference_rows();
  ASSERT_GT(rows.size(), 200U);
  for (const auto& row : rows) {
    const auto k = static_cast<std::size_t>(std::lround(1000.0 * row[0]));
    if (k == 0) continue;
    const TrackingState& state = run.states[k - 1];
    EXPECT_NEAR(state.s_ref, row[3], 1e-8) << "t = " << row[0];
    EXPECT_NEAR(state.v_ref, row[4], 1e-8) << "t = " << row[0];
    if (k > 1225) continue;  // from here on s, v, u are not unique in steps with s = s_ref = 0
    EXPECT_NEAR(state.s, row[1], 1e-8) << "t = " << row[0];
    EXPECT_NEAR(state.v, row[2], 1e-8) << "t = " << row[0];
    EXPECT_NEAR(state.control, row[5], 1e-6) << "t = " << row[0];  // differences of v over h
  }
  for (std::size_t k = 1225; k < 4000; ++k)
    EXPECT_EQ(error(run.states[k]), 0.0) << "step " << k + 1;  // held is held
  for (const TrackingState& state : run.states) {
    EXPECT_LE(std::abs(state.control), state.control_bound);
    EXPECT_NEAR(state.control_bound, 1.5 * (47.0 + 2.0 * 19.81) + 9.81, 1e-12);
  }
  EXPECT_EQ(run.states.back().control, 0.0);  // at rest beside the reference the wall carries the plant
  EXPECT_EQ(run.states.back().x, 0.0);
  // Off the wall, once the errors are gone, the control makes the forces equal: u = F_ref - F.
  EXPECT_NEAR(run.states[1240].control, -10.0, 1e-9);  // rounding of v over h
}

// While no sign changes, s'' and v' are constant: theta = 1/2 is exact, theta = 1 late by h/2.
TEST(Tracking, FreeFlightInClosedForm) {
  const double a = -30.0 - 17.0 - 2.0 * 19.81;  // e_s, e_v, s, v, s_ref, v_ref > 0, R = 1/2
  for (const double theta : {0.5, 0.75, 1.0}) {
    const TimeGrid grid{0.0, 0.06, 60};
    const Motion run = march(paper(), grid, {.theta = theta});
    EXPECT_TRUE(run.certified);
    for (std::size_t k = 0; k < 60; ++k) {
      const double t = grid.time(static_cast<PetscInt>(k) + 1);
      const double late = (theta - 0.5) * grid.h() * t;
      EXPECT_NEAR(run.states[k].v, 10.0 + a * t, 1e-13);
      EXPECT_NEAR(run.states[k].s, 6.0 + 0.5 * (10.0 * t + a * (0.5 * t * t + late)), 1e-13);
      EXPECT_NEAR(run.states[k].x_ref, 3.0 + 3.0 * t - 19.81 * (0.5 * t * t + late), 1e-13);
    }
  }
}

// Larger steps and other weights bring the same end: beside the reference, at rest. For theta = 1/2 rest is
// s = 0 and v, -v, v, ...: its weighted v is zero.
TEST(Tracking, EveryWeightTracks) {
  for (const auto& [theta, gamma] : {std::pair{1.0, 1.0}, {0.5, 1.0}, {0.6, 0.8}, {1.0, 0.7}}) {
    const Motion run = march(paper(), {0.0, 2.0, 1000}, {.theta = theta, .gamma = gamma});
    EXPECT_TRUE(run.certified) << theta << ", " << gamma << ": " << run.taken;
    const TrackingState& end = run.states.back();
    EXPECT_LE(error(end), 1e-14) << theta << ", " << gamma;
    EXPECT_EQ(end.x, 0.0) << theta << ", " << gamma;
    EXPECT_LE(end.velocity, theta > 0.5 ? 1e-14 : 0.002 * 19.81) << theta << ", " << gamma;
    for (const TrackingState& state : run.states)
      EXPECT_LE(std::abs(state.control), state.control_bound);
  }
}

TEST(Tracking, ResamplingChangesNothing) {
  const TimeGrid grid{0.0, 2.0, 2000};
  const Motion direct = march(paper(), grid);
  const Motion resampled = march(paper(), grid, {.resample = true});
  EXPECT_TRUE(resampled.certified);
  double negative = 0.0;
  for (std::size_t k = 0; k < direct.states.size(); ++k) {
    const TrackingState& a = direct.states[k];
    const TrackingState& b = resampled.states[k];
    negative = std::min(negative, a.s);
    EXPECT_NEAR(a.x, b.x, 1e-9) << k;
    EXPECT_NEAR(a.velocity, b.velocity, 1e-9) << k;
    EXPECT_NEAR(a.x_ref, b.x_ref, 1e-9) << k;
    EXPECT_NEAR(a.control, b.control, 1e-6) << k;
  }
  EXPECT_LT(negative, -0.1);  // or nothing was ever turned over
}

// While |lambda_s| = 1 the control takes the plant's force out, whatever it is: s and v do not see it, and u
// makes up for it. Afterwards forces that depend on the motion are part of the step's VI.
TEST(Tracking, ForcesOfTheMotion) {
  const TimeGrid grid{0.0, 2.0, 2000};
  const auto drag = [](double t, double x, double velocity) {
    return -9.81 - 0.5 * x - 0.2 * velocity + std::sin(t);
  };
  TrackingProblem pulled = paper();
  pulled.plant.force = ForceLaw(drag);
  const Motion plain = march(paper(), grid);
  const Motion run = march(pulled, grid);
  EXPECT_TRUE(run.certified);
  for (std::size_t k = 0; k < 1079; ++k) {  // s = 0 at 1.080 s
    const TrackingState& a = plain.states[k];
    const TrackingState& b = run.states[k];
    const double t = grid.time(static_cast<PetscInt>(k) + 1);
    EXPECT_NEAR(a.s, b.s, 1e-12) << k;
    EXPECT_NEAR(a.v, b.v, 1e-9) << k;  // rounding of s over h
    EXPECT_NEAR(a.control - 9.81, b.control + drag(t, b.x, b.velocity), 1e-6) << k;
  }
  // A reference on a spring, whose motion is known off the wall: x'' = -9 x, from 1 at rest, until it hits at
  // t = pi / 6. First order, with C = 9/2 * t for this linear equation.
  TrackingProblem spring = paper();
  spring.reference = {.kappa = 0.5,
                      .x0 = 1.0,
                      .velocity0 = 0.0,
                      .force = ForceLaw([](double, double x, double) { return -9.0 * x; })};
  const Motion swing = march(spring, grid);
  EXPECT_TRUE(swing.certified);
  for (std::size_t k = 0; k < 523; ++k) {
    const double t = grid.time(static_cast<PetscInt>(k) + 1);
    EXPECT_NEAR(swing.states[k].x_ref, std::cos(3.0 * t), 4.5 * 1.1 * t * grid.h()) << k;
  }
}

// The forces may point away from the wall. A plant at rest beside a resting reference is then held back by
// the control (u = -F): that it stayed there by itself, lambda_s = 0, is a solution of the VI, but none of HO
// (1). A reference that leaves takes the plant along.
TEST(Tracking, NothingSticksToTheWall) {
  const TimeGrid grid{0.0, 0.5, 50};
  TrackingProblem held = paper();
  held.plant = {.kappa = 0.5, .force = Signal{5.0}};
  held.reference = {.kappa = 0.5, .force = Signal{-1.0}};
  const Motion stays = march(held, grid);
  EXPECT_TRUE(stays.certified);
  for (const TrackingState& state : stays.states) {
    EXPECT_EQ(state.x, 0.0);
    EXPECT_NEAR(state.control, -5.0, 1e-12);
  }
  held.plant.force = Signal{-5.0};
  const Motion rests = march(held, grid);
  for (const TrackingState& state : rests.states)
    EXPECT_EQ(state.control, 0.0);  // the wall holds it

  held.reference.force = Signal{2.0};
  const Motion leaves = march(held, grid, {.theta = 0.5});  // exact for constant accelerations
  EXPECT_TRUE(leaves.certified);
  for (std::size_t k = 0; k < 50; ++k) {
    const double t = grid.time(static_cast<PetscInt>(k) + 1);
    EXPECT_NEAR(leaves.states[k].x_ref, t * t, 1e-14);
    EXPECT_EQ(leaves.states[k].s, leaves.states[k].s_ref);
    EXPECT_NEAR(leaves.states[k].control, 7.0, 1e-10);  // differences of v over h
  }
}

// Each system has a restitution of its own. Then no control can make (s, v) equal: off the wall e_s = 0 asks
// for another e_v after each bounce, (8a). The errors come back with every bounce, shrink with the bounces,
// and end at rest.
TEST(Tracking, AnotherRestitution) {
  TrackingProblem problem = paper();
  problem.reference.kappa = 0.3;
  const TimeGrid grid{0.0, 2.5, 2500};
  const Motion run = march(problem, grid);
  EXPECT_TRUE(run.certified);
  double apart = 0.0;
  for (std::size_t k = 1300; k < 2500; ++k)
    apart = std::max(apart, std::abs(run.states[k].s - run.states[k].s_ref));
  EXPECT_GT(apart, 0.01);
  EXPECT_LT(apart, 0.1);  // of bounces 0.27 m high
  EXPECT_EQ(error(run.states.back()), 0.0);
  EXPECT_EQ(run.states.back().x, 0.0);
}

// Any data: the branches always hold a solution, and it is certified as it is.
TEST(Tracking, RandomProblems) {
  std::mt19937 engine(5);  // the same on all ranks
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  for (int trial = 0; trial < 24; ++trial) {
    const auto force = [&] {
      const double mean = uniform(engine) < 0.2 ? 10.0 * uniform(engine) : -20.0 * uniform(engine);
      return Signal{.offset = mean, .amplitude = trial % 3 == 0 ? 8.0 : 0.0, .frequency = 0.7};
    };
    const auto bouncer = [&] {
      const double kappa = 0.05 + 0.9 * uniform(engine);
      const double x0 = 3.0 * uniform(engine);
      return Bouncer{.kappa = kappa, .x0 = x0, .velocity0 = 10.0 * uniform(engine) - 5.0, .force = force()};
    };
    TrackingProblem problem{.plant = bouncer(), .reference = bouncer(), .gains = {}};
    problem.gains.mu1 = 10.0 + 30.0 * uniform(engine);
    problem.gains.mu2 = problem.gains.mu1 * (0.01 + 0.99 * uniform(engine));
    if (trial % 2 == 0) problem.reference.kappa = problem.plant.kappa;
    const Motion run = march(problem, {0.0, 4.0, trial % 4 < 2 ? 100 : 500});
    EXPECT_TRUE(run.certified) << "trial " << trial << " failed after " << run.taken << " steps";
    EXPECT_EQ(run.predicted, run.taken) << "trial " << trial;
  }
}

TEST(Tracking, JacobianAgainstDifferences) {
  TrackingProblem problem = paper();
  problem.reference.kappa = 0.3;
  problem.plant.force =
      ForceLaw([](double t, double x, double velocity) { return t - 9.0 * x - 2.0 * velocity * velocity; });
  problem.reference.force =
      ForceLaw([](double, double x, double velocity) { return -8.0 * x * x - velocity; });
  const auto dvi = make_tracking_dvi(PETSC_COMM_WORLD, problem, {.theta = 0.7, .gamma = 0.6});
  const Matrix jacobian = dvi->create_jacobian();
  const auto vector = [&] { return duplicate(dvi->state()); };
  const Vector lower = vector(), upper = vector(), u = vector(), f = vector(), difference = vector(),
               column = vector(), unit = vector();
  constexpr double h = 0.1;
  dvi->begin({1, 0.0, h, h}, lower.get(), upper.get(), u.get());
  std::mt19937 engine(3);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  double largest = 0.0;
  for (int trial = 0; trial < 20; ++trial) {
    {
      const WriteArray values(u.get());
      for (PetscInt i = 0; i < values.size(); ++i)
        values[i] = uniform(engine);
    }
    dvi->jacobian(u.get(), jacobian.get());
    for (PetscInt j = 0; j < 10; ++j) {
      constexpr double step = 1e-6;
      check(VecSet(unit.get(), 0.0));
      check(VecSetValue(unit.get(), j, 1.0, ADD_VALUES));  // from each rank, hence the division
      check(VecAssemblyBegin(unit.get()));
      check(VecAssemblyEnd(unit.get()));
      double length = 0.0;
      check(VecNorm(unit.get(), NORM_2, &length));
      check(VecScale(unit.get(), 1.0 / length));
      check(VecAXPY(u.get(), step, unit.get()));
      dvi->residual(u.get(), difference.get());
      check(VecAXPY(u.get(), -2.0 * step, unit.get()));
      dvi->residual(u.get(), f.get());
      check(VecAXPY(u.get(), step, unit.get()));
      check(VecAXPY(difference.get(), -1.0, f.get()));
      check(VecScale(difference.get(), 0.5 / step));
      check(MatMult(jacobian.get(), unit.get(), column.get()));
      check(VecNorm(column.get(), NORM_INFINITY, &length));
      largest = std::max(largest, length);
      check(VecAXPY(column.get(), -1.0, difference.get()));
      double error = 0.0;
      check(VecNorm(column.get(), NORM_INFINITY, &error));
      // Central differences are good to 1e-9 here, forward ones, in which the law's derivatives enter, to h
      // 1e-6.
      EXPECT_LE(error, 1e-6) << "column " << j << ", trial " << trial;
    }
  }
  EXPECT_GT(largest, 1.0);  // h mu_1 = 3
}

TEST(Tracking, Events) {
  const TimeGrid grid{0.0, 2.0, 2000};
  const Motion run = march(paper(), grid);
  int rank = 0;
  MPI_Comm_rank(PETSC_COMM_WORLD, &rank);
  if (rank != 0) {
    EXPECT_TRUE(run.events.empty());
    return;
  }
  // The reference falls from 3 m with 3 m/s: it hits at the root of 3 + 3 t - 19.81 t^2 / 2, then after
  // flights that shrink by e = 1/3 each; here those that last more than two steps, 2 v / 19.81 > 0.002.
  std::vector<StepEvent> hits;
  for (const StepEvent& event : run.events) {
    EXPECT_TRUE(event.impact);
    if (event.constraint == 1) hits.push_back(event);
  }
  double v = std::sqrt(9.0 + 6.0 * 19.81) / 1.5;
  const double velocity_of_two_steps =
      2.0 * grid.h() * 19.81 / 0.5;  // first order: each impact is that early or late
  ASSERT_GE(hits.size(), 5U);
  for (std::size_t k = 0; k < 5; ++k, v /= 3.0) {
    EXPECT_NEAR(hits[k].impulse, 2.0 * v, 2.0 * velocity_of_two_steps) << "impact " << k;
  }
}

TEST(Tracking, RefusesWhatMakesNoSense) {
  const auto expect_refusal = [](const TrackingProblem& problem, const TrackingOptions& options = {}) {
    EXPECT_THROW(make_tracking_dvi(PETSC_COMM_WORLD, problem, options), Error);
  };
  for (const double kappa : {0.0, 1.0, -0.5}) {
    TrackingProblem problem = paper();
    problem.reference.kappa = kappa;
    expect_refusal(problem);
  }
  TrackingProblem problem = paper();
  problem.plant.x0 = -1e-9;
  expect_refusal(problem);
  problem = paper();
  problem.gains.mu2 = 0.0;
  expect_refusal(problem);
  expect_refusal(paper(), {.theta = 0.0});
  expect_refusal(paper(), {.gamma = 1.5});
  EXPECT_TRUE(tracking_gains_suffice({30.0, 17.0}));
  EXPECT_FALSE(tracking_gains_suffice({17.0, 17.0}));
}

}  // namespace
}  // namespace sweepvi::test
