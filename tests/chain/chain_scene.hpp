#pragma once

#include <gtest/gtest.h>
#include <mpi.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <utility>

#include "dvi/systems.hpp"
#include "io/scene.hpp"
#include "model/from_scene.hpp"

namespace sweepvi::test {

/// A file that goes when its name does.
class TemporaryFile {
public:
  explicit TemporaryFile(std::string path) : path_(std::move(path)) {}
  ~TemporaryFile() {
    std::error_code ignored;
    std::filesystem::remove(path_, ignored);
  }
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;

private:
  std::string path_;
};

/// The scene `kind = "chain"` with these keys, read as a user's: from a file, which only rank 0 has.
inline Scene chain_scene(const std::string& keys) {
  std::string path = (std::filesystem::temp_directory_path() / "sweepvi_chain_XXXXXX").string();
  int rank = 0;
  MPI_Comm_rank(PETSC_COMM_WORLD, &rank);
  if (rank == 0) {
    const int file = mkstemp(path.data());
    EXPECT_GE(file, 0);
    close(file);
    std::ofstream(path) << "[time]\nend = 1.0\nstep = 0.01\n[model]\nkind = \"chain\"\n" << keys;
  }
  MPI_Bcast(path.data(), static_cast<int>(path.size()), MPI_CHAR, 0, PETSC_COMM_WORLD);
  const TemporaryFile removed(rank == 0 ? path : "");
  return read_scene(PETSC_COMM_WORLD, path, {});
}

inline LinearSystem chain_system(const std::string& keys) {
  Scene scene = chain_scene(keys);
  return make_linear_system(PETSC_COMM_WORLD, scene);
}

/// The initial data in the order of /x.
inline std::vector<double> start_of(const LinearSystem& system) {
  return in_scene_order(system, everywhere(system.x0.get()));
}

}  // namespace sweepvi::test
