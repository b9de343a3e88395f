#pragma once

#include <mpi.h>

#include <algorithm>
#include <cstddef>

namespace sweepvi {

/// The part [first, last) of n things that a rank works on.
struct Slab {
  std::size_t first, last;
  Slab(MPI_Comm comm, std::size_t n) {
    int rank = 0, size = 1;
    MPI_Comm_rank(comm, &rank);
    MPI_Comm_size(comm, &size);
    const auto r = static_cast<std::size_t>(rank), s = static_cast<std::size_t>(size);
    first = n / s * r + std::min(r, n % s);
    last = first + n / s + (r < n % s ? 1 : 0);
  }
};

}  // namespace sweepvi
