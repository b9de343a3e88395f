#pragma once

#include "io/scene.hpp"
#include "sweepvi/lagrangian.hpp"
#include "sweepvi/linear_system.hpp"

namespace sweepvi {

/// The linear system a scene describes; rows dealt out in order. A file's matrices come from rank 0. The
/// scene's own copy is emptied. @note Collective on `comm`.
LinearSystem make_linear_system(MPI_Comm comm, Scene& scene);

/// The Lagrangian system a scene describes: `kind = "lagrangian"`, or a chain whose element has a mass. As
/// above. @throws Error (bad_input) on every rank if a chain's numbers make no mechanical system
LagrangianSystem make_lagrangian_system(MPI_Comm comm, Scene& scene);

/// Deals a sparse matrix on rank 0 out by rows; this rank gets `local_rows` of them. `full_diagonal` makes
/// room for diagonal entries that are zero, as solvers of square systems need it. @note Collective.
Matrix scatter_rows(MPI_Comm comm, const SparseEntries& whole, PetscInt local_rows, PetscInt local_columns,
                    bool full_diagonal = false);
/// Deals a vector on rank 0 out. @note Collective.
Vector scatter_vector(MPI_Comm comm, const std::vector<double>& whole, PetscInt local_size);

}  // namespace sweepvi
