#include "io/recorded.hpp"

#include <filesystem>

#include "parallel/gather.hpp"
#include "sweepvi/error.hpp"

namespace sweepvi {

namespace {

namespace fs = std::filesystem;

void check_path(const std::string& path) {
  std::error_code failure;
  constexpr const char* suffix = ".partial";
  if (path.ends_with(suffix))
    throw InputError(path +
                     " is being written by a run, or was left by one that was killed; wait until it has "
                     "taken its name, or go on with --restart " +
                     path.substr(0, path.size() - std::string(suffix).size()) + ".checkpoint");
  if (fs::is_directory(path, failure)) throw InputError(path + " is a folder; name a file");
  if (fs::exists(path, failure)) return;
  if (fs::exists(path + suffix, failure))
    throw InputError(path + ": there is no such file yet, only " + path +
                     ".partial: its run is not done, or was killed; wait, or go on with --restart " + path +
                     ".checkpoint");
  throw InputError(path + ": there is no such file");
}

}  // namespace

void check_columns(const std::string& path, const std::vector<std::int64_t>& columns, std::size_t count) {
  for (const std::int64_t column : columns)
    if (column < 0 || static_cast<std::size_t>(column) >= count)
      throw InputError(path + " has no column " + std::to_string(column) + "; its columns are 0 to " +
                       std::to_string(count - 1));
}

Recorded read_recorded(MPI_Comm comm, const std::string& path, const std::vector<std::int64_t>& columns) {
  int rank = 0, ranks = 1;
  MPI_Comm_rank(comm, &rank);
  MPI_Comm_size(comm, &ranks);
  Recorded recorded;
  agreed(comm, [&] {
    check_path(path);
    recorded = path.ends_with(".csv") ? read_table(path, columns) : read_run(path, columns, rank, ranks);
  });
  recorded.path = path;
  if (recorded.measures) {
    std::vector<double>& sums = recorded.measures->sums;
    MPI_Allreduce(MPI_IN_PLACE, sums.data(), mpi_count(std::ssize(sums)), MPI_DOUBLE, MPI_SUM, comm);
  }
  return recorded;
}

}  // namespace sweepvi
