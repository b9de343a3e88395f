#pragma once

#include <string>

namespace sweepvi::app {

std::string petsc_version();
std::string mumps_version();
std::string metis_version();
std::string hdf5_version();
std::string mpi_version();
/// File of the BLAS library in this process, and its threads.
std::string blas_description();

}  // namespace sweepvi::app
