#pragma once

#include <mpi.h>

#include <string>
#include <vector>

#include "io/scene.hpp"
#include "io/table_file.hpp"

namespace sweepvi::app {

/// Now, or so many seconds later, in UTC, as in 2026-01-31T12:00:00Z.
std::string timestamp(double later = 0.0);

/// The root attributes every result has: what made it, from what, where, when. @note Collective.
/// @param overrides  what `--set` changed in the scene
void describe(TableFile& file, MPI_Comm comm, const std::string& title, const std::string& scene,
              const Overrides& overrides, const std::string& started);

/// A file of the command line and what it is called there.
struct NamedPath {
  std::string role, path;
};

/// @throws Error (bad_input) on every rank if two of these paths (empty ones aside) are the same file.
/// @note Collective.
void check_distinct(MPI_Comm comm, const std::vector<NamedPath>& paths);

}  // namespace sweepvi::app
