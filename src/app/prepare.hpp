#pragma once

#include "app/command_line.hpp"
#include "sweepvi/linear_system.hpp"
#include "sweepvi/relative_degree.hpp"

namespace sweepvi::app {

/// A scene turned into what the solver works on: read, checked, classified, dealt out over the ranks.
struct Prepared {
  Scene scene;  ///< its matrices are in `system` by now
  LinearSystem system;
  RelativeDegree relative_degree;
  MarkovReport markov;
};

/// @throws Error (bad_input) on every rank.  @note Collective.
Prepared prepare(MPI_Comm comm, const CommandLine& line);

}  // namespace sweepvi::app
