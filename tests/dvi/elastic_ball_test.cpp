// ranks: 1
// labels: long
// timeout: 600
// A million steps of the elastic ball: what rounding does to an energy that is kept in exact arithmetic.
#include <gtest/gtest.h>

#include "dvi/systems.hpp"
#include "sweepvi/lagrangian.hpp"

namespace sweepvi::test {
namespace {

// 6.2e-12 is what doubles give (h = 5e-3 and g = 10 are no dyadic numbers), 1e-10 what is asked for.
TEST(ElasticBall, DriftsByRoundingAloneInAMillionSteps) {
  const ScopedOption factorization("-pc_factor_mat_solver_type", "petsc");  // of a 1 x 1 matrix
  const LagrangianSystem system = LagrangianSystem::dense(
      PETSC_COMM_WORLD,
      {.M = {1.0}, .K = {0.0}, .H = {1.0}, .q0 = {1.0}, .v0 = {0.0}, .f = {Signal{-10.0}}, .e = {1.0}});
  const TimeGrid grid{0.0, 5000.0, 1000000};
  const auto dvi = make_moreau_jean(system, {.theta = 0.5}, grid);
  double drift = 0.0;
  PetscInt impacts = 0;
  TimeMarch march(*dvi, grid);
  march.observe([&](const Step& step, const StepReport&) {
    for (const StepEvent& event : dvi->events())
      impacts += event.impact ? 1 : 0;
    if (step.number % 100 != 0) return;
    const Energy energy = dvi->energy();
    drift = std::max(drift, std::abs(energy.kinetic + energy.potential - 10.0));
  });
  EXPECT_TRUE(march.run().certified);
  EXPECT_EQ(march.steps_taken(), grid.steps);
  EXPECT_LE(drift, 1e-10);
  EXPECT_EQ(impacts, 5587);  // tests/reference/moreau_ball.json, e1 A
}

}  // namespace
}  // namespace sweepvi::test
