#pragma once

#include "model/chain_spec.hpp"
#include "sweepvi/linear_system.hpp"

namespace sweepvi {

/// The linear system of N coupled elements; see Element for its equations. Rows stand element by element
/// whatever the element's layout: `state_order` leads to the order of the scene. Each rank makes the elements
/// it owns. @note Collective on `comm`.
LinearSystem make_chain(MPI_Comm comm, const ChainSpec& spec);

}  // namespace sweepvi
