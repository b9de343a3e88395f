#pragma once

#include "sweepvi/petsc.hpp"

namespace sweepvi {

/// Room for the pivots that MUMPS delays, in percent of what it foresees. Rows of multipliers have no
/// diagonal: with its own 20 % many touching constraints run out of it (INFOG(1) = -9).
inline void leave_room_for_pivots() {
  constexpr const char* name = "-mat_mumps_icntl_14";  // PETSc has no other way to set it for good
  PetscBool given = PETSC_FALSE;
  check(PetscOptionsHasName(nullptr, nullptr, name, &given));
  if (given == PETSC_TRUE) return;
  check(PetscOptionsSetValue(nullptr, name, "100"));
  check(PetscOptionsHasName(nullptr, nullptr, name, &given));  // so that nobody reports it as unused
}

/// Our default for linear systems, before the options database: one LU solve by MUMPS.
inline void default_to_mumps(KSP ksp) {
  leave_room_for_pivots();
  PC preconditioner = nullptr;
  check(KSPSetType(ksp, KSPPREONLY));
  check(KSPGetPC(ksp, &preconditioner));
  check(PCSetType(preconditioner, PCLU));
  check(PCFactorSetMatSolverType(preconditioner, MATSOLVERMUMPS));
}

}  // namespace sweepvi
