#include "model/dense_parts.hpp"

#include <algorithm>
#include <numeric>

namespace sweepvi {

LocalRange share(MPI_Comm comm, PetscInt total) {
  PetscInt local = PETSC_DECIDE;
  check(PetscSplitOwnership(comm, &local, &total));
  PetscInt last = 0;
  MPI_Scan(&local, &last, 1, MPIU_INT, MPI_SUM, comm);
  return {last - local, last};
}

Matrix rows_of(MPI_Comm comm, const std::vector<double>& values, LocalRange range, PetscInt columns,
               PetscInt local_columns) {
  RowBuilder builder;
  for (PetscInt i = range.first; i < range.last; ++i) {
    for (PetscInt j = 0; j < columns; ++j) {
      const double value = values[static_cast<std::size_t>(i) * static_cast<std::size_t>(columns) +
                                  static_cast<std::size_t>(j)];
      if (value != 0.0) builder.add(j, value);
    }
    builder.end_row();
  }
  return builder.finish(comm, local_columns);
}

Vector part_of(MPI_Comm comm, const std::vector<double>& values, LocalRange range) {
  Vector part = make_vector(comm, range.size());
  if (values.empty()) return part;
  const WriteArray entries(part.get());
  std::copy_n(values.begin() + range.first, range.size(), entries.data());
  return part;
}

std::vector<PetscInt> numbers(LocalRange range) {
  std::vector<PetscInt> result(static_cast<std::size_t>(range.size()));
  std::iota(result.begin(), result.end(), range.first);
  return result;
}

}  // namespace sweepvi
