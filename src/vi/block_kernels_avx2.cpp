// Compiled for processors with AVX2, without fused multiply-add: the same sums as elsewhere.
#ifdef SWEEPVI_AVX2
#include "vi/block_kernels_each.hpp"

namespace sweepvi {

const BlockKernels detail::avx2_block_kernels = {sweep_any, judge_any};

}  // namespace sweepvi
#endif
