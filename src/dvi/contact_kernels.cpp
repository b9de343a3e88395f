#include "dvi/contact_kernels.hpp"

#include "dvi/contact_kernels_each.hpp"

namespace sweepvi {

const ContactKernels detail::plain_contact_kernels = {detect_contacts, settle_contacts, move_contacts};

const ContactKernels& contact_kernels() {
#ifdef SWEEPVI_AVX2
  static const bool has_avx2 = __builtin_cpu_supports("avx2") != 0;
  if (has_avx2) return detail::avx2_contact_kernels;
#endif
  return detail::plain_contact_kernels;
}

}  // namespace sweepvi
