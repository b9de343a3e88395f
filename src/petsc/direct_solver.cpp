#include "petsc/direct_solver.hpp"

#include <string>

namespace sweepvi {

void default_to_mumps(KSP ksp) {
  PC preconditioner = nullptr;
  check(KSPSetType(ksp, KSPPREONLY));
  check(KSPGetPC(ksp, &preconditioner));
  check(PCSetType(preconditioner, PCLU));
  check(PCFactorSetMatSolverType(preconditioner, MATSOLVERMUMPS));
}

namespace {

// Percent of workspace beyond what MUMPS foresees. Through the options database, because factor objects come
// and go.
bool enlarge_workspace() {
  constexpr const char* name = "-mat_mumps_icntl_14";
  constexpr PetscInt largest = 5000;
  PetscInt percent = 20;  // MUMPS's own
  PetscBool given = PETSC_FALSE;
  check(PetscOptionsGetInt(nullptr, nullptr, name, &percent, &given));
  if (percent >= largest) return false;
  check(PetscOptionsSetValue(nullptr, name, std::to_string(5 * percent).c_str()));
  check(PetscOptionsHasName(nullptr, nullptr, name, &given));  // nobody needs to hear that it was unused
  return true;
}

}  // namespace

bool recover(KSP ksp) {
  PC preconditioner = nullptr;
  PCFailedReason reason = PC_NOERROR;
  check(KSPGetPC(ksp, &preconditioner));
  check(PCGetFailedReason(preconditioner, &reason));
  check(KSPReset(ksp));
  return reason == PC_FACTOR_OUTMEMORY && enlarge_workspace();
}

bool solve(KSP ksp, Mat matrix, Vec right, Vec solution) {
  for (bool again = true; again;) {
    check(KSPSolve(ksp, right, solution));
    KSPConvergedReason reason = KSP_CONVERGED_ITERATING;
    check(KSPGetConvergedReason(ksp, &reason));
    if (reason > 0) return true;
    again = recover(ksp);
    check(KSPSetOperators(ksp, matrix, matrix));
  }
  return false;
}

}  // namespace sweepvi
