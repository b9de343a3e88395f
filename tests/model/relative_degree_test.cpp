// Relative degrees, Markov matrices, outputs and directions of systems whose answers are known.
#include <gtest/gtest.h>

#include <limits>
#include <map>
#include <random>

#include "dvi/systems.hpp"
#include "petsc/sparse.hpp"
#include "sweepvi/partition.hpp"

namespace sweepvi::test {
namespace {

/// Runs `work`, which must fail as bad input on every rank with a message that holds all `fragments`.
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

/// A chain of n integrators from lambda to w: relative degree n.
LinearSystem integrators(PetscInt n, double gain = 1.0) {
  std::vector<double> a(static_cast<std::size_t>(n * n), 0.0);
  for (PetscInt i = 0; i + 1 < n; ++i)
    a[static_cast<std::size_t>(i * n + i + 1)] = 1.0;
  std::vector<double> b(static_cast<std::size_t>(n), 0.0);
  std::vector<double> c(static_cast<std::size_t>(n), 0.0);
  b.back() = gain;
  c.front() = 1.0;
  return LinearSystem::dense(
      PETSC_COMM_WORLD,
      {.A = a, .B = b, .C = c, .x0 = std::vector<double>(static_cast<std::size_t>(n), 1.0)});
}

std::map<PetscInt, int> degrees(const LinearSystem& system, const RelativeDegree& degree) {
  std::map<PetscInt, int> mine;
  for (std::size_t a = 0; a < degree.degree.size(); ++a)
    mine[system.constraint_order[a]] = degree.degree[a];
  return mine;
}

TEST(RelativeDegree, OfIntegratorChains) {
  for (const PetscInt n : {1, 2, 3, 5, 8}) {
    const LinearSystem system = integrators(n, 2.5);
    const RelativeDegree degree = analyse_relative_degree(system);
    EXPECT_EQ(degree.lowest, n);
    EXPECT_EQ(degree.highest, n);
    EXPECT_EQ(degree.outputs, n);
    for (const double own : degree.markov_diagonal)
      EXPECT_EQ(own, 2.5);
    EXPECT_TRUE(degree.outputs_are_states);
    EXPECT_EQ(zero_dynamics(system, degree).size, 0);
  }
}

TEST(RelativeDegree, OutputsAndDirectionsAreBiorthogonal) {
  // Two masses behind flexible joints, coupled: r = 4 each, directions that are not unit vectors.
  // x = (q1, p1, q2, p2, velocities); joint 10, coupling 1, damping in the joints so that no Markov parameter
  // is zero.
  std::vector<double> a(64, 0.0);
  const auto at = [&](int i, int j) -> double& { return a[static_cast<std::size_t>(8 * i + j)]; };
  for (int i = 0; i < 4; ++i)
    at(i, 4 + i) = 1.0;
  for (const int i : {0, 2}) {
    at(4 + i, i) = -12.0, at(4 + i, i + 1) = 10.0, at(4 + i, 2 - i) = 1.0, at(4 + i, 4 + i) = -0.3;
    at(5 + i, i) = 10.0, at(5 + i, i + 1) = -10.0, at(5 + i, 5 + i) = -0.2;
  }
  std::vector<double> b(16, 0.0), c(16, 0.0);
  b[5 * 2 + 0] = b[7 * 2 + 1] = 1.0;
  c[0] = c[8 + 2] = 1.0;
  const LinearSystem system =
      LinearSystem::dense(PETSC_COMM_WORLD, {.A = a, .B = b, .C = c, .x0 = std::vector<double>(8, 0.0)});
  const RelativeDegree degree = analyse_relative_degree(system);
  EXPECT_EQ(degree.lowest, 4);
  EXPECT_EQ(degree.highest, 4);
  EXPECT_FALSE(degree.outputs_are_states);
  const Matrix product = multiply(degree.Z.get(), transpose(degree.directions.get()).get());
  const PetscInt first = row_range(product.get()).first;
  for (std::size_t k = 0; k < degree.degree.size(); ++k) {
    for (PetscInt i = 0; i < 4; ++i) {
      const PetscInt row = first + degree.first_level[k] + i;
      for (const auto& [column, value] : get_row(product.get(), row)) {
        if (column / 4 != row / 4) continue;  // own outputs only
        // z_{a,j}(d_{a,i}) = delta_ij; entries are sums of at most 8 products of size 100.
        EXPECT_NEAR(value, column == row ? 1.0 : 0.0, 1e-12) << row << "," << column;
      }
    }
  }
}

TEST(RelativeDegree, DifferentDegreesInOneScene) {
  // w_0 = x_0 with x_0' = lambda_0 (r = 1), w_1 = x_1, x_1'' = lambda_1 (r = 2).
  const LinearSystem system = LinearSystem::dense(
      PETSC_COMM_WORLD,
      {.A = {0, 0, 0, 0, 0, 1, 0, 0, 0}, .B = {1, 0, 0, 0, 0, 1}, .C = {1, 0, 0, 0, 1, 0}, .x0 = {1, 1, 1}});
  const RelativeDegree degree = analyse_relative_degree(system);
  for (const auto& [constraint, r] : degrees(system, degree))
    EXPECT_EQ(r, constraint + 1);
  EXPECT_EQ(degree.lowest, 1);
  EXPECT_EQ(degree.highest, 2);
}

TEST(RelativeDegree, CancellationIsNotCoupling) {
  // C B = 0.1 + 0.2 - 0.3, which is 5.6e-17 in doubles: r = 2, not 1.
  const LinearSystem system = LinearSystem::dense(
      PETSC_COMM_WORLD,
      {.A = {0, 1, 0, 0, 0, 0, 0, 0, 0}, .B = {0.1, 0.2, 0.3}, .C = {1, 1, -1}, .x0 = {1, 1, 1}});
  const RelativeDegree degree = analyse_relative_degree(system);
  EXPECT_EQ(degree.lowest, 2);
  EXPECT_GT(degree.smallest_kept, 1e-2);
  EXPECT_LT(degree.largest_dropped, 1e-15);
}

/// An integrator chain of length r with two states beside it, in coordinates T x, T and its inverse integer
/// matrices (products of elementary ones): C A^(r-1) B = 1 and C A^k B = 0 for k < r - 1, exactly, while the
/// terms of these sums grow without limit. Every entry is divided by `unit`.
LinearSystem hidden_integrators(PetscInt r, int mixings, unsigned seed, double unit = 1.0) {
  const auto n = static_cast<std::size_t>(r) + 2;
  std::vector<double> a(n * n, 0.0), b(n, 0.0), c(n, 0.0);
  const auto chain = static_cast<std::size_t>(r);
  for (std::size_t i = 0; i + 1 < chain; ++i)
    a[i * n + i + 1] = 1.0;
  a[(chain - 1) * n + chain] = 1.0;  // the zero dynamics act on the last state, and the first on them
  a[chain * n + chain + 1] = 1.0;
  a[(chain + 1) * n + chain] = -1.0;
  a[(chain + 1) * n] = 1.0;
  b[chain - 1] = c[0] = 1.0;
  std::mt19937 random(seed);
  for (int k = 0; k < mixings; ++k) {
    const std::size_t i = random() % n;
    const std::size_t j = (i + 1 + random() % (n - 1)) % n;
    const double factor = random() % 2 == 0 ? 1.0 : -1.0;
    for (std::size_t l = 0; l < n; ++l)
      a[i * n + l] += factor * a[j * n + l];  // E A
    for (std::size_t l = 0; l < n; ++l)
      a[l * n + j] -= factor * a[l * n + i];  // A E^-1
    b[i] += factor * b[j];
    c[j] -= factor * c[i];
  }
  for (auto* data : {&a, &b, &c})
    for (double& value : *data)
      value /= unit;
  return LinearSystem::dense(PETSC_COMM_WORLD, {.A = a, .B = b, .C = c, .x0 = std::vector<double>(n, 1.0)});
}

TEST(RelativeDegree, OfIntegersIsExactHoweverFarTheyCancel) {
  double smallest = 1.0;
  for (const PetscInt r : {1, 2, 3, 4, 5, 6}) {
    for (unsigned seed = 1; seed <= 5; ++seed) {
      const LinearSystem system = hidden_integrators(r, 24, seed);
      const RelativeDegree degree = analyse_relative_degree(system);
      EXPECT_EQ(degree.lowest, r) << "seed " << seed;
      EXPECT_EQ(degree.smallest_margin, std::numeric_limits<double>::infinity());
      EXPECT_EQ(degree.largest_dropped, 0.0);
      for (const double own : degree.markov_diagonal)
        EXPECT_EQ(own, 1.0);
      smallest = std::min(smallest, degree.smallest_kept);
    }
  }
  EXPECT_LT(smallest, 1e-10);  // else the cases would be tame
}

TEST(RelativeDegree, OfDecimalsIsDecidedByTheirRounding) {
  // The same in tenths: no longer exact, C A^(r-1) B = 10^-(r+1), zero within half an ulp of each datum
  // below.
  for (const PetscInt r : {2, 3, 4}) {
    const LinearSystem system = hidden_integrators(r, 16, 3, 10.0);
    const RelativeDegree degree = analyse_relative_degree(system);
    EXPECT_EQ(degree.lowest, r);
    EXPECT_GT(degree.smallest_margin, 1.0);
    EXPECT_LT(degree.smallest_margin, 1e17);
  }
}

/// w = x_1 + x_2 with inputs `first` and -1, as computed numbers: C B = first - 1; the degree is 2 where that
/// is zero, C A B = gain.
LinearSystem nearly_cancelling(double first, double gain) {
  return LinearSystem::dense(
      PETSC_COMM_WORLD,
      {.A = {0, 0, gain, 0, 0, 0, 0, 0, 0}, .B = {first, -1, 1}, .C = {1, 1, 0}, .x0 = {1, 1, 1}});
}

TEST(RelativeDegree, RoundingOfComputedDataIsNotCoupling) {
  // 1 + 3e-13 has the look of a computed number: 1300 ulps may come from what it was computed from.
  const double computed = 1.0 + 1351.0 * std::numeric_limits<double>::epsilon();
  const RelativeDegree degree = analyse_relative_degree(nearly_cancelling(computed, 1.0));
  EXPECT_EQ(degree.lowest, 2);
  EXPECT_EQ(degree.doubtful, 1);
  EXPECT_GT(degree.largest_dropped, 1e-13);
  // 1 + 2^-30 is exact, and so is the coupling of 2^-30 (of 2: the ratio is below 1e-9, above 1e-10);
  // 1 + 2^-32 counts as computed, but nothing is taken for rounding above 1e-10.
  EXPECT_EQ(analyse_relative_degree(nearly_cancelling(1.0 + 0x1p-30, 1.0)).lowest, 1);
  // A written decimal is known to half an ulp.
  EXPECT_EQ(analyse_relative_degree(nearly_cancelling(1.00000001, 1.0)).lowest, 1);
}

TEST(RelativeDegree, WhatCannotBeDecidedIsAskedFor) {
  const double computed = 1.0 + 1351.0 * std::numeric_limits<double>::epsilon();
  // Nothing follows the doubtful coupling.
  const auto alone = [&] { return nearly_cancelling(computed, 0.0); };
  expect_bad_input([&] { analyse_relative_degree(alone()); },
                   {"cannot be decided", "error bound", "relative_degree = [1]"});
  LinearSystem system = alone();
  system.stated_degree = {1};
  EXPECT_EQ(analyse_relative_degree(system).lowest, 1);
  // The other one, at degree 2, is not there, whatever is stated.
  system.stated_degree = {2};
  expect_bad_input([&] { analyse_relative_degree(system); }, {"stated to have degree 2", "exactly 0"});
  // A clear coupling at 1 is not argued away.
  LinearSystem clear = integrators(1);
  clear.stated_degree = {1};
  EXPECT_EQ(analyse_relative_degree(clear).lowest, 1);
  LinearSystem double_integrator = integrators(2);
  double_integrator.stated_degree = {1};
  expect_bad_input([&] { analyse_relative_degree(double_integrator); },
                   {"stated to have degree 1", "exactly 0"});
}

TEST(RelativeDegree, OneDegreeIsStatedForEachConstraintOrForAll) {
  const double computed = 1.0 + 1351.0 * std::numeric_limits<double>::epsilon();
  // Two of them side by side.
  const auto pair = [&] {
    return LinearSystem::dense(PETSC_COMM_WORLD, {.A = {0, 0, 1, 0, 0, 0,  //
                                                        0, 0, 0, 0, 0, 0,  //
                                                        0, 0, 0, 0, 0, 0,  //
                                                        0, 0, 0, 0, 0, 1,  //
                                                        0, 0, 0, 0, 0, 0,  //
                                                        0, 0, 0, 0, 0, 0},
                                                  .B = {computed, 0, -1, 0, 1, 0, 0, computed, 0, -1, 0, 1},
                                                  .C = {1, 1, 0, 0, 0, 0, 0, 0, 0, 1, 1, 0},
                                                  .x0 = {1, 1, 1, 1, 1, 1}});
  };
  LinearSystem system = pair();
  system.stated_degree = {1, 2};
  const RelativeDegree degree = analyse_relative_degree(system);
  for (const auto& [constraint, r] : degrees(system, degree))
    EXPECT_EQ(r, constraint + 1);
  EXPECT_EQ(degree.doubtful, 0);  // nothing is left to doubt
  system.stated_degree = {1};
  EXPECT_EQ(analyse_relative_degree(system).highest, 1);
}

TEST(RelativeDegree, NamesAConstraintThatLambdaNeverReaches) {
  // Constraint 1 reads a state that no input reaches.
  const LinearSystem system = LinearSystem::dense(
      PETSC_COMM_WORLD,
      {.A = {0, 1, 0, 0, 0, 0, 0, 0, -1}, .B = {0, 0, 1, 1, 0, 0}, .C = {1, 0, 0, 0, 0, 1}, .x0 = {1, 1, 1}});
  expect_bad_input([&] { analyse_relative_degree(system); }, {"constraint 1", "no relative degree"});
}

TEST(Markov, SingularMatrixNamesTheDependentConstraints) {
  // A mass between two walls: w_0 = q, w_1 = 1 - q.
  const LinearSystem system = LinearSystem::dense(
      PETSC_COMM_WORLD,
      {.A = {0, 1, 0, 0}, .B = {0, 0, 1, -1}, .C = {1, 0, -1, 0}, .x0 = {0.5, 0}, .w0 = {0, 1}});
  const RelativeDegree degree = analyse_relative_degree(system);
  expect_bad_input([&] { check_markov_matrix(system, degree); }, {"singular", "0, 1"});
}

TEST(Markov, NegativeParameterIsRefused) {
  const LinearSystem system = integrators(3, -1.0);
  const RelativeDegree degree = analyse_relative_degree(system);
  expect_bad_input([&] { check_markov_matrix(system, degree); }, {"negative", "constraint 0"});
}

LinearSystem with_markov(double m00, double m01, double m10, double m11) {
  // Two double integrators with inputs mixed by M.
  return LinearSystem::dense(PETSC_COMM_WORLD, {.A = {0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0},
                                                .B = {0, 0, m00, m01, 0, 0, m10, m11},
                                                .C = {1, 0, 0, 0, 0, 0, 1, 0},
                                                .x0 = {1, 0, 1, 0}});
}

TEST(Markov, SolvabilityIsToldApart) {
  using Solvability = MarkovReport::Solvability;
  const auto report = [](const LinearSystem& system) {
    return check_markov_matrix(system, analyse_relative_degree(system));
  };
  const MarkovReport definite = report(with_markov(2, -1, -1, 2));
  EXPECT_EQ(definite.solvability, Solvability::positive_definite);
  EXPECT_NEAR(definite.condition, 3.0, 1e-14);  // eigenvalues 1 and 3
  EXPECT_EQ(definite.largest_block, 2);
  EXPECT_FALSE(definite.diagonal);
  EXPECT_EQ(report(with_markov(1, 3, 0, 1)).solvability, Solvability::p_matrix);  // symmetric part indefinite
  const LinearSystem not_p = with_markov(1, 3, 3, 1);
  expect_bad_input([&] { check_markov_matrix(not_p, analyse_relative_degree(not_p)); },
                   {"not a P-matrix", "0, 1"});
}

TEST(ZeroDynamicsOf, Example65IsAnOscillator) {
  const LinearSystem system = example65(PETSC_COMM_WORLD);
  const RelativeDegree degree = analyse_relative_degree(system);
  const ZeroDynamics zero = zero_dynamics(system, degree);
  EXPECT_EQ(zero.size, 2);
  EXPECT_NEAR(zero.largest_real_part, 0.0, 1e-14);  // xi1' = xi2, xi2' = -xi1
}

TEST(ZeroDynamicsOf, AnUnstableZeroIsSeen) {
  // w = x_1, x_1' = x_0 + lambda, x_0' = 3 x_0 - lambda: held at w = 0, x_0' = 4 x_0.
  const LinearSystem system =
      LinearSystem::dense(PETSC_COMM_WORLD, {.A = {3, 0, 1, 0}, .B = {-1, 1}, .C = {0, 1}, .x0 = {1, 1}});
  const RelativeDegree degree = analyse_relative_degree(system);
  EXPECT_NEAR(zero_dynamics(system, degree).largest_real_part, 4.0, 1e-12);
}

}  // namespace
}  // namespace sweepvi::test
