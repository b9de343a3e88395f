// HOMSP with theta < 1: what its step is, and that theta = 1/2 is of order 2 in flight, in contact and across
// the events of AB (65).
//
// ranks: 1 2
// several: Theta.StepIsThatOfTheMeasureEquation:Theta.OutsideOfItsRangeIsRefused
#include <gtest/gtest.h>

#include <Eigen/Dense>

#include "dvi/runs.hpp"

namespace sweepvi::test {
namespace {

const Eigen::Matrix<double, 5, 5> a65 = (Eigen::Matrix<double, 5, 5>() << 0, 1, 0, 0, 0, 0, 0, 1, 0, 0, -1,
                                         -1, -1, 0, 1, 0, 0, 0, 0, 1, 1, 0, 0, -1, 0)
                                            .finished();

DenseSystem dense65(const std::vector<Signal>& f = {}) {
  return {.A = row_major(a65), .B = {0, 0, 1, 0, 0}, .C = {1, 0, 0, 0, 0}, .x0 = {1, 0, 0, 0, 0}, .f = f};
}

// At the events only z_1, z_2, z_3 jump, to zero; the zero dynamics see z_1 = O(h^2) in the steps around
// them. The constants of the error (84.85 h^2 at h = 1e-1 from an independent program with dense steps) move
// a little with where in their steps the events fall.
TEST(Theta, SecondOrderAcrossTheEventsOf65) {
  for (const char* form : {"box-on-z", "primal-dual"}) {
    double previous = 0.0;
    for (const PetscInt steps : {100, 400, 1600}) {
      const Record run = simulate(dense65(), {0.0, 10.0, steps}, {.form = form, .theta = 0.5});
      ASSERT_TRUE(run.certified);
      const double error = distance(run.x.back(), exact65_at_10);
      std::printf("%s, %5d steps: error %.3e\n", form, static_cast<int>(steps), error);
      EXPECT_LE(error, 1.1 * 0.00849 * std::pow(100.0 / static_cast<double>(steps), 2));
      if (previous > 0.0) {
        EXPECT_NEAR(std::log(previous / error) / std::log(4.0), 2.0, 0.15);
      }
      previous = error;
    }
  }
}

// theta in (1/2, 1) is of order 1 with the constant of (theta - 1/2): 2 (theta - 1/2) of what theta = 1 has.
TEST(Theta, ErrorIsProportionalToTheDistanceFromOneHalf) {
  const ScopedOption petsc_lu("-pc_factor_mat_solver_type", "petsc");  // a fifth of the time at 5 x 5
  const TimeGrid grid{0.0, 10.0, 10000};
  const auto error = [&](double theta) {
    return distance(simulate(dense65(), grid, {.theta = theta}).x.back(), exact65_at_10);
  };
  const double implicit = error(1.0);
  for (const double theta : {0.75, 0.6})
    EXPECT_NEAR(error(theta) / implicit, 2.0 * (theta - 0.5), 0.01) << theta;  // h^2 over h
}

// AB (32)-(33) with theta, under forcing that the outputs see with its derivatives:
// z_{i,k+1} - z_{i,k} = h z_{i+1,theta} + mu_i for i < r, exactly; on level r and in the zero dynamics
// x_{k+1} - x_k = h (A x + f)_theta.
TEST(Theta, StepIsThatOfTheMeasureEquation) {
  std::vector<Signal> f(5);
  f[0] = {0.02, 0.1, 0.3, 0.4};
  f[1] = {0.0, 0.05, 0.2, 0.1};
  f[2] = {-0.2, 0.5, 0.25, 0.0};
  f[4] = {0.1, 0.3, 0.1, 1.0};
  const TimeGrid grid{0.0, 10.0, 500};
  const double h = grid.h();
  for (const double theta : {0.5, 0.8}) {
    for (const char* form : {"box-on-z", "primal-dual"}) {
      SCOPED_TRACE(std::string(form) + " " + std::to_string(theta));
      const Record run = simulate(dense65(f), grid, {.form = form, .theta = theta});
      ASSERT_TRUE(run.certified);
      double worst_level = 0.0;
      double worst_state = 0.0;
      std::size_t pushed = 0;
      for (std::size_t k = 1; k < run.steps; ++k) {
        for (std::size_t i = 1; i <= 2; ++i) {
          const double rate =
              theta * run.z[run.at(k, 0, i + 1)] + (1.0 - theta) * run.z[run.at(k - 1, 0, i + 1)];
          worst_level = std::max(worst_level, std::abs(run.z[run.at(k, 0, i)] - run.z[run.at(k - 1, 0, i)] -
                                                       h * rate - run.mu[run.at(k, 0, i)]));
        }
        pushed += run.mu[run.at(k, 0, 3)] > 0.0 ? 1 : 0;
        Eigen::VectorXd force(5);
        const double old = grid.time(static_cast<PetscInt>(k));
        const double now = grid.time(static_cast<PetscInt>(k) + 1);
        for (Eigen::Index i = 0; i < 5; ++i) {
          const Signal& signal = f[static_cast<std::size_t>(i)];
          force(i) = theta * signal.value(now) + (1.0 - theta) * signal.value(old);
        }
        const Eigen::Map<const Eigen::VectorXd> x(run.x[k].data(), 5);
        const Eigen::Map<const Eigen::VectorXd> before(run.x[k - 1].data(), 5);
        const Eigen::VectorXd off = x - before - h * (a65 * (theta * x + (1.0 - theta) * before) + force);
        // Measures of levels 1 and 2, and what completes the forcing there, move x_1 and x_2 alone.
        for (const double residue : {off(2) - run.mu[run.at(k, 0, 3)], off(3), off(4)})
          worst_state = std::max(worst_state, std::abs(residue));
      }
      EXPECT_GT(pushed, 50U);
      EXPECT_LT(pushed, run.steps - 50);
      // Rounding of values of size 3.
      EXPECT_LE(worst_level, 1e-13);
      EXPECT_LE(worst_state, 1e-13);
    }
  }
}

// Free flight under a sine: (x, sin, cos) is an autonomous linear system.
TEST(Theta, SecondOrderInForcedFlight) {
  const double omega = 2.0 * M_PI * 0.3;
  const std::vector<Signal> f = {{}, {0.0, 0.2, 0.3, 0.0}, {5.0, 1.0, 0.3, 0.0}, {}, {}};
  Eigen::MatrixXd extended = Eigen::MatrixXd::Zero(8, 8);
  extended.topLeftCorner<5, 5>() = a65;
  extended(1, 5) = 0.2;
  extended(2, 5) = 1.0;
  extended(2, 7) = 5.0;
  extended(5, 6) = omega;
  extended(6, 5) = -omega;
  Eigen::VectorXd start = Eigen::VectorXd::Zero(8);
  start(0) = start(6) = start(7) = 1.0;
  const Eigen::VectorXd exact = (exponential(2.0 * extended) * start).head(5);
  for (const char* form : {"box-on-z", "primal-dual"}) {
    double previous = 0.0;
    for (const PetscInt steps : {50, 100, 200}) {
      const Record run = simulate(dense65(f), {0.0, 2.0, steps}, {.form = form, .theta = 0.5});
      ASSERT_TRUE(run.certified);
      EXPECT_EQ(run.events.size(), 0U);
      const double error = distance(run.x.back(), {exact.data(), exact.data() + 5});
      if (previous > 0.0) {
        EXPECT_NEAR(std::log2(previous / error), 2.0, 0.05);  // h^4 over h^2
      }
      previous = error;
    }
  }
}

TEST(Theta, OutsideOfItsRangeIsRefused) {
  for (const double theta : {0.0, -1.0, 1.1, std::nan("")})
    EXPECT_THROW(simulate(dense65(), {0.0, 1.0, 10}, {.theta = theta}), Error) << theta;
  EXPECT_THROW(simulate(dense65(), {0.0, 1.0, 10}, {.scheme = Scheme::zd_euler, .theta = 0.5}), Error);
}

}  // namespace
}  // namespace sweepvi::test
