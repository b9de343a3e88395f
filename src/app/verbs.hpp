#pragma once

#include <mpi.h>

#include "app/command_line.hpp"
#include "sweepvi/error.hpp"

namespace sweepvi::app {

// The verbs. Each is collective, throws Error, prints on rank 0 only and returns the exit code.
ExitCode run(MPI_Comm comm, const CommandLine& line);
ExitCode check_scene(MPI_Comm comm, const CommandLine& line);
ExitCode solve(MPI_Comm comm, const CommandLine& line);
ExitCode compare(MPI_Comm comm, const CommandLine& line);
ExitCode study(MPI_Comm comm, const CommandLine& line);
ExitCode bench(MPI_Comm comm, const CommandLine& line);
ExitCode info(MPI_Comm comm);

/// `--confine`: from here on, documents name the files of its list only, options come from a list of harmless
/// ones, and PETSc finds none in the environment. To be called before MPI and PETSc start.
/// @return the files of the list
/// @throws Error (bad_input): no list, or words for PETSc that are not known to be harmless
/// @pre line.confine
std::vector<std::string> confine(const CommandLine& line);

/// Refuses PETSc options of a document that load code or read other options; in a process that is confined,
/// all that are not known to be harmless.
void check_options_allowed(const std::string& where, const std::string& options);

}  // namespace sweepvi::app
