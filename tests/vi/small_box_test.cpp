// ranks: 1
#include "vi/small_box.hpp"

#include <gtest/gtest.h>
#include <petscsnes.h>

#include <array>
#include <cmath>

namespace sweepvi {
namespace {

constexpr double none = PETSC_INFINITY;

// A flexible joint's outputs over a step of 1e-2: rows 1, 2 and 0 read what is before them, row 3 reads all.
const std::vector<double> flexible = {1, 0, -0.01, 0, 0, 1, 0, -0.01, 0, -0.01, 1, 0, 0.3, 0.23, 0.3, 1.03};

// On the wall, pushed to it, with what rounding left of the forces on one row: the last unknown goes to its
// bound from a guess of -16, against which 7e-21 is nothing; and still decides who is at its bound.
TEST(SmallBox, SeesSmallNumbersNextToLargeOnes) {
  SmallBox box(4, flexible);
  const std::array<double, 4> right = {0.0, 6.7762635780344027e-21, 0.0, -16.163917475425219};
  const std::array<double, 4> lower = {0.0, 0.0, 0.0, 0.0}, upper = {none, none, none, none};
  for (const double start : {-15.999627027994896, 0.12}) {
    std::array<double, 4> u = {0.0, 0.0, 0.0, start};
    SmallBox::Mask active = 0;
    ASSERT_NE(box.solve(right.data(), lower.data(), upper.data(), 1e-12, u.data(), u.data(), active),
              nullptr);
    // Exactly: multiples of one number, each by a hundredth.
    EXPECT_EQ(u[3], 0.0);
    EXPECT_EQ(u[1], right[1]);
    EXPECT_EQ(u[2], 0.01 * u[1]);
    EXPECT_EQ(u[0], 0.01 * u[2]);
  }
}

// Rows that cancel are right to their own rounding, not to that of the largest number.
TEST(SmallBox, MendsRowsToTheirOwnRounding) {
  SmallBox box(4, flexible);
  ASSERT_TRUE(box.mends());
  const double large = 100.0;
  std::array<double, 4> right = {0.0, 1e-9 - 0.01 * large, 0.0, 0.0};
  std::array<double, 4> u = {0.0, 1e-9, 1e-11, large};
  right[3] = 0.3 * u[0] + 0.23 * u[1] + 0.3 * u[2] + 1.03 * u[3];
  for (double& value : u)
    value += 1e-14 * large;  // what an inverse may be off by
  box.mend(right.data(), 0, u.data());
  EXPECT_EQ(u[2], 0.01 * u[1]);
  EXPECT_EQ(u[0], 0.01 * u[2]);
  EXPECT_NEAR(u[1], right[1] + 0.01 * u[3], 3e-16);  // terms of 1
  EXPECT_NEAR(u[3], large, 1e-12);                   // read the others as they were
  box.mend(right.data(), 0, u.data());
  EXPECT_NEAR(u[3], large, 6e-14);  // terms of 200
  EXPECT_NEAR(u[1], 1e-9, 8e-16);
  const double held = u[1];
  right[1] = 7.0;
  box.mend(right.data(), 0b0010, u.data());  // an active row stays
  EXPECT_EQ(u[1], held);
}

// Where rows read each other strongly, that would make things worse.
TEST(SmallBox, DoesNotMendStrongCoupling) {
  EXPECT_FALSE(SmallBox(2, {1.0, 3.0, -3.0, 1.0}).mends());
  EXPECT_FALSE(SmallBox(3, {1.0, 2.0, 2.0, 2.0, 1.0, 2.0, 2.0, 2.0, 1.0}).mends());
  EXPECT_TRUE(SmallBox(1, {2.0}).mends());
  EXPECT_TRUE(SmallBox(2, {1.0, 5.0, 0.0, 1.0}).mends());  // one after the other: exact
}

}  // namespace
}  // namespace sweepvi
