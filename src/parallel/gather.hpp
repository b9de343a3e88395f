#pragma once

#include <mpi.h>

#include <cstddef>
#include <limits>
#include <type_traits>
#include <vector>

#include "petsc/sparse.hpp"

namespace sweepvi {

/// All ranks' entries, in rank order, on rank 0 (empty elsewhere). T is trivially copyable.
/// @note Collective.
template <class T>
std::vector<T> gather(MPI_Comm comm, const std::vector<T>& mine) {
  static_assert(std::is_trivially_copyable_v<T>);
  int rank = 0;
  int size = 1;
  MPI_Comm_rank(comm, &rank);
  MPI_Comm_size(comm, &size);
  MPI_Datatype type = MPI_DATATYPE_NULL;
  MPI_Type_contiguous(static_cast<int>(sizeof(T)), MPI_BYTE, &type);
  MPI_Type_commit(&type);
  const int count = static_cast<int>(mine.size());
  std::vector<int> counts(static_cast<std::size_t>(size));
  MPI_Gather(&count, 1, MPI_INT, counts.data(), 1, MPI_INT, 0, comm);
  std::vector<int> starts(static_cast<std::size_t>(size), 0);
  std::size_t total = 0;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    starts[i] = static_cast<int>(total);
    total += static_cast<std::size_t>(counts[i]);
  }
  std::vector<T> all(rank == 0 ? total : 0);
  MPI_Gatherv(mine.data(), count, type, all.data(), counts.data(), starts.data(), type, 0, comm);
  MPI_Type_free(&type);
  return all;
}

/// Rank 0's vector on every rank. @note Collective.
template <class T>
void broadcast(MPI_Comm comm, std::vector<T>& values) {
  static_assert(std::is_trivially_copyable_v<T>);
  std::size_t size = values.size();
  MPI_Bcast(&size, sizeof size, MPI_BYTE, 0, comm);
  values.resize(size);
  MPI_Datatype type = MPI_DATATYPE_NULL;
  MPI_Type_contiguous(static_cast<int>(sizeof(T)), MPI_BYTE, &type);
  MPI_Type_commit(&type);
  MPI_Bcast(values.data(), static_cast<int>(size), type, 0, comm);
  MPI_Type_free(&type);
}

struct Triplet {
  PetscInt row, column;
  double value;
};

/// A whole sparse matrix on rank 0 (empty elsewhere), for analyses of small or weakly coupled matrices. @note
/// Collective.
inline std::vector<Triplet> gather_entries(Mat matrix) {
  std::vector<Triplet> mine;
  for_each_row(matrix, [&](PetscInt row, auto columns, auto values) {
    for (std::size_t k = 0; k < columns.size(); ++k)
      mine.push_back({row, columns[k], values[k]});
  });
  return gather(PetscObjectComm(reinterpret_cast<PetscObject>(matrix)), mine);
}

}  // namespace sweepvi
