#pragma once

#include "io/scene.hpp"
#include "sweepvi/linear_system.hpp"

namespace sweepvi {

/// A chain or ring of `jerk` elements (r = 3, five states z1 z2 z3 xi1 xi2 each): AB (65), coupled through w
/// = z1,
///
///     z1' = z2,  z2' = z3,  z3' = a1 z1 + a2 z2 + a3 z3 + xi2 + S(w)_i + force + lambda,
///     xi1' = xi2,  xi2' = -xi1 + z1,      S(w)_i = coupling (w_{i-1} - 2 w_i + w_{i+1}),  w = 0 beyond the
///     ends.
///
/// Each rank makes the elements it owns. @note Collective on `comm`.
LinearSystem make_chain(MPI_Comm comm, const ChainSpec& spec);

}  // namespace sweepvi
