#pragma once

#include <mpi.h>

#include "sweepvi/trajectory.hpp"

namespace sweepvi {

/// A Hausdorff distance that is known to lie in [value, value + tolerance].
struct GraphDistance {
  double value = 0.0;
  double tolerance = 0.0;
  double t = 0.0;     ///< where the point stands that is so far from the other graph [s]
  bool first = true;  ///< whether it belongs to the first of the two trajectories
};

/// The Hausdorff distance of the filled-in graphs of two trajectories, AB (66)-(69):
///
///     max( sup_{p in A} inf_{q in B} d(p, q),  sup_{q in B} inf_{p in A} d(p, q) ),
///     d((t, x), (s, y)) = max(|t - s|, ||x - y||_2).
///
/// Exact up to `tolerance`, and to rounding: the largest distance may be reached inside a segment. There a
/// branch and bound on pieces of segments finds it; a piece is nowhere farther from the other graph than its
/// ends are from any one segment of it, because the distance from a convex set is convex. Near points are
/// looked for outwards from the same time: |t - s| bounds the search, and what a graph is long from one row
/// to another says which rows cannot be nearer.
///
/// The segments are dealt out over the ranks in order of time, hence each rank should be able to read any
/// row.
/// @param tolerance  > 0, in the units of t and x
/// @throws Error (bad_input) if the trajectories have different numbers of components
/// @note Collective on comm; all ranks pass the same trajectories and get the same result.
GraphDistance filled_graph_distance(MPI_Comm comm, Trajectory& a, Trajectory& b, double tolerance);

}  // namespace sweepvi
