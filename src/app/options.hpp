#pragma once

#include <mpi.h>

#include <string>
#include <vector>

#include "app/command_line.hpp"

namespace sweepvi::app {

/// Puts a scene's own PETSc options into the database at their rank: below the rc file, PETSC_OPTIONS and
/// the command line (`--set petsc.options` stands between the last two).
void insert_scene_options(const CommandLine& line, const std::string& options, bool from_set);

/// Options of the database that nobody read; reported on standard error by rank 0, with the
/// nearest known name.
std::vector<std::string> report_unused_options(MPI_Comm comm);

}  // namespace sweepvi::app
