#pragma once

#include <cstddef>
#include <cstdint>

namespace sweepvi {

/// Constraints side by side, each on one coordinate, and these side by side, too (Moreau and Jean's scheme as
/// a box on v). Pointers are to what belongs to the first one.
struct ContactRun {
  std::ptrdiff_t count = 0;
  std::int32_t first = 0;  ///< constraint
  // Of the constraints, as in ContactState.
  double *gap = nullptr, *velocity = nullptr;
  const double* e = nullptr;  ///< as many as constraints; where same_e, the first ones are read for all
  bool same_e = false;
  int* level = nullptr;
  signed char* side = nullptr;     ///< Side
  const char* contact = nullptr;   ///< before the step
  double* mu = nullptr;            ///< [constraint][2]
  const double* weight = nullptr;  ///< H on the coordinate, in the same way
  bool same_weight = false;
  const double* offset = nullptr;  ///< g0, in the same way
  bool same_offset = false;
  double* bound = nullptr;       ///< on v
  double* held_terms = nullptr;  ///< of the row when it was settled
};

/// Which are detected, and their bounds on v.
struct ContactDetection {
  double ahead = 0.0;       ///< where the gap is tested, from t_k [s]
  bool strict = false;      ///< reached below 0, not at 0
  bool afresh = true;       ///< else levels and sides are those of the bounds, and change where those do
  double no_bound = 0.0;    ///< a number that stands for infinity
  double* lower = nullptr;  ///< of the coordinates
  double* upper = nullptr;
};

/// What is near its bound is put there.
struct ContactSettling {
  double near = 0.0;  ///< over the terms of the row
  double* u = nullptr;
  const double* terms = nullptr;
  bool moved = false;  ///< something was not there before
};

/// Impulses of a step that is taken, and where gaps and their velocities move to: g = H q + g0, but in a
/// contact that goes on, where it moves on with its velocity, which Newton's law knows without rounding.
struct ContactMotion {
  double h = 0.0, theta = 1.0;
  double noise = 0.0;  ///< impulses below, over the terms of the row, are none
  const double *u = nullptr, *f = nullptr, *scale = nullptr;
  const double* q = nullptr;              ///< q_{k+1} of the coordinates
  double dissipated = 0.0, scheme = 0.0;  ///< added to: what is lost in impacts, and by the scheme
  double deepest = 0.0;                   ///< or more: -gap
  double fastest = 0.0;                   ///< or more: |H v|
  std::int32_t* changed = nullptr;        ///< added to: constraints whose contact begins or ends
};

struct ContactKernels {
  void (*detect)(const ContactRun&, const ContactDetection&);
  void (*settle)(const ContactRun&, ContactSettling&);
  void (*move)(const ContactRun&, ContactMotion&);
};

/// Those for the processor we are on. Their results are the same to the bit.
const ContactKernels& contact_kernels();

namespace detail {
extern const ContactKernels plain_contact_kernels;
extern const ContactKernels avx2_contact_kernels;  ///< only where SWEEPVI_AVX2 is defined
}  // namespace detail

}  // namespace sweepvi
