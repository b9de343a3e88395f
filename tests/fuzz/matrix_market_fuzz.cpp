#include "target.hpp"

SWEEPVI_FUZZ_TARGET(matrix_market)
