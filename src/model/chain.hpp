#pragma once

#include "model/chain_spec.hpp"
#include "sweepvi/lagrangian.hpp"

namespace sweepvi {

/// The linear system of N coupled elements; see Element for its equations. Rows stand element by element
/// whatever the element's layout: `state_order` leads to the order of the scene. Each rank makes the elements
/// it owns. @note Collective on `comm`.
LinearSystem make_chain(MPI_Comm comm, const ChainSpec& spec);

/// The same as a mechanical system: with the element's mass M = diag(mass), K = -M dv'/dq, C = -M dv'/dv,
/// H = dw/dq, f = M (forces of v). @pre spec.element->mass is known
/// @throws Error (bad_input) on every rank if lambda does not push as H' / mass
/// @note Collective on `comm`.
LagrangianSystem make_lagrangian_chain(MPI_Comm comm, const ChainSpec& spec);

}  // namespace sweepvi
