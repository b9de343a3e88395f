#include "petsc/affine_rows.hpp"

#include <cmath>
#include <optional>
#include <utility>

#include "petsc/alike.hpp"
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
  PetscBool parallel = PETSC_FALSE;
  check(PetscObjectTypeCompare(reinterpret_cast<PetscObject>(K), MATMPIAIJ, &parallel));
  Mat own = K;
  Mat others = nullptr;
  const PetscInt* far = nullptr;
  if (parallel == PETSC_TRUE) check(MatMPIAIJGetSeqAIJ(K, &own, &others, &far));
  take_rows(own, others);
  if (others == nullptr) return;
  check(MatGetSize(others, nullptr, &ghost_count_));
  const MPI_Comm comm = PetscObjectComm(reinterpret_cast<PetscObject>(K));
  int any = ghost_count_ > 0 ? 1 : 0;
  MPI_Allreduce(MPI_IN_PLACE, &any, 1, MPI_INT, MPI_LOR, comm);
  if (any == 0) return;
  check(VecCreateSeq(PETSC_COMM_SELF, ghost_count_, ghosts_.put()));
  Vector like;
  check(MatCreateVecs(K, like.put(), nullptr));
  IndexSet from;
  check(ISCreateGeneral(PETSC_COMM_SELF, ghost_count_, far, PETSC_COPY_VALUES, from.put()));
  check(VecScatterCreate(like.get(), from.get(), ghosts_.get(), nullptr, scatter_.put()));
}

void AffineRows::take_rows(Mat own, Mat others) {
  const LocalPart near(own);
  const std::optional<LocalPart> beyond =
      others != nullptr ? std::optional<LocalPart>(std::in_place, others) : std::nullopt;
  check(MatGetSize(own, nullptr, &columns_));
  kind_.reserve(static_cast<std::size_t>(near.rows()));
  Alike alike;
  std::vector<double> entries;  // whether there are ghosts, then offset and value of each
  for (PetscInt i = 0; i < near.rows(); ++i) {
    entries.assign(1, 0.0);
    const auto take = [&](PetscInt shift) {
      return [&entries, shift](PetscInt column, double value) {
        entries.push_back(static_cast<double>(column + shift));
        entries.push_back(value);
      };
    };
    near.row(i, take(-i));
    const std::size_t before = entries.size();
    if (beyond) beyond->row(i, take(columns_ - i));
    if (entries.size() > before) entries.front() = 1.0;
    const auto [kind, is_new] = alike.number(entries);
    kind_.push_back(kind);
    if (!is_new) continue;
    const auto begin = static_cast<PetscInt>(entries_.size());
    for (std::size_t k = 1; k < entries.size(); k += 2)
      entries_.push_back({static_cast<PetscInt>(entries[k]), entries[k + 1]});
    kinds_.push_back({begin, static_cast<PetscInt>(entries_.size()), entries.front() != 0.0});
  }
  find_runs();
}

// Up to which row kinds come back after `period` rows, without ghosts.
PetscInt AffineRows::straight_until(PetscInt begin, PetscInt period) const {
  const auto kind = [this](PetscInt i) { return kind_[static_cast<std::size_t>(i)]; };
  PetscInt end = begin;
  while (end < size() && !kind_of(end).reads_ghosts &&
         (end < begin + period || kind(end) == kind(end - period)))
    ++end;
  return end;
}

// Those that are long, with the shortest period.
void AffineRows::find_runs() {
  constexpr PetscInt longest_period = 16, repeats = 8;
  for (PetscInt begin = 0; begin < size();) {
    PetscInt period = 1;
    PetscInt end = begin;
    for (; period <= longest_period; ++period) {
      end = straight_until(begin, period);
      if (end - begin >= repeats * period) break;
    }
    if (period <= longest_period) {
      end -= (end - begin) % period;
      runs_.push_back({end, period});
      begin = end;
      continue;
    }
    ++begin;
    if (!runs_.empty() && runs_.back().period == 0)
      runs_.back().end = begin;
    else
      runs_.push_back({begin, 0});
  }
}

const double* AffineRows::ghosts(Vec u) const {
  if (!scatter_) return nullptr;
  check(VecScatterBegin(scatter_.get(), u, ghosts_.get(), INSERT_VALUES, SCATTER_FORWARD));
  check(VecScatterEnd(scatter_.get(), u, ghosts_.get(), INSERT_VALUES, SCATTER_FORWARD));
  const ReadArray values(ghosts_.get());
  return values.data();
}

double AffineRows::dominance() const {
  double least = 1.0;
  for (const Kind& kind : kinds_) {
    double diagonal = 0.0;
    double others = 0.0;
    for (const Entry* entry = entries_.data() + kind.begin; entry < entries_.data() + kind.end; ++entry)
      (entry->offset == 0 ? diagonal : others) += entry->offset == 0 ? entry->value : std::abs(entry->value);
    least = std::min(least, diagonal > 0.0 ? 1.0 - others / diagonal : -1.0);
  }
  return least;
}

void AffineRows::multiply(Vec x, Vec y) const {
  const double* others = ghosts(x);
  const ReadArray own(x);
  const WriteArray result(y);
  each_row(own.data(), others, [&](PetscInt i, const Row& products) { result[i] = products.sum; });
}

void AffineRows::add_to(Vec x, Vec y) const {
  const double* others = ghosts(x);
  const ReadArray own(x);
  const WriteArray result(y);
  each_row(own.data(), others, [&](PetscInt i, const Row& products) { result[i] += products.sum; });
}

void AffineRows::residual(Vec u, Vec b, Vec f) const {
  const double* others = ghosts(u);
  const ReadArray own(u);
  const ReadArray right(b);
  const WriteArray result(f);
  each_row(own.data(), others, [&](PetscInt i, const Row& products) { result[i] = products.sum - right[i]; });
}

void AffineRows::terms(Vec u, Vec b_terms, Vec terms) const {
  const double* others = ghosts(u);
  const ReadArray own(u);
  const ReadArray right(b_terms);
  const WriteArray result(terms);
  each_row(own.data(), others,
           [&](PetscInt i, const Row& products) { result[i] = products.size + right[i]; });
}

template <class Visit>
void AffineRows::evaluate_each(Vec u, Vec b, Vec b_terms, Vec f, Vec terms, Visit&& visit) const {
  const double* others = ghosts(u);
  const ReadArray own(u);
  const ReadArray right(b);
  const ReadArray right_terms(b_terms);
  const WriteArray result(f);
  const WriteArray size_of(terms);
  each_row(own.data(), others, [&](PetscInt i, const Row& products) {
    const double value = products.sum - right[i];
    const double all_terms = products.size + right_terms[i];
    result[i] = value;
    size_of[i] = all_terms;
    visit(i, own[i], value, all_terms);
  });
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
  each_row(own.data(), others, [&](PetscInt i, const Row& products) {
    result[i] += products.sum;
    size_of[i] += products.size;
  });
}

void AffineRows::map(Vec x, Vec x_terms, Vec y, Vec y_terms) const {
  multiply(x, y);
  const double* others = ghosts(x_terms);
  const ReadArray own(x_terms);
  const WriteArray result(y_terms);
  each_row(own.data(), others, [&](PetscInt i, const Row& products) { result[i] = products.size; });
}

}  // namespace sweepvi
