#include "target.hpp"

SWEEPVI_FUZZ_TARGET(data)
