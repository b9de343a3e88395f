#pragma once

#include <mpi.h>

#include <cstdint>

namespace sweepvi::app {

/// How far a run is, on standard error of rank 0: a bar on a terminal, a line every few seconds otherwise.
class Progress {
public:
  Progress(MPI_Comm comm, std::int64_t steps);
  ~Progress();
  void show(std::int64_t step, double t, std::int64_t iterations);

private:
  bool speaks_ = false;
  bool terminal_ = false;
  bool drawn_ = false;
  std::int64_t steps_;
  double start_, last_;
};

}  // namespace sweepvi::app
