#pragma once

#include <mpi.h>

#include <cstdint>
#include <optional>
#include <vector>

#include "io/recorded.hpp"
#include "sweepvi/filled_graph.hpp"
#include "sweepvi/trajectory_error.hpp"

namespace sweepvi::app {

/// All that is said about two runs.
struct Comparison {
  double largest = 0.0;  // |x| of both
  GraphDistance graphs;
  TrajectoryError errors;
  std::int64_t worst_component = 0;  // errors.relative_component as /x has it
  EventErrors events;
  bool events_known = false;     // by both
  std::vector<double> measures;  // by level: largest difference of a constraint's sums; empty: unknown
};

/// @throws Error (bad_input) if the states of two runs are not the same ones, or there is no time in common
void check_alike(const Recorded& a, const Recorded& b);

/// @param largest    entry of both
/// @param tolerance  of the Hausdorff distance; none: three digits of it
/// @throws Error (internal), perhaps on this rank alone, if a row that could be read before cannot be now
/// @note Collective.
Comparison measure(MPI_Comm comm, const Recorded& a, const Recorded& b, double largest,
                   const std::optional<double>& tolerance);

}  // namespace sweepvi::app
