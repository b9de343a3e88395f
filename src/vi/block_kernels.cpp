#include "vi/block_kernels.hpp"

#include "vi/block_kernels_each.hpp"

namespace sweepvi {

const BlockKernels detail::plain_block_kernels = {sweep_any, judge_any};

const BlockKernels& block_kernels() {
#ifdef SWEEPVI_AVX2
  static const bool has_avx2 = __builtin_cpu_supports("avx2") != 0;
  if (has_avx2) return detail::avx2_block_kernels;
#endif
  return detail::plain_block_kernels;
}

}  // namespace sweepvi
