// Compiled for processors with AVX2, without fused multiply-add: the same sums as elsewhere.
#ifdef SWEEPVI_AVX2
#include "dvi/contact_kernels_each.hpp"

namespace sweepvi {

const ContactKernels detail::avx2_contact_kernels = {detect_contacts, settle_contacts, move_contacts};

}  // namespace sweepvi
#endif
