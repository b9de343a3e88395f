#pragma once

#include <mpi.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "io/table_file.hpp"
#include "sweepvi/trajectory.hpp"

namespace sweepvi {

/// Sums over a run of the measures of each constraint and level.
struct MeasureSums {
  std::size_t levels = 0;
  std::vector<double> sums;  ///< level by level for each constraint
};

/// What a file tells of a trajectory.
struct Recorded {
  std::string path;
  std::unique_ptr<Trajectory> trajectory;  ///< of the columns asked for
  std::size_t columns = 0;                 ///< of the file
  bool run = false;  ///< one of ours; a table of numbers names neither blocks nor events
  std::optional<std::vector<std::int64_t>> elements;  ///< that were recorded; none: all
  std::optional<std::vector<Event>> events;
  std::optional<MeasureSums> measures;
};

/// Opens what `sweepvi run` wrote, or a table of numbers in text: a name that ends in ".csv", a line
/// "t,name,..." and then lines of as many numbers, right limits at events. Rows of a run are read when they
/// are asked for, on the rank that asks; at most 128 MB of them stay in memory.
/// @param columns  numbers from 0, ascending, of those wanted; empty: all
/// @throws Error (bad_input) on every rank: no such file, no trajectory, one still being written, columns
/// that it does not have, times that decrease or are not finite. Later, from row(), on the rank that asked:
/// entries that are not finite, or that cannot be read.
/// @note Collective on comm. Every rank opens the file by itself.
Recorded read_recorded(MPI_Comm comm, const std::string& path, const std::vector<std::int64_t>& columns);

// Its two kinds, not collective.

Recorded read_table(const std::string& path, const std::vector<std::int64_t>& columns);
/// @param rank  of `ranks`, which reads its share of /mu: `measures` is that rank's part of the sums
Recorded read_run(const std::string& path, const std::vector<std::int64_t>& columns, int rank, int ranks);

/// @throws Error (bad_input) if one of them is not below `count`
void check_columns(const std::string& path, const std::vector<std::int64_t>& columns, std::size_t count);

}  // namespace sweepvi
