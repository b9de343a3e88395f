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

}  // namespace sweepvi::app
