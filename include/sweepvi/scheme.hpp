#pragma once

namespace sweepvi {

/// How a scene's process is discretised: `time.scheme`.
enum class Scheme {
  homsp,             ///< higher order Moreau sweeping process, AB (34)-(45)
  zd_euler,          ///< backward Euler on the zero-dynamics form, AB (63); shown because it fails for r > 1
  naive_euler,       ///< backward Euler on x, AB (47); shown because it fails for r > 1
  catching_up,       ///< first-order sweeping process, AB (19)-(20)
  moreau_jean,       ///< Lagrangian systems with restitution, AB (22)-(23)
  zhuravlev_ivanov,  ///< impacts and twisting control in (s, v), HO (12)-(20)
  hybrid  ///< event by event: Taylor series between events, events as steps of length 0 of the other schemes
};

/// Which position decides, in moreau_jean, whether a constraint takes part in the step from (q, v):
/// `time.detection`.
enum class Detection {
  predicted,  ///< g(q + h v) <= 0, AB (22)
  midpoint,   ///< g(q + h v / 2) <= 0
  current     ///< g(q) < 0
};

// As scenes spell them.
const char* name_of(Scheme scheme);
const char* name_of(Detection detection);

/// @throws Error (bad_input) unless 0 < weight <= 1: of t_{k+1}, in theta and gamma schemes
void require_weight(const char* name, double weight);

}  // namespace sweepvi
