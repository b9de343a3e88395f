#include "petsc/affine_rows.hpp"

#include <cmath>

#include "petsc/sparse.hpp"
#include "vi/natural_residual.hpp"

namespace sweepvi {

namespace {

/// The parts of a local matrix, for one scope.
class LocalPart {
public:
  explicit LocalPart(Mat matrix) : matrix_(matrix) {
    PetscBool done = PETSC_FALSE;
    check(MatGetRowIJ(matrix, 0, PETSC_FALSE, PETSC_FALSE, &rows_, &starts_, &columns_, &done));
    if (done != PETSC_TRUE) throw Error(ExitCode::internal, "a matrix does not show its rows");
    check(MatSeqAIJGetArrayRead(matrix, &values_));
  }
  ~LocalPart() {
    PetscBool done = PETSC_FALSE;
    static_cast<void>(MatSeqAIJRestoreArrayRead(matrix_, &values_));
    static_cast<void>(
        MatRestoreRowIJ(matrix_, 0, PETSC_FALSE, PETSC_FALSE, &rows_, &starts_, &columns_, &done));
  }
  LocalPart(const LocalPart&) = delete;
  LocalPart& operator=(const LocalPart&) = delete;
  PetscInt rows() const { return rows_; }
  template <class Visit>
  void row(PetscInt i, Visit&& visit) const {
    for (PetscInt k = starts_[i]; k < starts_[i + 1]; ++k)
      visit(columns_[k], values_[k]);
  }

private:
  Mat matrix_;
  PetscInt rows_ = 0;
  const PetscInt* starts_ = nullptr;
  const PetscInt* columns_ = nullptr;
  const PetscScalar* values_ = nullptr;
};

}  // namespace

AffineRows::AffineRows(Mat K) {
  const LocalRange range = row_range(K);
  PetscBool parallel = PETSC_FALSE;
  check(PetscObjectTypeCompare(reinterpret_cast<PetscObject>(K), MATMPIAIJ, &parallel));
  Mat own = K;
  Mat others = nullptr;
  const PetscInt* far = nullptr;
  if (parallel == PETSC_TRUE) check(MatMPIAIJGetSeqAIJ(K, &own, &others, &far));
  {
    const LocalPart near(own);
    starts_.reserve(static_cast<std::size_t>(near.rows()) + 1);
    starts_.push_back(0);
    const auto take = [this](PetscInt shift) {
      return [this, shift](PetscInt column, double value) {
        columns_.push_back(column + shift);
        values_.push_back(value);
      };
    };
    if (others == nullptr) {
      for (PetscInt i = 0; i < near.rows(); ++i) {
        near.row(i, take(0));
        starts_.push_back(static_cast<PetscInt>(columns_.size()));
      }
      return;
    }
    const LocalPart beyond(others);
    for (PetscInt i = 0; i < near.rows(); ++i) {
      near.row(i, take(0));
      beyond.row(i, take(range.size()));
      starts_.push_back(static_cast<PetscInt>(columns_.size()));
    }
  }
  PetscInt count = 0;
  check(MatGetSize(others, nullptr, &count));
  const MPI_Comm comm = PetscObjectComm(reinterpret_cast<PetscObject>(K));
  int any = count > 0 ? 1 : 0;
  MPI_Allreduce(MPI_IN_PLACE, &any, 1, MPI_INT, MPI_LOR, comm);
  if (any == 0) return;
  check(VecCreateSeq(PETSC_COMM_SELF, count, ghosts_.put()));
  Vector like;
  check(MatCreateVecs(K, like.put(), nullptr));
  IndexSet from;
  check(ISCreateGeneral(PETSC_COMM_SELF, count, far, PETSC_COPY_VALUES, from.put()));
  check(VecScatterCreate(like.get(), from.get(), ghosts_.get(), nullptr, scatter_.put()));
}

const double* AffineRows::ghosts(Vec u) const {
  if (!scatter_) return nullptr;
  check(VecScatterBegin(scatter_.get(), u, ghosts_.get(), INSERT_VALUES, SCATTER_FORWARD));
  check(VecScatterEnd(scatter_.get(), u, ghosts_.get(), INSERT_VALUES, SCATTER_FORWARD));
  const ReadArray values(ghosts_.get());
  return values.data();
}

// What a row is summed from: its sum and that of the absolute values; the compiler leaves out what is not
// used.
inline AffineRows::Row AffineRows::row(PetscInt i, const double* own, const double* others) const {
  const PetscInt count = size();
  Row result;
  for (auto k = static_cast<std::size_t>(starts_[static_cast<std::size_t>(i)]),
            last = static_cast<std::size_t>(starts_[static_cast<std::size_t>(i) + 1]);
       k < last; ++k) {
    const PetscInt column = columns_[k];
    // Columns beyond our own are there only with ghosts.
    // NOLINTNEXTLINE(clang-analyzer-core.NullDereference)
    const double product = values_[k] * (column < count ? own[column] : others[column - count]);
    result.sum += product;
    result.size += std::abs(product);
  }
  return result;
}

void AffineRows::residual(Vec u, Vec b, Vec f) const {
  const double* others = ghosts(u);
  const ReadArray own(u);
  const ReadArray right(b);
  const WriteArray result(f);
  for (PetscInt i = 0; i < size(); ++i)
    result[i] = row(i, own.data(), others).sum - right[i];
}

void AffineRows::terms(Vec u, Vec b_terms, Vec terms) const {
  const double* others = ghosts(u);
  const ReadArray own(u);
  const ReadArray right(b_terms);
  const WriteArray result(terms);
  for (PetscInt i = 0; i < size(); ++i)
    result[i] = row(i, own.data(), others).size + right[i];
}

template <class Visit>
void AffineRows::evaluate_each(Vec u, Vec b, Vec b_terms, Vec f, Vec terms, Visit&& visit) const {
  const double* others = ghosts(u);
  const ReadArray own(u);
  const ReadArray right(b);
  const ReadArray right_terms(b_terms);
  const WriteArray result(f);
  const WriteArray size_of(terms);
  for (PetscInt i = 0; i < size(); ++i) {
    const Row products = row(i, own.data(), others);
    const double value = products.sum - right[i];
    const double all_terms = products.size + right_terms[i];
    result[i] = value;
    size_of[i] = all_terms;
    visit(i, own[i], value, all_terms);
  }
}

void AffineRows::evaluate(Vec u, Vec b, Vec b_terms, Vec f, Vec terms) const {
  evaluate_each(u, b, b_terms, f, terms, [](PetscInt, double, double, double) {});
}

RowRatios AffineRows::judge(Vec u, Vec lower, Vec upper, Vec b, Vec b_terms, Vec f, Vec terms) const {
  const ReadArray l(lower);
  const ReadArray h(upper);
  RowJudge judge;
  evaluate_each(u, b, b_terms, f, terms, [&](PetscInt i, double own, double value, double all_terms) {
    judge.look_at(own, value, l[i], h[i], all_terms);
  });
  return judge.ratios();
}

void AffineRows::add_product(Vec u, Vec sum, Vec terms) const {
  const double* others = ghosts(u);
  const ReadArray own(u);
  const WriteArray result(sum);
  const WriteArray size_of(terms);
  for (PetscInt i = 0; i < size(); ++i) {
    const Row products = row(i, own.data(), others);
    result[i] += products.sum;
    size_of[i] += products.size;
  }
}

}  // namespace sweepvi
