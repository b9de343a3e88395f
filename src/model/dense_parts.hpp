#pragma once

#include <vector>

#include "petsc/sparse.hpp"

namespace sweepvi {

/// This rank's rows of `total`, dealt out in order. @note Collective.
LocalRange share(MPI_Comm comm, PetscInt total);

/// Rows [range) of a matrix given in full, row-major. @note Collective.
Matrix rows_of(MPI_Comm comm, const std::vector<double>& values, LocalRange range, PetscInt columns,
               PetscInt local_columns);

/// Entries [range) of a vector given in full; empty: zero. @note Collective.
Vector part_of(MPI_Comm comm, const std::vector<double>& values, LocalRange range);

/// range.first, range.first + 1, ...
std::vector<PetscInt> numbers(LocalRange range);

}  // namespace sweepvi
