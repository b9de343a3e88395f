#pragma once

#include <mpi.h>

#include <csignal>
#include <optional>
#include <string>

namespace sweepvi::app {

/// From here on SIGUSR1, SIGTERM and SIGINT no longer end the program: they are noted, and a run stops in
/// order after its step. Repeated ones change nothing.
void note_signals();

/// What asks a run to stop, or to write a checkpoint.
class Watch {
public:
  /// @param started     MPI_Wtime at the start of the program
  /// @param wall_limit  [s] since then
  /// @param interval    [s] between checkpoints; 0: none
  Watch(MPI_Comm comm, double started, std::optional<double> wall_limit, double interval);

  struct Asked {
    bool stop = false;
    bool checkpoint = false;
  };
  /// The same on every rank. @note Collective.
  Asked ask();
  /// Why `stop` was asked for: "SIGUSR1", or the limit.
  std::string reason() const;
  /// A checkpoint was written: the interval begins anew.
  void checkpoint_written() { last_ = MPI_Wtime(); }

private:
  MPI_Comm comm_;
  bool clock_ = false;  // this rank's counts
  double started_, interval_, last_;
  std::optional<double> wall_limit_;
  int stop_signal_ = 0;
};

}  // namespace sweepvi::app
