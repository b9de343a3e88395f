// ranks: 1
// AB (65) against the exact solution at the coarse step sizes of order65.json; order65_full_test.cpp has the
// fine ones.
#include "dvi/order65.hpp"

namespace sweepvi::test {
namespace {

TEST(Order65, BoxOnZMatchesThePapersSchemeWithBothSolvers) {
  expect_the_papers_scheme(1, 4000);
}

TEST(Order65, PrimalDualGivesTheSame) {
  expect_the_same_primal_dual({100, 1000});
}

}  // namespace
}  // namespace sweepvi::test
