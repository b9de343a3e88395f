// What people hand to the program, each reader as a function of bytes: for the fuzz targets, and for the test
// that replays what they found. A reader must succeed or throw Error (bad_input); all else is a defect.
#pragma once

#include <hdf5_hl.h>
#include <unistd.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>
#include <string_view>

#include "io/hdf5_handle.hpp"
#include "io/matrix_file.hpp"
#include "io/recorded.hpp"
#include "io/scene.hpp"
#include "sweepvi/error.hpp"

namespace sweepvi::fuzz {

namespace fs = std::filesystem;

/// A folder for one process or, with `comm`, for all of its ranks; vanishes with its content.
class Folder {
public:
  explicit Folder(MPI_Comm comm) : comm_(comm) {
    int rank = 0;
    MPI_Comm_rank(comm, &rank);
    root_ = rank == 0;
    std::string name = (fs::temp_directory_path() / "sweepvi_fuzz_XXXXXX").string();
    if (root_ && mkdtemp(name.data()) == nullptr) std::abort();
    MPI_Bcast(name.data(), static_cast<int>(name.size()), MPI_CHAR, 0, comm);
    path_ = name;
  }
  ~Folder() {
    if (root_) fs::remove_all(path_);
  }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;

  MPI_Comm comm() const { return comm_; }
  bool root() const { return root_; }
  /// The path of `bytes` as a file; rank 0 writes. Collective.
  std::string file(const std::string& name, std::string_view bytes) const {
    if (root_) {
      std::ofstream out(path_ / name, std::ios::binary);
      out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    }
    MPI_Barrier(comm_);
    return path(name);
  }
  std::string path(const std::string& name) const { return (path_ / name).string(); }

private:
  MPI_Comm comm_;
  bool root_ = false;
  fs::path path_;
};

inline void expect(bool holds, const char* what) {
  if (!holds) throw std::logic_error(std::string("a reader let pass: ") + what);
}

/// What SparseEntries promises.
inline void verify(const SparseEntries& matrix) {
  expect(matrix.rows >= 1 && matrix.cols >= 1, "a matrix without rows or columns");
  expect(matrix.row_starts.size() == static_cast<std::size_t>(matrix.rows) + 1, "a wrong number of rows");
  expect(matrix.row_starts.front() == 0, "rows that do not begin at 0");
  expect(matrix.columns.size() == matrix.values.size(), "columns without values");
  expect(static_cast<std::size_t>(matrix.row_starts.back()) == matrix.values.size(), "a wrong last row");
  for (std::size_t i = 0; i < static_cast<std::size_t>(matrix.rows); ++i) {
    std::int64_t last = -1;
    for (auto k = matrix.row_starts[i]; k < matrix.row_starts[i + 1]; ++k) {
      const auto at = static_cast<std::size_t>(k);
      expect(matrix.columns[at] > last && matrix.columns[at] < matrix.cols, "columns out of order or range");
      expect(std::isfinite(matrix.values[at]), "a value that is not finite");
      last = matrix.columns[at];
    }
  }
}

/// What Recorded and Trajectory promise, entry by entry.
inline void verify(const Recorded& recorded, std::size_t columns) {
  Trajectory& trajectory = *recorded.trajectory;
  expect(trajectory.rows() >= 1 && trajectory.rows() == trajectory.t().size(), "a trajectory without rows");
  expect(trajectory.components() == columns, "a wrong number of columns");
  double last = -INFINITY;
  for (const double t : trajectory.t()) {
    expect(std::isfinite(t) && t >= last, "times that decrease or are not finite");
    last = t;
  }
  for (std::size_t k = 0; k < trajectory.rows(); ++k) {
    const double* row = trajectory.row(k);
    for (std::size_t i = 0; i < columns; ++i)
      expect(std::isfinite(row[i]), "an entry that is not finite");
  }
  if (!recorded.measures) return;
  expect(recorded.measures->levels >= 1 && !recorded.measures->sums.empty(), "measures without levels");
  expect(recorded.measures->sums.size() % recorded.measures->levels == 0, "a constraint without all levels");
}

template <class Read>
void refuse_or_read(Read&& read) {
  try {
    read();
  } catch (const Error& error) {
    if (error.code() != ExitCode::bad_input || std::string_view(error.what()).empty()) throw;
  }
}

/// A small matrix and a vector in each form, for scenes that name files.
inline void put_data(const Folder& folder) {
  folder.file("m.mtx",
              "%%MatrixMarket matrix coordinate real symmetric\n3 3 4\n1 1 2\n2 2 3\n3 3 4\n2 1 -1\n");
  folder.file("v.mtx", "%%MatrixMarket matrix array real general\n3 1\n1\n0.5\n2\n");
  if (!folder.root()) return;
  const Hdf5File file(H5Fcreate(folder.path("m.h5").c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT));
  const double entries[] = {2, -1, 0, -1, 2, -1, 0, -1, 2};
  const hsize_t square[] = {3, 3};
  const hsize_t column[] = {3};
  H5LTmake_dataset_double(file.get(), "A", 2, square, entries);
  H5LTmake_dataset_double(file.get(), "v", 1, column, entries);
}

/// Lines "#set key=value" at the head of a scene are overrides.
inline Overrides overrides_of(std::string_view text) {
  Overrides overrides;
  constexpr std::string_view mark = "#set ";
  while (text.starts_with(mark)) {
    const std::string_view line = text.substr(0, text.find('\n'));
    text.remove_prefix(std::min(text.size(), line.size() + 1));
    const std::size_t equals = line.find('=');
    if (equals == std::string_view::npos || equals == mark.size()) continue;
    overrides.emplace_back(line.substr(mark.size(), equals - mark.size()), line.substr(equals + 1));
  }
  return overrides;
}

/// @note Collective on the folder's communicator, like all that follow.
inline void scene(const Folder& folder, std::string_view bytes) {
  const std::string path = folder.file("scene.toml", bytes);
  refuse_or_read([&] {
    const Scene scene = read_scene(folder.comm(), path, overrides_of(bytes));
    expect(scene.time.steps >= 1 && scene.time.step > 0.0, "a run without steps");
  });
}

inline void problem(const Folder& folder, std::string_view bytes) {
  const std::string path = folder.file("problem.toml", bytes);
  refuse_or_read([&] {
    const Problem problem = read_problem(folder.comm(), path);
    if (!folder.root()) return;
    verify(problem.M);
    expect(problem.q.size() == static_cast<std::size_t>(problem.M.rows), "a q of another length");
  });
}

inline void matrix_market(const Folder& folder, std::string_view bytes) {
  const std::string path = folder.file("m.mtx", bytes);
  if (!folder.root()) return;
  refuse_or_read([&] { verify(read_matrix_file(path)); });
  refuse_or_read([&] { expect(!read_vector_file(path).empty(), "a vector without entries"); });
}

/// What NumPy, SciPy and PETSc write, and what gzip packs.
inline void data(const Folder& folder, std::string_view bytes) {
  const std::string path = folder.file("m.data", bytes);
  if (!folder.root()) return;
  for (const char* name : {"", "A"}) {
    refuse_or_read([&] { verify(read_matrix_file(path, name)); });
    refuse_or_read([&] { read_vector_file(path, name, true); });
  }
}

/// Every name that a seed uses, as a matrix and as a vector.
inline void hdf5(const Folder& folder, std::string_view bytes) {
  const std::string path = folder.file("m.h5", bytes);
  if (!folder.root()) return;
  for (const char* name : {"A", "g", "/"}) {
    refuse_or_read([&] { verify(read_hdf5_matrix(path, name)); });
    refuse_or_read([&] { read_hdf5_vector(path, name); });
  }
}

/// All columns, and the first alone. What does not begin like an HDF5 file is a table.
inline void recorded(const Folder& folder, std::string_view bytes) {
  const bool hdf5 = bytes.starts_with("\x89HDF");
  const std::string path = folder.file(hdf5 ? "run.h5" : "run.csv", bytes);
  refuse_or_read([&] {
    const Recorded all = read_recorded(folder.comm(), path, {});
    verify(all, all.columns);
  });
  refuse_or_read([&] { verify(read_recorded(folder.comm(), path, {0}), 1); });
}

}  // namespace sweepvi::fuzz
