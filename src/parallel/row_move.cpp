#include "parallel/row_move.hpp"

#include <algorithm>
#include <numeric>

#include "parallel/gather.hpp"

namespace sweepvi {

namespace {

/// First row of each rank, and the end of the last one's.
std::vector<PetscInt> row_starts(MPI_Comm comm, PetscInt count) {
  int ranks = 1;
  MPI_Comm_size(comm, &ranks);
  std::vector<PetscInt> starts(static_cast<std::size_t>(ranks) + 1, 0);
  MPI_Allgather(&count, 1, MPIU_INT, &starts[1], 1, MPIU_INT, comm);
  std::partial_sum(starts.begin(), starts.end(), starts.begin());
  return starts;
}

PetscInt first_row(MPI_Comm comm, PetscInt count) {
  int rank = 0;
  MPI_Comm_rank(comm, &rank);
  return row_starts(comm, count)[static_cast<std::size_t>(rank)];
}

}  // namespace

RowMove::RowMove(MPI_Comm comm, PetscInt old_count, const std::vector<PetscInt>& rows)
    : comm_(comm), old_count_(old_count) {
  const auto count = static_cast<PetscInt>(rows.size());
  check(ISCreateGeneral(comm, count, rows.data(), PETSC_COPY_VALUES, rows_.put()));
  PetscLayout layout = nullptr;
  check(PetscLayoutCreateFromSizes(comm, old_count, PETSC_DETERMINE, 1, &layout));
  check(PetscSFCreate(comm, forest_.put()));
  check(PetscSFSetGraphLayout(forest_.get(), layout, count, nullptr, PETSC_OWN_POINTER, rows.data()));
  check(PetscLayoutDestroy(&layout));
}

std::size_t RowMove::count() const {
  PetscInt count = 0;
  check(ISGetLocalSize(rows_.get(), &count));
  return static_cast<std::size_t>(count);
}

void RowMove::bring(const void* old_values, void* new_values, std::size_t value_size) const {
  const Contiguous type(value_size);
  check(PetscSFBcastBegin(forest_.get(), type.get(), old_values, new_values, MPI_REPLACE));
  check(PetscSFBcastEnd(forest_.get(), type.get(), old_values, new_values, MPI_REPLACE));
}

bool RowMove::moves() const {
  PetscInt stays = first_row(comm_, old_count_);
  int moves = static_cast<PetscInt>(count()) != old_count_ ? 1 : 0;
  for (const PetscInt number : new_numbers())
    if (number != stays++) moves = 1;
  MPI_Allreduce(MPI_IN_PLACE, &moves, 1, MPI_INT, MPI_LOR, comm_);
  return moves != 0;
}

Vector RowMove::moved(Vec vector) const {
  Vector result = make_vector(comm_, static_cast<PetscInt>(count()));
  const ReadArray old_values(vector);
  const WriteArray new_values(result.get());
  bring(old_values.data(), new_values.data(), sizeof(double));
  return result;
}

std::vector<PetscInt> RowMove::new_numbers() const {
  std::vector<PetscInt> mine(count());
  std::iota(mine.begin(), mine.end(), first_row(comm_, static_cast<PetscInt>(mine.size())));
  std::vector<PetscInt> numbers(static_cast<std::size_t>(old_count_));
  check(PetscSFReduceBegin(forest_.get(), MPIU_INT, mine.data(), numbers.data(), MPI_REPLACE));
  check(PetscSFReduceEnd(forest_.get(), MPIU_INT, mine.data(), numbers.data(), MPI_REPLACE));
  return numbers;
}

Matrix moved(Mat matrix, const RowMove& rows, const RowMove& columns) {
  Matrix result;
  check(
      MatCreateSubMatrix(matrix, rows.rows().get(), columns.rows().get(), MAT_INITIAL_MATRIX, result.put()));
  return result;
}

namespace {

std::vector<Forcing::Entry> moved(MPI_Comm comm, const std::vector<Forcing::Entry>& entries,
                                  const std::vector<PetscInt>& new_numbers,
                                  const std::vector<PetscInt>& starts) {
  std::vector<std::vector<Forcing::Entry>> to(starts.size() - 1);
  for (const Forcing::Entry& entry : entries) {
    const PetscInt row = new_numbers[static_cast<std::size_t>(entry.local)];
    const auto owner = std::upper_bound(starts.begin(), starts.end(), row) - starts.begin() - 1;
    const auto rank = static_cast<std::size_t>(owner);
    to[rank].push_back({row - starts[rank], entry.signal});
  }
  return all_to_all(comm, to);
}

}  // namespace

Forcing moved(MPI_Comm comm, const Forcing& forcing, const RowMove& rows) {
  PetscInt count = 0;
  check(ISGetLocalSize(rows.rows().get(), &count));
  const std::vector<PetscInt> starts = row_starts(comm, count);
  const std::vector<PetscInt> new_numbers = rows.new_numbers();
  Forcing result = forcing;
  result.constant = moved(comm, forcing.constant, new_numbers, starts);
  result.varying = moved(comm, forcing.varying, new_numbers, starts);
  return result;
}

}  // namespace sweepvi
