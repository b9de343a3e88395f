// The step solver on box VIs whose solutions are known: both types, ladder, scales from 1e-200 to 1e200.
#include <gtest/gtest.h>

#include <random>

#include "dvi/affine_vi.hpp"
#include "dvi/systems.hpp"
#include "petsc/event_counts.hpp"
#include "petsc/sparse.hpp"

namespace sweepvi::test {
namespace {

/// F(u) = M u + q on [lower, upper], M row-major and known to every rank.
std::unique_ptr<AffineVi> problem(const std::vector<double>& m, const std::vector<double>& q,
                                  double lower = 0.0, double upper = PETSC_INFINITY) {
  const auto n = static_cast<PetscInt>(q.size());
  PetscInt local = PETSC_DECIDE;
  PetscInt total = n;
  check(PetscSplitOwnership(PETSC_COMM_WORLD, &local, &total));
  Vector right = make_vector(PETSC_COMM_WORLD, local);
  Vector l = duplicate(right.get());
  Vector b = duplicate(right.get());
  Vector u0 = duplicate(right.get());
  PetscInt first = 0;
  check(VecGetOwnershipRange(right.get(), &first, nullptr));
  RowBuilder rows;
  {
    const WriteArray values(right.get());
    for (PetscInt i = 0; i < local; ++i) {
      values[i] = q[static_cast<std::size_t>(first + i)];
      rows.add(first + i, 0.0);
      for (PetscInt j = 0; j < n; ++j) {
        const double value = m[static_cast<std::size_t>((first + i) * n + j)];
        if (value != 0.0) rows.add(j, value);
      }
      rows.end_row();
    }
  }
  check(VecSet(l.get(), lower));
  check(VecSet(b.get(), upper));
  return std::make_unique<AffineVi>(rows.finish(PETSC_COMM_WORLD, local), std::move(right), std::move(l),
                                    std::move(b), std::move(u0));
}

struct Solved {
  StepReport report;
  std::vector<double> u;
};

Solved solve(AffineVi& vi, const char* type, const char* predictor) {
  const ScopedOption snes_type("-snes_type", type);
  const ScopedOption guess("-sweepvi_predictor", predictor);
  NonlinearSolver snes;
  check(SNESCreate(PETSC_COMM_WORLD, snes.put()));
  StepSolver solver(snes.get(), vi);
  Solved solved;
  solved.report = solver.solve({1, 0.0, 0.0, 0.0});
  solved.u = everywhere(solver.solution());
  return solved;
}

void expect_solution(const std::vector<double>& m, const std::vector<double>& q,
                     const std::vector<double>& expected, double lower = 0.0, double upper = PETSC_INFINITY) {
  for (const char* type : {SNESVINEWTONRSLS, SNESVINEWTONSSLS}) {
    for (const char* predictor : {"none", "active-set"}) {
      const auto vi = problem(m, q, lower, upper);
      const Solved solved = solve(*vi, type, predictor);
      EXPECT_TRUE(solved.report.certified)
          << type << ", predictor " << predictor << ": " << solved.report.residual;
      // Certified rows are good to 1e-10 of their terms; these matrices are well conditioned.
      for (std::size_t i = 0; i < expected.size(); ++i)
        EXPECT_NEAR(solved.u[i], expected[i], 1e-9 * (1e-300 + std::abs(expected[i]) + std::abs(q[i])))
            << type << ", predictor " << predictor << ", component " << i;
    }
  }
}

TEST(StepSolver, InteriorBoundAndMixed) {
  expect_solution({2, 1, 1, 2}, {-3, -3}, {1, 1});
  expect_solution({2, 1, 1, 2}, {1, -2}, {0, 1});
  expect_solution({2, 1, 1, 2}, {1, 2}, {0, 0});
}

TEST(StepSolver, TwoSidedBox) {
  expect_solution({2, 0, 0, 2}, {-8, 8}, {1, -1}, -1.0, 1.0);
}

// z = mu = 0: the state of persistent contact.
TEST(StepSolver, DegenerateSolution) {
  expect_solution({1, 0.5, -0.5, 1}, {0, 0}, {0, 0});
}

TEST(StepSolver, MurtysExampleForPivoting) {
  // Lower triangular with 2 below the diagonal, q = -1: pivoting rules visit 2^n bases; the solution is e_1.
  constexpr std::size_t n = 12;
  std::vector<double> m(n * n, 0.0);
  for (std::size_t i = 0; i < n; ++i) {
    m[i * n + i] = 1.0;
    for (std::size_t j = 0; j < i; ++j)
      m[i * n + j] = 2.0;
  }
  std::vector<double> expected(n, 0.0);
  expected[0] = 1.0;
  expect_solution(m, std::vector<double>(n, -1.0), expected);
}

// The certificate is relative to each row's terms, so the scale of the whole problem must not matter.
TEST(StepSolver, AnyScale) {
  for (const double scale : {1e-200, 1e-30, 1e-9, 1e9, 1e200})
    expect_solution({2, 1, 1, 2}, {scale, -2 * scale}, {0, scale});
}

TEST(StepSolver, AStepWithoutSolutionIsAResult) {
  for (const char* type : {SNESVINEWTONRSLS, SNESVINEWTONSSLS}) {
    const auto vi = problem({-1}, {-1});  // u >= 0, -u - 1 >= 0
    const Solved solved = solve(*vi, type, "active-set");
    EXPECT_FALSE(solved.report.certified);
    EXPECT_GT(solved.report.residual, 1e-3);
    EXPECT_FALSE(solved.report.reason.empty());
  }
}

// A box VI of a bounded box has a solution whatever its matrix is. Newton's method does not always find one;
// Lemke's does, so the ladder may not fail.
TEST(StepSolver, TheLadderEndsInAPivotingMethod) {
  int ranks = 1;
  MPI_Comm_size(PETSC_COMM_WORLD, &ranks);
  const int problems = ranks == 1 ? 40 : 8;  // tiny ones: more ranks have nothing to do but wait
  constexpr std::size_t n = 8;
  std::mt19937 engine(7);  // the same on all ranks
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  int pivoting = 0;
  for (int trial = 0; trial < problems; ++trial) {
    std::vector<double> m(n * n);
    std::vector<double> q(n);
    for (double& value : m)
      value = uniform(engine);
    for (double& value : q)
      value = uniform(engine);
    const auto vi = problem(m, q, -1.0, 1.0);
    const Solved solved = solve(*vi, SNESVINEWTONRSLS, "active-set");
    EXPECT_TRUE(solved.report.certified) << "problem " << trial << ": " << solved.report.reason;
    if (solved.report.rung >= Rung::pivoting) ++pivoting;
  }
  EXPECT_GT(pivoting, 0);         // or this test shows nothing
  EXPECT_LT(pivoting, problems);  // the last resort
}

// Outer linearisation of an affine problem is that problem: one step, from anywhere.
TEST(StepSolver, OuterLinearisationSolvesAnAffineProblemInOneStep) {
  const ScopedOption outer("-sweepvi_linearisation", "outer");
  const auto vi = problem({2, 1, -1, 1, 2, 0, 1, 0, 1}, {-3, 1, 4}, -1.0, 1.0);
  const Solved solved = solve(*vi, SNESVINEWTONRSLS, "none");
  EXPECT_TRUE(solved.report.certified);
  EXPECT_EQ(solved.report.iterations, 1);
  EXPECT_EQ(solved.report.attempts, 1);
  EXPECT_EQ(solved.report.reason, "OUTER_CONVERGED");
  const std::vector<double> expected = {1, -1, -1};  // F = (-1, 0, 4), by hand
  EXPECT_EQ(solved.u, expected);
}

TEST(StepSolver, OuterLinearisationRefusesWhatItCannotDo) {
  const ScopedOption outer("-sweepvi_linearisation", "outer");
  std::vector<double> identity(1001 * 1001, 0.0);
  for (std::size_t i = 0; i < 1001; ++i)
    identity[1002 * i] = 1.0;
  const auto vi = problem(identity, std::vector<double>(1001, -1.0));
  EXPECT_THROW(solve(*vi, SNESVINEWTONRSLS, "none"), Error);
  const auto small = problem({1}, {-1});
  const ScopedOption wrong("-sweepvi_linearisation", "outward");
  EXPECT_THROW(solve(*small, SNESVINEWTONRSLS, "none"), Error);
}

TEST(StepSolver, RefusesASolverThatIgnoresBounds) {
  const auto vi = problem({1}, {-1});
  EXPECT_THROW(solve(*vi, SNESNEWTONLS, "none"), Error);
}

std::int64_t factorizations_of_example65(const char* predictor) {
  const ScopedOption guess("-sweepvi_predictor", predictor);
  const LinearSystem system = example65(PETSC_COMM_WORLD);
  RelativeDegree degree = analyse_relative_degree(system);
  const auto dvi = make_linear_dvi(system, degree, Scheme::homsp, Form::box_on_z, {0.0, 10.0, 1000});
  TimeMarch march(*dvi, {0.0, 10.0, 1000});
  const std::int64_t before = event_count("MatLUFactorNum");
  EXPECT_TRUE(march.run().certified);
  return event_count("MatLUFactorNum") - before;
}

// A persistent contact costs one factorization for the whole run of its active set; a small system none.
TEST(StepSolver, KeepsTheFactorizationWhileTheActiveSetLasts) {
  int size = 1;
  MPI_Comm_size(PETSC_COMM_WORLD, &size);
  if (size > 1) return;  // states stand on several ranks without distribute()
  const std::int64_t count = factorizations_of_example65("active-set");
  // Free flight, impact, contact, lift-off, free flight: a handful of active sets in 1000 steps.
  EXPECT_LE(count, 12);
  EXPECT_GE(count, 2);
  EXPECT_EQ(factorizations_of_example65("automatic"), 0);
}

}  // namespace
}  // namespace sweepvi::test
