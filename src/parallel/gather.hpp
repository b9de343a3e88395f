#pragma once

#include <mpi.h>

#include <cstddef>
#include <cstdint>
#include <iterator>
#include <limits>
#include <numeric>
#include <string>
#include <type_traits>
#include <vector>

#include "petsc/sparse.hpp"
#include "sweepvi/error.hpp"

namespace sweepvi {

/// An MPI type of so many bytes, for one scope.
class Contiguous {
public:
  explicit Contiguous(std::size_t size) {
    MPI_Type_contiguous(static_cast<int>(size), MPI_BYTE, &type_);
    MPI_Type_commit(&type_);
  }
  ~Contiguous() { MPI_Type_free(&type_); }
  Contiguous(const Contiguous&) = delete;
  Contiguous& operator=(const Contiguous&) = delete;
  MPI_Datatype get() const { return type_; }

private:
  MPI_Datatype type_ = MPI_DATATYPE_NULL;
};

/// A number of entries, as MPI takes it. Scenes too large for this are refused where they are read; this is
/// for what that overlooks.
/// @throws Error (internal), perhaps on this rank alone
inline int mpi_count(std::int64_t count) {
  constexpr std::int64_t most = std::numeric_limits<int>::max();
  if (count > most)
    throw Error(ExitCode::internal, std::to_string(count) +
                                        " entries are to be sent at once, and MPI counts up to " +
                                        std::to_string(most) + "; the scene is too large");
  return static_cast<int>(count);
}

/// Where pieces of these sizes start when they stand one after the other.
/// @throws Error (internal) if MPI cannot count them all
inline std::vector<int> starts_of_pieces(const std::vector<int>& counts) {
  static_cast<void>(mpi_count(std::accumulate(counts.begin(), counts.end(), std::int64_t{0})));
  std::vector<int> starts(counts.size());
  std::exclusive_scan(counts.begin(), counts.end(), starts.begin(), 0);
  return starts;
}

/// All ranks' entries, in rank order, on rank 0 (empty elsewhere). T is trivially copyable.
/// @note Collective.
template <class T>
std::vector<T> gather(MPI_Comm comm, const std::vector<T>& mine) {
  static_assert(std::is_trivially_copyable_v<T>);
  int rank = 0;
  int size = 1;
  MPI_Comm_rank(comm, &rank);
  MPI_Comm_size(comm, &size);
  const Contiguous type(sizeof(T));
  const int count = mpi_count(std::ssize(mine));
  std::vector<int> counts(static_cast<std::size_t>(size));
  MPI_Gather(&count, 1, MPI_INT, counts.data(), 1, MPI_INT, 0, comm);
  const std::vector<int> starts = starts_of_pieces(counts);
  std::vector<T> all(rank == 0 ? static_cast<std::size_t>(starts.back() + counts.back()) : 0);
  MPI_Gatherv(mine.data(), count, type.get(), all.data(), counts.data(), starts.data(), type.get(), 0, comm);
  return all;
}

/// Cuts rank 0's vector into pieces of these sizes (on rank 0 only), one for each rank. T is trivially
/// copyable.
/// @note Collective.
template <class T>
std::vector<T> scatter(MPI_Comm comm, const std::vector<T>& all, const std::vector<int>& counts) {
  static_assert(std::is_trivially_copyable_v<T>);
  int count = 0;
  MPI_Scatter(counts.data(), 1, MPI_INT, &count, 1, MPI_INT, 0, comm);
  const std::vector<int> starts = starts_of_pieces(counts);
  std::vector<T> mine(static_cast<std::size_t>(count));
  const Contiguous type(sizeof(T));
  MPI_Scatterv(all.data(), counts.data(), starts.data(), type.get(), mine.data(), count, type.get(), 0, comm);
  return mine;
}

/// Sends `to[rank]` to each rank; returns what the ranks sent to this one, in rank order. T is trivially
/// copyable.
/// @note Collective.
template <class T>
std::vector<T> all_to_all(MPI_Comm comm, const std::vector<std::vector<T>>& to) {
  static_assert(std::is_trivially_copyable_v<T>);
  std::vector<T> send;
  std::vector<int> send_counts;
  for (const std::vector<T>& piece : to) {
    send.insert(send.end(), piece.begin(), piece.end());
    send_counts.push_back(mpi_count(std::ssize(piece)));
  }
  std::vector<int> receive_counts(to.size());
  MPI_Alltoall(send_counts.data(), 1, MPI_INT, receive_counts.data(), 1, MPI_INT, comm);
  const std::vector<int> send_starts = starts_of_pieces(send_counts);
  const std::vector<int> receive_starts = starts_of_pieces(receive_counts);
  std::vector<T> received(static_cast<std::size_t>(receive_starts.back() + receive_counts.back()));
  const Contiguous type(sizeof(T));
  MPI_Alltoallv(send.data(), send_counts.data(), send_starts.data(), type.get(), received.data(),
                receive_counts.data(), receive_starts.data(), type.get(), comm);
  return received;
}

/// Rank 0's vector on every rank. @note Collective.
template <class T>
void broadcast(MPI_Comm comm, std::vector<T>& values) {
  static_assert(std::is_trivially_copyable_v<T>);
  std::size_t size = values.size();
  MPI_Bcast(&size, sizeof size, MPI_BYTE, 0, comm);
  values.resize(size);
  const Contiguous type(sizeof(T));
  MPI_Bcast(values.data(), mpi_count(std::ssize(values)), type.get(), 0, comm);
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
