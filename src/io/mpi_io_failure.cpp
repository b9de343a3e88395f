#include "io/mpi_io_failure.hpp"

#include <cerrno>
#include <cstdio>
#include <cstring>

#include "io/printable.hpp"
#include "sweepvi/error.hpp"

namespace sweepvi {

namespace {

MPI_Comm waiting = MPI_COMM_NULL;  // those who would wait; null: nobody
std::string file_name;
std::string left_behind;

/// @param reason  errno; 0: unknown
void end_all(int reason) {
  int rank = 0;
  MPI_Comm_rank(waiting, &rank);
  std::fprintf(stderr, "sweepvi: [rank %d] cannot write %s: %s; check the space and permissions there%s\n",
               rank, printable(file_name).c_str(), reason != 0 ? std::strerror(reason) : "MPI-IO failed",
               printable(left_behind).c_str());
  MPI_Abort(waiting, static_cast<int>(ExitCode::output));
}

/// Some MPI-IO reports success and fewer bytes.
void look_at(int code, int count, MPI_Datatype type, const MPI_Status* status) {
  if (waiting == MPI_COMM_NULL) return;
  int size = 0;
  int written = 0;
  MPI_Type_size(type, &size);
  MPI_Get_elements(status, MPI_BYTE, &written);
  if (code != MPI_SUCCESS || written != count * size) end_all(errno);
}

}  // namespace

// What HDF5 calls, by the profiling interface of MPI.
extern "C" {

int MPI_File_open(MPI_Comm comm, const char* name, int mode, MPI_Info info, MPI_File* file) {
  const int code = PMPI_File_open(comm, name, mode, info, file);
  if (code != MPI_SUCCESS && waiting != MPI_COMM_NULL) end_all(0);
  return code;
}

int MPI_File_write_at(MPI_File file, MPI_Offset at, const void* bytes, int count, MPI_Datatype type,
                      MPI_Status* status) {
  const int code = PMPI_File_write_at(file, at, bytes, count, type, status);
  look_at(code, count, type, status);
  return code;
}

int MPI_File_write_at_all(MPI_File file, MPI_Offset at, const void* bytes, int count, MPI_Datatype type,
                          MPI_Status* status) {
  const int code = PMPI_File_write_at_all(file, at, bytes, count, type, status);
  look_at(code, count, type, status);
  return code;
}
}

EndAtMpiIoFailure::EndAtMpiIoFailure(MPI_Comm comm, const std::string& path) {
  int ranks = 1;
  MPI_Comm_size(comm, &ranks);
  if (ranks == 1) return;
  file_name = path;
  waiting = comm;
  errno = 0;
}

EndAtMpiIoFailure::~EndAtMpiIoFailure() {
  waiting = MPI_COMM_NULL;
}

void EndAtMpiIoFailure::say(const std::string& kept) {
  left_behind = kept;
}

}  // namespace sweepvi
