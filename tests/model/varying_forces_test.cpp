// ranks: 1
#include "model/varying_forces.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <utility>
#include <vector>

namespace sweepvi {
namespace {

constexpr PetscInt rows = 7;

Signal signal(PetscInt k, double frequency) {
  const auto number = static_cast<double>(k);
  return {0.25 * number, 1.0 + number, frequency, 0.7 * number};
}

void expect_sums(const Forcing& forcing) {
  const double t_1 = 0.37, t_2 = 0.31, factor_1 = 0.8, factor_2 = -0.45;
  std::vector<double> expected(rows, 0.0);
  for (const Forcing::Entry& entry : forcing.varying)
    expected[static_cast<std::size_t>(entry.local)] +=
        factor_1 * entry.signal.value(t_1) + factor_2 * entry.signal.value(t_2);
  std::vector<double> found(rows, NAN);
  VaryingForces(forcing, rows).find(found.data(), t_1, factor_1, t_2, factor_2);
  for (std::size_t i = 0; i < expected.size(); ++i)
    EXPECT_NEAR(found[i], expected[i], 5e-15) << "row " << i;  // roundings of sums of 10
}

TEST(VaryingForces, AreThoseOfTheSignalsInAllRows) {
  Forcing forcing;
  for (PetscInt i = 0; i < rows; ++i)
    forcing.varying.push_back({i, signal(i, i < 3 ? 2.0 : 0.5)});
  expect_sums(forcing);
  std::swap(forcing.varying[1], forcing.varying[5]);
  expect_sums(forcing);
}

TEST(VaryingForces, AreZeroElsewhere) {
  Forcing forcing;
  expect_sums(forcing);
  forcing.varying.push_back({4, signal(4, 2.0)});
  forcing.varying.push_back({1, signal(1, 0.5)});
  forcing.constant.push_back({2, {3.0, 0.0, 0.0, 0.0}});
  expect_sums(forcing);
}

TEST(VaryingForces, AddUpWhereARowHasSeveral) {
  Forcing forcing;
  for (PetscInt k = 0; k < rows; ++k)
    forcing.varying.push_back({k / 2, signal(k, 1.5)});
  expect_sums(forcing);
}

}  // namespace
}  // namespace sweepvi
