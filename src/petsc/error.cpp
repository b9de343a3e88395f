#include "sweepvi/error.hpp"

#include <vector>

namespace sweepvi {

void agree(MPI_Comm comm, const std::optional<Error>& complaint) {
  int rank = 0;
  int size = 1;
  MPI_Comm_rank(comm, &rank);
  MPI_Comm_size(comm, &size);
  const int mine = complaint ? rank : size;
  int lowest = size;
  MPI_Allreduce(&mine, &lowest, 1, MPI_INT, MPI_MIN, comm);
  if (lowest == size) return;

  int header[2] = {0, 0};  // exit code, length of the message
  std::string message;
  if (rank == lowest) {
    message = complaint->what();
    header[0] = static_cast<int>(complaint->code());
    header[1] = static_cast<int>(message.size());
  }
  MPI_Bcast(header, 2, MPI_INT, lowest, comm);
  message.resize(static_cast<std::size_t>(header[1]));
  MPI_Bcast(message.data(), header[1], MPI_CHAR, lowest, comm);
  throw Error(static_cast<ExitCode>(header[0]), message);
}

}  // namespace sweepvi
