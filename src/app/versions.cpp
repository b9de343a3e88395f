#include "app/versions.hpp"

#include <dlfcn.h>
#include <fmt/format.h>
#include <hdf5.h>
#include <metis.h>
#include <mpi.h>
#include <petscksp.h>

#if defined(PETSC_HAVE_MUMPS)
#include <dmumps_c.h>
#endif

#include <cstdlib>
#include <filesystem>

namespace sweepvi::app {

std::string petsc_version() {
  return fmt::format("{}.{}.{}", PETSC_VERSION_MAJOR, PETSC_VERSION_MINOR, PETSC_VERSION_SUBMINOR);
}

std::string mumps_version() {
#if defined(PETSC_HAVE_MUMPS)
  return MUMPS_VERSION;
#else
  return "not built into PETSc";
#endif
}

std::string metis_version() {
  return fmt::format("{}.{}.{}", METIS_VER_MAJOR, METIS_VER_MINOR, METIS_VER_SUBMINOR);
}

std::string hdf5_version() {
  unsigned major = 0;
  unsigned minor = 0;
  unsigned release = 0;
  H5get_libversion(&major, &minor, &release);
  return fmt::format("{}.{}.{}", major, minor, release);
}

std::string mpi_version() {
  char text[MPI_MAX_LIBRARY_VERSION_STRING];
  int length = 0;
  MPI_Get_library_version(text, &length);
  const std::string whole(text, static_cast<std::size_t>(length));
  return whole.substr(0, whole.find(','));
}

std::string blas_description() {
  void* symbol = dlsym(RTLD_DEFAULT, "dgemm_");
  Dl_info where{};
  std::string file = "unknown";
  if (symbol != nullptr && dladdr(symbol, &where) != 0 && where.dli_fname != nullptr) {
    std::error_code status;
    const auto real = std::filesystem::canonical(where.dli_fname, status);
    file = status ? where.dli_fname : real.string();
  }
  using Threads = int (*)();
  if (auto threads = reinterpret_cast<Threads>(dlsym(RTLD_DEFAULT, "openblas_get_num_threads")))
    return fmt::format("{}, {} thread(s)", file, threads());
  const char* omp = std::getenv("OMP_NUM_THREADS");
  return fmt::format("{}, OMP_NUM_THREADS={}", file, omp != nullptr ? omp : "not set");
}

}  // namespace sweepvi::app
