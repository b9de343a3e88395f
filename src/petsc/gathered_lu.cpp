#include "petsc/gathered_lu.hpp"

#include <petsc/private/pcimpl.h>

#include <algorithm>
#include <array>
#include <limits>
#include <vector>

#include "parallel/gather.hpp"
#include "petsc/sparse.hpp"

namespace sweepvi {

namespace {

using Preconditioner = Handle<PC, PCDestroy>;

/// Behind a PC of our type.
class GatheredLu {
public:
  GatheredLu() {
    check(PCCreate(PETSC_COMM_SELF, lu_.put()));
    check(PCSetType(lu_.get(), PCLU));
    check(PCFactorSetMatSolverType(lu_.get(), MATSOLVERMUMPS));
  }

  PC lu() const { return lu_.get(); }

  void reset() {
    check(PCReset(lu_.get()));
    for (Vector* vector : {&right_, &solution_})
      vector->reset();
    gathering_.reset();
    matrix_.reset();
  }

  /// @return why the factorization failed, the same on all ranks
  PCFailedReason factor(Mat distributed, bool same_pattern) {
    const MPI_Comm comm = PetscObjectComm(reinterpret_cast<PetscObject>(distributed));
    PetscInt size = 0;
    check(MatGetSize(distributed, &size, nullptr));
    empty_ = size == 0;
    if (!same_pattern || !gathering_) gather_pattern(comm, distributed);
    gather_values(comm, distributed);
    PCFailedReason reason = PC_NOERROR;
    return static_cast<PCFailedReason>(on_root(
        comm,
        [&] {
          const PetscErrorCode code = PCSetUp(lu_.get());
          return code == 0 ? PCGetFailedReason(lu_.get(), &reason) : code;
        },
        [&] { return static_cast<int>(reason); }));
  }

  /// @param solver  PCApply or PCApplyTranspose
  void solve(Vec right, Vec solution, PetscErrorCode (*solver)(PC, Vec, Vec)) {
    const MPI_Comm comm = PetscObjectComm(reinterpret_cast<PetscObject>(right));
    check(VecScatterBegin(gathering_.get(), right, right_.get(), INSERT_VALUES, SCATTER_FORWARD));
    check(VecScatterEnd(gathering_.get(), right, right_.get(), INSERT_VALUES, SCATTER_FORWARD));
    on_root(
        comm, [&] { return solver(lu_.get(), right_.get(), solution_.get()); }, [] { return 0; });
    check(VecScatterBegin(gathering_.get(), solution_.get(), solution, INSERT_VALUES, SCATTER_REVERSE));
    check(VecScatterEnd(gathering_.get(), solution_.get(), solution, INSERT_VALUES, SCATTER_REVERSE));
  }

private:
  /// Runs `work` where the matrix is; an error there is one on every rank. @return rank 0's result
  template <class Work, class Result>
  int on_root(MPI_Comm comm, Work&& work, Result&& result) const {
    std::array<int, 2> message{};  // code and result
    if (matrix_ && !empty_) {
      message[0] = static_cast<int>(work());
      message[1] = result();
    }
    MPI_Bcast(message.data(), 2, MPI_INT, 0, comm);
    check(static_cast<PetscErrorCode>(message[0]));
    return message[1];
  }

  // Rows stand in rank order, so those of all ranks one after the other are the gathered matrix.
  void gather_pattern(MPI_Comm comm, Mat distributed) {
    reset();
    std::vector<PetscInt> lengths;
    std::vector<PetscInt> columns;
    for_each_row(distributed, [&](PetscInt, auto row_columns, auto) {
      lengths.push_back(static_cast<PetscInt>(row_columns.size()));
      columns.insert(columns.end(), row_columns.begin(), row_columns.end());
    });
    refuse_too_many(comm, columns.size());
    const auto entries = static_cast<int>(columns.size());
    counts_ = gather(comm, std::vector<int>{entries});
    starts_ = starts_of_pieces(counts_);
    lengths = gather(comm, lengths);
    columns = gather(comm, columns);
    Vector like;
    check(MatCreateVecs(distributed, like.put(), nullptr));
    check(VecScatterCreateToZero(like.get(), gathering_.put(), right_.put()));
    solution_ = duplicate(right_.get());
    int rank = 0;
    MPI_Comm_rank(comm, &rank);
    if (rank != 0) return;
    const auto rows = static_cast<PetscInt>(lengths.size());
    check(MatCreate(PETSC_COMM_SELF, matrix_.put()));
    check(MatSetSizes(matrix_.get(), rows, rows, rows, rows));
    check(MatSetType(matrix_.get(), MATSEQAIJ));
    std::vector<PetscInt> starts(1, 0);
    for (const PetscInt length : lengths)
      starts.push_back(starts.back() + length);
    check(MatSeqAIJSetPreallocationCSR(matrix_.get(), starts.data(), columns.data(), nullptr));
    check(PCSetOperators(lu_.get(), matrix_.get(), matrix_.get()));
  }

  void gather_values(MPI_Comm comm, Mat distributed) {
    std::vector<double> values;
    for_each_row(distributed, [&](PetscInt, auto, auto row_values) {
      values.insert(values.end(), row_values.begin(), row_values.end());
    });
    PetscScalar* entries = nullptr;
    if (matrix_) check(MatSeqAIJGetArray(matrix_.get(), &entries));
    MPI_Gatherv(values.data(), static_cast<int>(values.size()), MPI_DOUBLE, entries, counts_.data(),
                starts_.data(), MPI_DOUBLE, 0, comm);
    if (!matrix_) return;
    check(MatSeqAIJRestoreArray(matrix_.get(), &entries));
    check(PetscObjectStateIncrease(reinterpret_cast<PetscObject>(matrix_.get())));
  }

  static void refuse_too_many(MPI_Comm comm, std::size_t entries) {
    auto all = static_cast<std::int64_t>(entries);
    MPI_Allreduce(MPI_IN_PLACE, &all, 1, MPI_INT64_T, MPI_SUM, comm);
    if (all > std::numeric_limits<int>::max())
      throw InputError(
          "a step's matrix has " + std::to_string(all) +
          " entries, too many to gather on one rank; use -pc_type lu, which factors in parallel");
  }

  Preconditioner lu_;
  Matrix matrix_;                     // rank 0's
  Scatter gathering_;                 // of vectors to rank 0
  Vector right_, solution_;           // all of them on rank 0, nothing on the others
  std::vector<int> counts_, starts_;  // on rank 0: entries of each rank, where they stand in the matrix
  bool empty_ = false;                // no rows at all: nothing to factor
};

GatheredLu& behind(PC pc) {
  return *static_cast<GatheredLu*>(pc->data);
}

/// C++ code in a callback of PETSc: exceptions become PETSc errors with their text.
template <class Work>
PetscErrorCode translated(Work&& work) noexcept {
  try {
    std::forward<Work>(work)();
    return static_cast<PetscErrorCode>(0);
  } catch (const std::exception& error) {
    return PetscError(PETSC_COMM_SELF, __LINE__, "gathered LU", __FILE__, PETSC_ERR_LIB, PETSC_ERROR_INITIAL,
                      "%s", error.what());
  }
}

PetscErrorCode set_up(PC pc) {
  return translated([&] {
    const PCFailedReason reason = behind(pc).factor(pc->pmat, pc->flag == SAME_NONZERO_PATTERN);
    check(PCSetFailedReason(pc, reason));
  });
}

PetscErrorCode apply(PC pc, Vec right, Vec solution) {
  return translated([&] { behind(pc).solve(right, solution, PCApply); });
}

PetscErrorCode apply_transpose(PC pc, Vec right, Vec solution) {
  return translated([&] { behind(pc).solve(right, solution, PCApplyTranspose); });
}

PetscErrorCode reset(PC pc) {
  return translated([&] { behind(pc).reset(); });
}

PetscErrorCode destroy(PC pc) {
  delete static_cast<GatheredLu*>(pc->data);
  pc->data = nullptr;
  return static_cast<PetscErrorCode>(0);
}

PetscErrorCode view(PC pc, PetscViewer viewer) {
  return translated([&] {
    check(PetscViewerASCIIPrintf(viewer, "  sequential factorization on rank 0:\n"));
    PetscViewer own = nullptr;
    check(PetscViewerGetSubViewer(viewer, PETSC_COMM_SELF, &own));
    int rank = 0;
    MPI_Comm_rank(PetscObjectComm(reinterpret_cast<PetscObject>(pc)), &rank);
    if (rank == 0) check(PCView(behind(pc).lu(), own));
    check(PetscViewerRestoreSubViewer(viewer, PETSC_COMM_SELF, &own));
  });
}

PetscErrorCode create(PC pc) {
  return translated([&] {
    pc->data = new GatheredLu;
    pc->ops->setup = set_up;
    pc->ops->apply = apply;
    pc->ops->applytranspose = apply_transpose;
    pc->ops->reset = reset;
    pc->ops->destroy = destroy;
    pc->ops->view = view;
    // Generic: PETSc has changed how it declares the second argument. PCLU reads what stands under our
    // prefix.
    pc->ops->setfromoptions = [](PC outer, auto options) -> PetscErrorCode {
      PC lu = behind(outer).lu();
      return lu->ops->setfromoptions(lu, options);
    };
  });
}

}  // namespace

void register_gathered_lu() {
  check(PCRegister(gathered_lu_type, create));
}

PC sequential_lu(PC pc) {
  PetscBool ours = PETSC_FALSE;
  check(PetscObjectTypeCompare(reinterpret_cast<PetscObject>(pc), gathered_lu_type, &ours));
  return ours == PETSC_TRUE ? behind(pc).lu() : nullptr;
}

}  // namespace sweepvi
