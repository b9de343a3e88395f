#pragma once

#include <string>

#include "sweepvi/petsc.hpp"

namespace sweepvi {

/// Makes errors raised while the preconditioner of `ksp` is set up, by PETSc or by the package that the user
/// chose, failures of the linear system (KSP_DIVERGED_PC_FAILED), on all ranks alike: a serial package finds
/// the matrix of one rank singular (KLU raises an error then), memory runs out, blocks cannot be factored.
/// After KSPSetFromOptions; to be repeated where the type of the preconditioner changes.
/// @note Collective. A setup that fails on one rank in the midst of its own collective calls still hangs.
void guard_setup(KSP ksp);

/// @throws Error (bad_input) on all ranks if the last guarded setup of `ksp` failed because the
/// preconditioner cannot be used like that at all, whatever the matrix's numbers: splits that are not given,
/// a package for other matrices. @note Collective.
void check_setup(KSP ksp);

/// PETSc's words on the last guarded setup of `ksp` that raised an error on this rank; or empty.
std::string setup_error(KSP ksp);

/// Sets up the preconditioner that the options choose for a matrix with the pattern of `matrix`, and forgets
/// it, unless it is a factorization, which would cost too much (check_factorization is for those).
/// @throws Error (bad_input) as check_setup does @note Collective.
void try_preconditioner(KSP ksp, Mat matrix);

}  // namespace sweepvi
