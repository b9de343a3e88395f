#pragma once

#include <mpi.h>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "sweepvi/trajectory.hpp"

namespace sweepvi {

/// When something happened to a constraint.
struct EventTime {
  double t = 0.0;  ///< s
  std::int64_t constraint = 0;
  int level = 1;       ///< of an impact
  bool impact = true;  ///< else a lift-off
};

/// From first to last [s].
struct TimeSpan {
  double first, last;
};

/// Events of two runs, side by side.
struct EventErrors {
  std::size_t matched = 0;  ///< pairs
  std::size_t unmatched_a = 0, unmatched_b = 0;
  double largest = 0.0;         ///< difference of the times of a pair [s]
  double t = 0.0;               ///< where it is, in the first run [s]
  std::vector<TimeSpan> spans;  ///< between the times of each pair; unmatched ones alone. In order of time
};

/// Pairs impacts of the same constraint and level, and lift-offs of the same constraint, in their order.
/// Where one run has more of them, those are left over without which the differences in time have the least
/// sum (beyond 1e8 possibilities: the last ones).
/// @note Not collective.
EventErrors compare_events(const std::vector<EventTime>& a, const std::vector<EventTime>& b);

/// How far two trajectories are apart at equal times, between `start` and `end`, which both of them know.
/// Between rows they are linear; at a jump both limits count.
struct TrajectoryError {
  double start = 0.0, end = 0.0;  ///< [s]
  /// sup ||x_A(t) - x_B(t)||_2 away from jumps; none, if nothing is away from them. [x]
  std::optional<double> sup;
  double sup_t = 0.0;     ///< where it is reached [s]
  double left_out = 0.0;  ///< share of the time from start to end that is not away from jumps
  double l1 = 0.0;        ///< integral of ||x_A(t) - x_B(t)||_2 dt, jumps included [x s]
  double final = 0.0;     ///< ||x_A(end) - x_B(end)||_2 [x]
  /// Each component in its own unit: the largest of sup |x_A,i(t) - x_B,i(t)|, away from jumps, over the
  /// largest |x_i| of any row of both. None where `sup` is none.
  std::optional<double> relative;
  std::size_t relative_component = 0;  ///< whose it is
};

/// Near a jump that comes later in one run than in the other, the difference is as large as the jump, however
/// small the delay. Left out of the supremum is therefore each of the spans of time `jumps`, up to the next
/// row of either trajectory on both sides of it; for the rest it is exact, like the integral.
///
/// The time is dealt out over the ranks, hence each rank should be able to read any row.
/// @param jumps  as EventErrors::spans, the same on every rank
/// @throws Error (bad_input) if the numbers of components differ or there is no time in common
/// @note Collective on comm; all ranks get the same result.
TrajectoryError trajectory_error(MPI_Comm comm, Trajectory& a, Trajectory& b,
                                 const std::vector<TimeSpan>& jumps);

}  // namespace sweepvi
