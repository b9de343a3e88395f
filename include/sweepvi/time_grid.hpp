#pragma once

#include <petscsys.h>

namespace sweepvi {

/// `steps` equal steps from `start` to `end`: t_k = start + k h by multiplication, t_K = end exactly.
struct TimeGrid {
  double start = 0.0;  ///< [s]
  double end = 0.0;    ///< [s]
  PetscInt steps = 1;  ///< K >= 1

  double h() const { return (end - start) / static_cast<double>(steps); }
  double time(PetscInt k) const { return k == steps ? end : start + static_cast<double>(k) * h(); }
};

}  // namespace sweepvi
