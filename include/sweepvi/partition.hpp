#pragma once

#include "sweepvi/linear_system.hpp"
#include "sweepvi/relative_degree.hpp"

namespace sweepvi {

/// Deals a system out over its ranks by METIS on the coupling graph: blocks (elements, or single states) are
/// the vertices, weighted by their states; a nonzero of A, or a constraint that reads or pushes two blocks,
/// is an edge. A constraint lives with the state it reads most; where outputs are states, with all of them.
/// Within a rank the scene's order is kept. `system.edge_cut` is set. Nothing changes on one rank.
/// @note Collective.
void distribute(LinearSystem& system, RelativeDegree& relative_degree);

}  // namespace sweepvi
