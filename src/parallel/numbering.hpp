#pragma once

#include <cstdint>
#include <vector>

#include "parallel/element_graph.hpp"

namespace sweepvi {

/// Nonzeros below the diagonal of the Cholesky factor of a matrix with this graph, its rows eliminated in
/// `order` (order[k] is the k-th vertex). Counted without forming the factor, in nearly linear time: J. R.
/// Gilbert, E. G. Ng, B. W. Peyton, SIAM J. Matrix Anal. Appl. 15 (1994) 1075-1091.
std::int64_t factor_nonzeros(const Graph& graph, const std::vector<idx_t>& order);

/// The order of elimination with the least fill of three: as given, reverse Cuthill-McKee (chains), nested
/// dissection by METIS (lattices). The given one wins ties; later ones are only tried where there is much to
/// gain.
/// @return order[k] is the k-th vertex
/// @throws Error (internal) if METIS fails
std::vector<idx_t> low_fill_order(Graph& graph);

}  // namespace sweepvi
