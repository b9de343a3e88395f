// The random box VIs of random_lcp_test.cpp in numbers: 10^4 LCPs of P-matrices and as many mixed problems of
// up to 200 unknowns, 2500 problems without structure of up to 8.
// ranks: 1
// labels: long
// timeout: 1800
#include "vi/random_runs.hpp"

namespace sweepvi::test {
namespace {

TEST(RandomLcpFull, PMatricesAreSolved) {
  solve_p_matrices(2, 1667, 200);
}

TEST(RandomLcpFull, WithoutStructureNothingWrongNothingMissed) {
  solve_without_structure(2, 500, 8);
}

}  // namespace
}  // namespace sweepvi::test
