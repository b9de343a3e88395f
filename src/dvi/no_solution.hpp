#pragma once

#include <optional>
#include <vector>

#include "dvi/empty_polyhedron.hpp"

namespace sweepvi {

/// Proves that the box VI of F(u) = K u + q on [lower, upper] has no solution: solutions lie in
///
///     { u : lower <= u <= upper,  F_i(u) >= 0 where upper_i = inf,  F_i(u) <= 0 where lower_i = -inf },
///
/// and that polyhedron is empty (find_contradiction). Where it is not, a VI that is monotone has a solution;
/// of others nothing is said.
/// @param q_terms  what q is known up to, times rounding
/// @param near     where to look
/// @return the rows i that exclude every point of the box together, with u unknown to @ref Contradiction::gap
/// @note Collective.
std::optional<Contradiction> prove_no_solution(Mat K, Vec q, Vec q_terms, Vec lower, Vec upper, Vec near);

}  // namespace sweepvi
