// The same at length: 1029 problems without a solution and 1029 with one, of 2 ... 150 unknowns, some of up
// to 2000, and 294 stiff ones.
// ranks: 1
// labels: long
// timeout: 3600
#include "vi/data_runs.hpp"

namespace sweepvi::test {
namespace {

TEST(DataFull, OnlyWhatHasASolutionIsCertified) {
  certify_only_what_has_a_solution(10, 143, 150);
}

TEST(DataFull, OfLargeOnes) {
  certify_only_what_has_a_solution(11, 4, 2000);
}

}  // namespace
}  // namespace sweepvi::test
