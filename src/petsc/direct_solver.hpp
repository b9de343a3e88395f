#pragma once

#include "sweepvi/petsc.hpp"

namespace sweepvi {

/// Our default for linear systems, before the options database: one LU solve by MUMPS.
inline void default_to_mumps(KSP ksp) {
  PC preconditioner = nullptr;
  check(KSPSetType(ksp, KSPPREONLY));
  check(KSPGetPC(ksp, &preconditioner));
  check(PCSetType(preconditioner, PCLU));
  check(PCFactorSetMatSolverType(preconditioner, MATSOLVERMUMPS));
}

}  // namespace sweepvi
