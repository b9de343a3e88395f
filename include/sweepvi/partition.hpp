#pragma once

#include "sweepvi/linear_system.hpp"
#include "sweepvi/relative_degree.hpp"

namespace sweepvi {

/// Deals a system out over its ranks and numbers it for low fill, whatever order the scene had.
///
/// METIS cuts the coupling graph: blocks (elements, or single states) are the vertices, weighted by their
/// states; a nonzero of A, or a constraint that reads or pushes two blocks, is an edge. A constraint lives
/// with the state it reads most; where outputs are states, with all of them, and their blocks become one.
///
/// Each rank, also a single one, then numbers its blocks so that factors of I - hA fill in little: in the
/// scene's order, by reverse Cuthill-McKee or by nested dissection, whichever fills in least; the scene's
/// order wins ties. States of a block keep their order; constraints and outputs stand in the order of their
/// blocks.
///
/// `edge_cut`, `block` and `block_count` are set; `state_order` and `constraint_order` lead back to the
/// scene's numbers.
/// @throws Error (internal) on every rank if METIS fails
/// @note Collective. Rank 0 holds the whole graph for a while: METIS is serial.
void distribute(LinearSystem& system, RelativeDegree& relative_degree);

}  // namespace sweepvi
