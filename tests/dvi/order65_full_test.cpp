// ranks: 1
// labels: long
// timeout: 240
// AB (65) against the exact solution at the fine step sizes of order65.json.
#include "dvi/order65.hpp"

namespace sweepvi::test {
namespace {

TEST(Order65Full, BoxOnZMatchesThePapersSchemeWithBothSolvers) {
  expect_the_papers_scheme(3000, 100000);
}

TEST(Order65Full, PrimalDualGivesTheSame) {
  expect_the_same_primal_dual({10000});
}

}  // namespace
}  // namespace sweepvi::test
