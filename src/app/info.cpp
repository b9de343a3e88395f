#include <fmt/format.h>

#include "app/sandbox.hpp"
#include "app/verbs.hpp"
#include "app/versions.hpp"
#include "sweepvi_config.hpp"

namespace sweepvi::app {

ExitCode info(MPI_Comm comm) {
  int rank = 0;
  int ranks = 1;
  MPI_Comm_rank(comm, &rank);
  MPI_Comm_size(comm, &ranks);
  if (rank != 0) return ExitCode::done;
  fmt::print("sweepvi {} ({}, {} build)\n", config::version, config::git_hash, config::build_type);
  fmt::print(
      "PETSc   {}\nMUMPS   {}\nMETIS   {}\nHDF5    {}\nMPI     {}, {} rank(s)\nBLAS    {}\nsandbox {}\n",
      petsc_version(), mumps_version(), metis_version(), hdf5_version(), mpi_version(), ranks,
      blas_description(), Sandbox::describe());
  return ExitCode::done;
}

}  // namespace sweepvi::app
