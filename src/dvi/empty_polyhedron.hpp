#pragma once

#include <optional>
#include <string>
#include <vector>

#include "sweepvi/petsc.hpp"

namespace sweepvi {

/// Faces of a polyhedron that exclude each other.
struct Contradiction {
  std::vector<PetscInt> faces;  ///< scene numbers, ascending
  double gap = 0.0;             ///< every point violates one of them by this much at least, in u
  std::string text() const;
};

/// Proves that { u : G u >= g } is empty, by multipliers y >= 0 with G' y = 0 and g' y > 0 (Farkas): then
/// y' (G u - g) < 0 for every u. In floating point G' y = 0 holds up to rounding, and what is proved is that
/// there is no point within 1e4 times the size of the data; a set that misses being empty, or not, by less
/// than rounding counts as not empty.
///
/// y comes from a point of least violation, which minimises the sum of max(0, g_i - G_i u)^2 / |G_i|^2: there
/// y_i = max(0, g_i - G_i u) / |G_i|^2 has G' y = 0.
///
/// @param g_terms     what g is known up to, times rounding
/// @param near        u from where to look
/// @param face_order  scene numbers of this rank's faces
/// @note Collective.
std::optional<Contradiction> find_contradiction(Mat G, Vec g, Vec g_terms, Vec near,
                                                const std::vector<PetscInt>& face_order);

}  // namespace sweepvi
