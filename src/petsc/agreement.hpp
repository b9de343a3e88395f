#pragma once

#include <mpi.h>

namespace sweepvi {

/// Whether it holds on some rank. @note Collective.
inline bool anywhere(MPI_Comm comm, bool here) {
  int found = here ? 1 : 0;
  MPI_Allreduce(MPI_IN_PLACE, &found, 1, MPI_INT, MPI_LOR, comm);
  return found != 0;
}

}  // namespace sweepvi
