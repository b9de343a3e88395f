#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "io/file_order.hpp"
#include "io/recorded.hpp"
#include "io/recording.hpp"

namespace sweepvi {

/// A run kept in memory instead of a file: states and events. Calls are collective unless they say otherwise.
class KeptRun {
public:
  /// @param recording  what it reads from must outlive this
  /// @param columns    of /x, ascending; empty: all
  /// @throws Error (bad_input) on every rank if there is no such column
  KeptRun(MPI_Comm comm, const std::string& scene, Recording recording,
          const std::vector<std::int64_t>& columns);

  /// Numbers in a row.
  std::int64_t width() const { return width_; }
  /// Keeps the present state as that of time t.
  void row(double t);
  /// Keeps what happened in the step that ended at t. @note Not collective.
  void events(double t);

  /// All of it, on every rank; nothing is left here.
  /// @param name  for messages
  /// @throws Error (bad_input) on every rank if a number is not finite
  Recorded take(const std::string& name);

private:
  std::vector<double> assemble();

  MPI_Comm comm_;
  Recording recording_;
  Quantity& states_;
  std::int64_t columns_ = 0, width_ = 0;
  FileOrder order_;
  std::vector<double> mine_, slice_;
  std::vector<double> t_;
  std::vector<double> slices_;  // this rank's part of each row, row after row
  std::vector<Event> events_;
};

}  // namespace sweepvi
