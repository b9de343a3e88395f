#pragma once

#include "sweepvi/petsc.hpp"

namespace sweepvi {

/// The PC type "gathered": the matrix is gathered on rank 0, factored there by a sequential LU, and solutions
/// are dealt out again.
///
/// Unlike a parallel factorization, whose ranks add up messages as they arrive, it gives the same bits in
/// every run. On chains it costs no more either: their elimination trees are too thin to share. The
/// sequential LU is PETSc's PCLU with MUMPS and reads its options (-pc_factor_mat_solver_type,
/// -pc_factor_mat_ordering_type, -mat_mumps_*), so that serial packages work on any number of ranks. While
/// the nonzero pattern stays, only values travel and the symbolic factorization is kept.
///
/// Fails as PCLU does, on all ranks alike: PCGetFailedReason, or an error code.
inline constexpr const char* gathered_lu_type = "gathered";

/// Makes the type known to PETSc; may be called again.
void register_gathered_lu();

/// The sequential PCLU inside, null if `pc` is of another type. Every rank has one; rank 0's is at work.
PC sequential_lu(PC pc);

}  // namespace sweepvi
