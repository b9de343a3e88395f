// AB (65) against the exact solution at the step sizes of order65.json, for both SNESVI types.
#pragma once

#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>

#include "dvi/systems.hpp"

namespace sweepvi::test {

struct Outcome {
  std::vector<double> end;
  double first_contact = 0.0;  // end of the first step with mu_3 > 0
  double lift_off = 0.0;       // end of the first later step with mu_3 = 0
};

inline Outcome march(PetscInt steps, const char* snes_type, Form form, const char* predictor = "none") {
  const ScopedOption type("-snes_type", snes_type);
  const ScopedOption guess("-sweepvi_predictor", predictor);  // none: SNESVI itself does the work
  // 300 000 steps: MUMPS spends a third of a millisecond on each 5 x 5 matrix, PETSc's LU a fifth of that.
  // (On the primal-dual matrix PETSc's orderings run into zero pivots.)
  const bool small_and_many = steps > 1000 && form == Form::box_on_z;
  const ScopedOption factorization("-pc_factor_mat_solver_type", small_and_many ? "petsc" : "mumps");
  const LinearSystem system = example65(PETSC_COMM_WORLD);
  const RelativeDegree degree = analyse_relative_degree(system);
  const auto dvi = make_linear_dvi(system, degree, Scheme::homsp, form, {0.0, 10.0, steps});
  TimeMarch time_march(*dvi, {0.0, 10.0, steps});
  Outcome outcome;
  time_march.observe([&](const Step& step, const StepReport& report) {
    EXPECT_LE(report.residual, 1e-10);
    const bool pushed = dvi->mu()[2] > 0.0;
    if (pushed && outcome.first_contact == 0.0) outcome.first_contact = step.t_new;
    if (!pushed && outcome.first_contact > 0.0 && outcome.lift_off == 0.0) outcome.lift_off = step.t_new;
  });
  EXPECT_TRUE(time_march.run().certified);
  EXPECT_EQ(time_march.steps_taken(), steps);
  outcome.end = everywhere(dvi->x());
  return outcome;
}

inline nlohmann::json reference() {
  std::ifstream file(std::string(std::getenv("SWEEPVI_SOURCE")) + "/tests/reference/order65.json");
  return nlohmann::json::parse(file);
}

/// Box on z against the reference at all its numbers of steps between these two.
inline void expect_the_papers_scheme(PetscInt fewest, PetscInt most) {
  const double impact = 4.345147830371428265;
  const double lift_off = 6.199615848871525286;
  double previous = 0.0;
  double previous_h = 0.0;
  for (const auto& row : reference()) {
    const PetscInt steps = row["N"];
    if (steps < fewest || steps > most) continue;
    const double h = 10.0 / static_cast<double>(steps);
    const Outcome reduced = march(steps, SNESVINEWTONRSLS, Form::box_on_z);
    const Outcome semismooth = march(steps, SNESVINEWTONSSLS, Form::box_on_z);
    const double error = distance(reduced.end, exact65_at_10);
    const double expected = row["final_2"];
    std::printf(
        "h = %.6f  error %.6e  expected %.6e  ratio-1 %.1e  types differ by %.1e  impact %.6f lift-off "
        "%.6f\n",
        h, error, expected, error / expected - 1.0, distance(reduced.end, semismooth.end),
        reduced.first_contact, reduced.lift_off);
    // The same scheme, computed independently: only rounding, but 2 % is what is promised.
    EXPECT_NEAR(error, expected, 0.02 * expected) << h;
    // Each step is solved to 1e-14 of its terms; rounding of 1e5 such steps stays below 1e-9.
    EXPECT_LE(distance(reduced.end, semismooth.end), 1e-9) << h;
    if (steps <= 10000) {
      const Outcome predicted = march(steps, SNESVINEWTONRSLS, Form::box_on_z, "active-set");
      EXPECT_LE(distance(reduced.end, predicted.end), 1e-10) << h;
    }
    EXPECT_NEAR(reduced.first_contact, impact, h);
    EXPECT_NEAR(reduced.lift_off, lift_off, h);
    if (previous > 0.0 && h < 0.02) {
      // Order one; the error's own O(h^2) part is a few per cent at h = 1e-2.
      EXPECT_NEAR(std::log(previous / error) / std::log(previous_h / h), 1.0, 0.03) << h;
    }
    previous = error;
    previous_h = h;
  }
}

inline void expect_the_same_primal_dual(const std::vector<PetscInt>& numbers) {
  for (const PetscInt steps : numbers) {
    const Outcome box = march(steps, SNESVINEWTONRSLS, Form::box_on_z);
    for (const char* type : {SNESVINEWTONRSLS, SNESVINEWTONSSLS}) {
      const Outcome primal_dual = march(steps, type, Form::primal_dual);
      EXPECT_LE(distance(box.end, primal_dual.end), 1e-10) << steps << " " << type;
      EXPECT_EQ(box.first_contact, primal_dual.first_contact);
      EXPECT_EQ(box.lift_off, primal_dual.lift_off);
    }
  }
}

}  // namespace sweepvi::test
