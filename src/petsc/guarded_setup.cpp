#include "petsc/guarded_setup.hpp"

// PC's table of methods and PC::failedreason, which have no setters (PETSc 3.18).
#include <petsc/private/pcimpl.h>

#include <optional>
#include <utility>

#include "petsc/gathered_lu.hpp"
#include "petsc/petsc_text.hpp"

namespace sweepvi {

namespace {

enum class Trouble : int {
  none,
  numbers,  ///< of this matrix, or of the machine's memory: others may be solved
  misuse    ///< of the preconditioner
};

Trouble trouble_of(PetscErrorCode code) {
  switch (static_cast<int>(code)) {
    case 0:
      return Trouble::none;
    case PETSC_ERR_LIB:
    case PETSC_ERR_MEM:
    case PETSC_ERR_FP:
    case PETSC_ERR_MAT_LU_ZRPVT:
    case PETSC_ERR_MAT_CH_ZRPVT:
    case PETSC_ERR_NOT_CONVERGED:
      return Trouble::numbers;
    default:
      return Trouble::misuse;
  }
}

/// What a guarded preconditioner carries along.
struct Guard {
  PetscErrorCode (*setup)(PC) = nullptr;
  PetscErrorCode (*setup_on_blocks)(PC) = nullptr;
  PetscErrorCode (*apply)(PC, Vec, Vec) = nullptr;
  Trouble trouble = Trouble::none;  // the worst of all ranks
  std::string text;                 // of this rank
};

constexpr const char* guard_name = "sweepvi_guarded_setup";

Guard* guard_of(PC pc) {
  PetscContainer container = nullptr;
  check(PetscObjectQuery(reinterpret_cast<PetscObject>(pc), guard_name,
                         reinterpret_cast<PetscObject*>(&container)));
  if (container == nullptr) return nullptr;
  void* guard = nullptr;
  check(PetscContainerGetPointer(container, &guard));
  return static_cast<Guard*>(guard);
}

PC preconditioner_of(KSP ksp) {
  PC pc = nullptr;
  check(KSPGetPC(ksp, &pc));
  return pc;
}

PetscErrorCode take(PC pc, Guard& guard, PetscErrorCode code) {
  const Trouble mine = trouble_of(code);
  if (mine != Trouble::none) guard.text = petsc_text(code);
  int worst = static_cast<int>(mine);
  MPI_Allreduce(MPI_IN_PLACE, &worst, 1, MPI_INT, MPI_MAX,
                PetscObjectComm(reinterpret_cast<PetscObject>(pc)));
  if (worst > static_cast<int>(guard.trouble)) guard.trouble = static_cast<Trouble>(worst);
  if (guard.trouble != Trouble::none && pc->failedreason == PC_NOERROR) pc->failedreason = PC_FACTOR_OTHER;
  return static_cast<PetscErrorCode>(0);  // an enumeration in newer PETSc
}

void guard_methods(PC pc, Guard& guard);

PetscErrorCode guarded_setup(PC pc) {
  Guard& guard = *guard_of(pc);
  guard.trouble = Trouble::none;
  guard.text.clear();
  pc->failedreason = PC_NOERROR;
  const PetscErrorCode code = guard.setup == nullptr ? static_cast<PetscErrorCode>(0) : guard.setup(pc);
  guard_methods(pc, guard);  // some are chosen when a preconditioner is set up
  return take(pc, guard, code);
}

PetscErrorCode guarded_setup_on_blocks(PC pc) {
  Guard& guard = *guard_of(pc);
  if (guard.trouble != Trouble::none) return static_cast<PetscErrorCode>(0);
  return take(pc, guard, guard.setup_on_blocks(pc));
}

// KSPPREONLY asks whether the setup failed only after it has applied what there is.
PetscErrorCode guarded_apply(PC pc, Vec x, Vec y) {
  const Guard& guard = *guard_of(pc);
  return guard.trouble == Trouble::none ? guard.apply(pc, x, y) : VecSet(y, PETSC_INFINITY);
}

void guard_methods(PC pc, Guard& guard) {
  if (pc->ops->setup != guarded_setup) guard.setup = std::exchange(pc->ops->setup, guarded_setup);
  if (pc->ops->setuponblocks != nullptr && pc->ops->setuponblocks != guarded_setup_on_blocks)
    guard.setup_on_blocks = std::exchange(pc->ops->setuponblocks, guarded_setup_on_blocks);
  if (pc->ops->apply != nullptr && pc->ops->apply != guarded_apply)
    guard.apply = std::exchange(pc->ops->apply, guarded_apply);
}

PetscErrorCode delete_guard(void* guard) {
  delete static_cast<Guard*>(guard);
  return static_cast<PetscErrorCode>(0);
}

bool is_of_type(PC pc, const char* type) {
  PetscBool same = PETSC_FALSE;
  check(PetscObjectTypeCompare(reinterpret_cast<PetscObject>(pc), type, &same));
  return same == PETSC_TRUE;
}

}  // namespace

void guard_setup(KSP ksp) {
  PC pc = preconditioner_of(ksp);
  if (pc->ops->setup == guarded_setup) return;
  auto* guard = new Guard;
  PetscContainer container = nullptr;
  check(PetscContainerCreate(PetscObjectComm(reinterpret_cast<PetscObject>(pc)), &container));
  check(PetscContainerSetPointer(container, guard));
  check(PetscContainerSetUserDestroy(container, delete_guard));
  check(PetscObjectCompose(reinterpret_cast<PetscObject>(pc), guard_name,
                           reinterpret_cast<PetscObject>(container)));
  check(PetscContainerDestroy(&container));
  guard_methods(pc, *guard);
}

void check_setup(KSP ksp) {
  PC pc = preconditioner_of(ksp);
  const Guard* guard = guard_of(pc);
  if (guard == nullptr || guard->trouble != Trouble::misuse) return;
  PCType type = nullptr;
  check(PCGetType(pc, &type));
  std::optional<Error> complaint;
  if (!guard->text.empty())
    complaint = InputError(std::string("-pc_type ") + type + " cannot be set up for the matrices of steps: " +
                           guard->text + "; choose another, or give it the options that it asks for");
  agree(PetscObjectComm(reinterpret_cast<PetscObject>(pc)), complaint);
}

std::string setup_error(KSP ksp) {
  const Guard* guard = guard_of(preconditioner_of(ksp));
  return guard == nullptr ? std::string() : guard->text;
}

void try_preconditioner(KSP ksp, Mat matrix) {
  PC pc = preconditioner_of(ksp);
  if (is_of_type(pc, PCLU) || is_of_type(pc, PCCHOLESKY) || is_of_type(pc, gathered_lu_type)) return;
  Matrix stand_in;
  check(MatDuplicate(matrix, MAT_DO_NOT_COPY_VALUES, stand_in.put()));
  check(MatShift(stand_in.get(), 1.0));
  LinearSolver trial;
  const char* prefix = nullptr;
  check(KSPGetOptionsPrefix(ksp, &prefix));
  check(KSPCreate(PetscObjectComm(reinterpret_cast<PetscObject>(ksp)), trial.put()));
  check(KSPSetOptionsPrefix(trial.get(), prefix));
  check(KSPSetOperators(trial.get(), stand_in.get(), stand_in.get()));
  check_options(KSPSetFromOptions(trial.get()));
  check(KSPSetErrorIfNotConverged(trial.get(), PETSC_FALSE));
  guard_setup(trial.get());
  check(PCSetUp(preconditioner_of(trial.get())));
  if (guard_of(preconditioner_of(trial.get()))->trouble == Trouble::none)
    check(PCSetUpOnBlocks(preconditioner_of(trial.get())));
  check_setup(trial.get());
}

}  // namespace sweepvi
