#pragma once

#include <mpi.h>

#include <cstdint>
#include <optional>
#include <string>

#include "io/output_file.hpp"

namespace sweepvi::app {

/// How far a run is, on standard error of rank 0: a bar on a terminal, a line every few seconds otherwise. On
/// request also in a file, for programs: a line of JSON with step, steps, t, iterations, residual, seconds
/// left and the time of the end, UTC; the last step always has its line.
class Progress {
public:
  /// @param first  steps taken before, by a run that this one goes on from
  /// @param file   gets lines appended; what cannot be written is left out
  Progress(MPI_Comm comm, std::int64_t first, std::int64_t steps, const std::optional<std::string>& file);
  ~Progress();
  void show(std::int64_t step, double t, std::int64_t iterations, double residual);

private:
  double seconds_left(std::int64_t step, double now) const;
  void draw(std::int64_t step, double t, std::int64_t iterations, double left);
  void append(std::int64_t step, double t, std::int64_t iterations, double residual, double left);

  bool speaks_ = false;
  bool terminal_ = false;
  bool drawn_ = false;
  std::int64_t first_, steps_;
  double start_, last_, appended_;
  std::optional<OutputLines> file_;
};

}  // namespace sweepvi::app
