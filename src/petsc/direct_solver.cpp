#include "petsc/direct_solver.hpp"

#include <petsc/private/pcimpl.h>

#include <algorithm>
#include <array>
#include <iterator>
#include <sstream>
#include <string>
#include <utility>

#include "petsc/gathered_lu.hpp"
#include "petsc/guarded_setup.hpp"

namespace sweepvi {

namespace {

// The factorization of a matrix shall not depend on those that went before: results would depend on where a
// run was stopped and went on. So analysis sees the pattern only, no maximum transversal (icntl_6), and rows
// and columns are scaled anew with each factorization (icntl_8 = 7; MUMPS's automatic choice is made at
// analysis). Quasi-dense AMD (icntl_7) orders chains several times faster than METIS.
constexpr std::array<std::pair<const char*, const char*>, 3> mumps_defaults = {
    {{"-mat_mumps_icntl_6", "0"}, {"-mat_mumps_icntl_7", "6"}, {"-mat_mumps_icntl_8", "7"}}};

// Nobody needs to hear that an option of ours was not used.
void set_quietly(const char* name, const std::string& value) {
  PetscBool found = PETSC_FALSE;
  check(PetscOptionsSetValue(nullptr, name, value.c_str()));
  check(PetscOptionsHasName(nullptr, nullptr, name, &found));
}

// Not PetscOptionsHasName: that would count as use.
bool is_set(const char* name) {
  char* all = nullptr;
  check(PetscOptionsGetAll(nullptr, &all));
  std::istringstream words(all);
  check(PetscFree(all));
  const std::istream_iterator<std::string> end;
  return std::find(std::istream_iterator<std::string>(words), end, name) != end;
}

bool several_ranks(KSP ksp) {
  int size = 1;
  MPI_Comm_size(PetscObjectComm(reinterpret_cast<PetscObject>(ksp)), &size);
  return size > 1;
}

}  // namespace

void default_to_mumps(KSP ksp) {
  PC preconditioner = nullptr;
  const char* prefix = nullptr;
  PetscBool chosen = PETSC_FALSE;
  for (const auto& [name, value] : mumps_defaults)
    if (!is_set(name)) set_quietly(name, value);
  register_gathered_lu();
  check(KSPSetType(ksp, KSPPREONLY));
  check(KSPGetPC(ksp, &preconditioner));
  check(KSPGetOptionsPrefix(ksp, &prefix));
  check(PetscOptionsHasName(nullptr, prefix, "-pc_type", &chosen));
  if (several_ranks(ksp) && chosen == PETSC_FALSE) {
    check(PCSetType(preconditioner, gathered_lu_type));
  } else {
    check(PCSetType(preconditioner, PCLU));
    check(PCFactorSetMatSolverType(preconditioner, MATSOLVERMUMPS));
  }
}

void configure(KSP ksp) {
  default_to_mumps(ksp);
  check_options(KSPSetFromOptions(ksp));
  check(KSPSetErrorIfNotConverged(ksp, PETSC_FALSE));
  guard_setup(ksp);
}

void check_factorization(PC pc, Mat matrix) {
  PC lu = sequential_lu(pc);
  Matrix stand_in;  // sequential, as what will be factored
  if (lu != nullptr) {
    check(MatCreateSeqAIJ(PETSC_COMM_SELF, 0, 0, 0, nullptr, stand_in.put()));
    matrix = stand_in.get();
  } else {
    PetscBool is_lu = PETSC_FALSE;
    check(PetscObjectTypeCompare(reinterpret_cast<PetscObject>(pc), PCLU, &is_lu));
    if (is_lu == PETSC_FALSE) return;
    lu = pc;
  }
  MatSolverType package = nullptr;
  check(PCFactorGetMatSolverType(lu, &package));
  PetscBool available = PETSC_TRUE;
  if (package != nullptr) check(MatGetFactorAvailable(matrix, package, MAT_FACTOR_LU, &available));
  if (available == PETSC_FALSE)
    throw InputError(
        std::string("-pc_factor_mat_solver_type ") + package +
        " cannot factor this matrix: PETSc has no such package, or it is a serial one; use mumps");
}

namespace {

// Percent of workspace beyond what MUMPS foresees. Through the options database, because factor objects come
// and go.
bool enlarge_workspace() {
  constexpr const char* name = "-mat_mumps_icntl_14";
  constexpr PetscInt least = 20;  // MUMPS's own
  constexpr PetscInt largest = 5000;
  PetscInt percent = least;
  PetscBool given = PETSC_FALSE;
  check(PetscOptionsGetInt(nullptr, nullptr, name, &percent, &given));
  if (percent >= largest) return false;
  set_quietly(name, std::to_string(std::max(5 * percent, least)));
  return true;
}

}  // namespace

double mumps_flops(KSP ksp) {
  double flops = 0.0;
#if defined(PETSC_HAVE_MUMPS)
  PC preconditioner = nullptr;
  check(KSPGetPC(ksp, &preconditioner));
  PC inner = sequential_lu(preconditioner);
  PC lu = inner != nullptr ? inner : preconditioner;
  PetscBool is_lu = PETSC_FALSE;
  check(PetscObjectTypeCompare(reinterpret_cast<PetscObject>(lu), PCLU, &is_lu));
  MatSolverType package = nullptr;
  if (is_lu == PETSC_TRUE) check(PCFactorGetMatSolverType(lu, &package));
  if (lu->setupcalled != 0 && package != nullptr && std::string(package) == MATSOLVERMUMPS) {
    constexpr PetscInt elimination = 3;
    Mat factor = nullptr;
    check(PCFactorGetMatrix(lu, &factor));
    if (factor != nullptr) check(MatMumpsGetRinfog(factor, elimination, &flops));
  }
  MPI_Comm comm = PetscObjectComm(reinterpret_cast<PetscObject>(ksp));
  MPI_Allreduce(MPI_IN_PLACE, &flops, 1, MPI_DOUBLE, MPI_MAX, comm);
#else
  static_cast<void>(ksp);
#endif
  return flops;
}

PCFailedReason failed_reason(KSP ksp) {
  PC preconditioner = nullptr;
  PCFailedReason reason = PC_NOERROR;
  check(KSPGetPC(ksp, &preconditioner));
  check(PCGetFailedReason(preconditioner, &reason));
  return reason;
}

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
    check_setup(ksp);
    again = recover(ksp);
    check(KSPSetOperators(ksp, matrix, matrix));
  }
  return false;
}

}  // namespace sweepvi
