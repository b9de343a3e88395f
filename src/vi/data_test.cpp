#include "vi/data_test.hpp"

#include <algorithm>
#include <cmath>

#include "petsc/sparse.hpp"
#include "vi/natural_residual.hpp"

namespace sweepvi {

namespace {
constexpr double margin = 0.01;  // of dominance, over the diagonal: terms are below 200 times the data
}  // namespace

DataTest::DataTest(Dvi& problem, const CertificateOptions& options)
    : problem_(problem),
      options_(options),
      data_(duplicate(problem.state())),
      origin_(duplicate(problem.state())),
      before_(duplicate(problem.state())) {}

bool DataTest::dominant() {
  const AffineStep affine = problem_.affine();
  const AffineRows* const rows = affine.rows;
  if (rows == nullptr || affine.level != nullptr) return false;  // rows of multipliers have no diagonal
  if (rows == looked_at_ && version_ == problem_.jacobian_version()) return dominant_;
  looked_at_ = rows;
  version_ = problem_.jacobian_version();
  int weak = rows->dominance() < margin ? 1 : 0;
  MPI_Allreduce(MPI_IN_PLACE, &weak, 1, MPI_INT, MPI_LOR, problem_.comm());
  dominant_ = weak == 0;
  return dominant_;
}

// What rows consist of at the point of the box next to 0.
void DataTest::find_data(Vec lower, Vec upper) {
  {
    const ReadArray l(lower);
    const ReadArray b(upper);
    const WriteArray origin(origin_.get());
    for (PetscInt i = 0; i < origin.size(); ++i) {
      origin[i] = 0.0;
      if (l[i] > PETSC_NINFINITY) origin[i] = std::max(origin[i], l[i]);
      if (b[i] < PETSC_INFINITY) origin[i] = std::min(origin[i], b[i]);
    }
  }
  problem_.row_terms(origin_.get(), data_.get());
}

bool DataTest::doubtful(Vec u, Vec f, Vec terms, Vec data_of_rows, Vec lower, Vec upper) {
  int any = 0;
  {
    const ReadArray x(u);
    const ReadArray values(f);
    const ReadArray l(lower);
    const ReadArray b(upper);
    const ReadArray data(data_of_rows);
    const ReadArray size(terms);
    for (PetscInt i = 0; i < x.size() && any == 0; ++i)
      if (!(largest_residual(x[i], values[i], l[i], b[i], evaluation_error(size[i])) <=
            options_.rtol * data[i] + negligible_residual))
        any = 1;
  }
  MPI_Allreduce(MPI_IN_PLACE, &any, 1, MPI_INT, MPI_LOR, problem_.comm());
  return any != 0;
}

Refinement& DataTest::refinement() {
  if (!refinement_) refinement_ = std::make_unique<Refinement>(problem_);
  return *refinement_;
}

// Whether all residuals, with what their evaluation may round, are small against the terms of the steps
// before this one; where they are not, against what unknowns of rows that have not grown contribute. Takes
// note of `terms`: what a row consists of may halve in a step without being forgotten, and vanish for as long
// as it likes.
bool DataTest::as_before(Vec u, Vec f, Vec terms, double ratio, Vec lower, Vec upper) {
  grown_.clear();
  {
    const double most = options_.rtol / (ratio + evaluation_error(1.0));
    const ReadArray terms_now(terms);
    const WriteArray terms_before(before_.get());
    const double* const now = terms_now.data();
    double* const before = terms_before.data();
    const PetscInt count = terms_now.size();
    for (PetscInt i = 0; i < count; ++i) {
      if (now[i] == 0.0) continue;
      if (!(now[i] <= most * before[i])) grown_.push_back(i);
      before[i] = std::max(now[i], 0.5 * before[i]);
    }
  }
  int doubtful = grown_.empty() || explained_by_others(u, f, terms, lower, upper) ? 0 : 1;
  MPI_Allreduce(MPI_IN_PLACE, &doubtful, 1, MPI_INT, MPI_LOR, problem_.comm());
  return doubtful == 0;
}

// Of the rows that have grown: their residuals against this rank's unknowns whose rows have not.
bool DataTest::explained_by_others(Vec u, Vec f, Vec terms, Vec lower, Vec upper) const {
  const AffineRows* const rows = problem_.affine().rows;
  if (rows == nullptr || 8 * static_cast<PetscInt>(grown_.size()) > rows->size()) return false;
  const ReadArray x(u);
  const ReadArray values(f);
  const ReadArray size(terms);
  const ReadArray l(lower);
  const ReadArray b(upper);
  return std::all_of(grown_.begin(), grown_.end(), [&](PetscInt i) {
    double others = 0.0;
    for (const auto& [offset, value] : rows->entries(i)) {
      const PetscInt j = i + offset;
      if (j < rows->size() && !std::binary_search(grown_.begin(), grown_.end(), j))
        others += std::abs(value * x[j]);
    }
    return largest_residual(x[i], values[i], l[i], b[i], evaluation_error(size[i])) <=
           options_.rtol * RowData::indirect * others + negligible_residual;
  });
}

DataTest::Verdict DataTest::judge(Vec u, Vec f, Vec terms, double ratio, Vec lower, Vec upper) {
  if (dominant() || as_before(u, f, terms, ratio, lower, upper)) return Verdict::holds;
  const Verdict verdict = look_again(u, f, terms, lower, upper);
  if (verdict == Verdict::fails) check(VecSet(before_.get(), 0.0));
  return verdict;
}

DataTest::Verdict DataTest::look_again(Vec u, Vec f, Vec terms, Vec lower, Vec upper) {
  find_data(lower, upper);
  if (!doubtful(u, f, terms, data_.get(), lower, upper)) return Verdict::holds;
  if (const AffineStep affine = problem_.affine(); affine.rows != nullptr && affine.level == nullptr) {
    const Vector data = duplicate(u);
    const Vector all = duplicate(u);
    RowData::evaluate(*affine.rows, u, lower, upper, data_.get(), data.get(), all.get());
    if (!doubtful(u, f, terms, data.get(), lower, upper)) return Verdict::holds;
  }
  Refinement& refined = refinement();
  refined.take(u, lower, upper, data_.get());
  if (refined.explained(f, options_.rtol)) return Verdict::holds;
  return !refined.solve(u, options_.rtol) ? Verdict::fails
         : refined.moved()                ? Verdict::refined
                                          : Verdict::holds;
}

std::optional<ErrorEstimate> DataTest::refine(Vec u, Vec f, Vec lower, Vec upper) {
  find_data(lower, upper);
  Refinement& refined = refinement();
  refined.take(u, lower, upper, data_.get());
  if (!refined.solve(u, options_.rtol)) return std::nullopt;
  std::optional<Vector> error = refined.error();
  if (!error) return std::nullopt;
  refined.move(u);
  ErrorEstimate estimate;
  double largest_error = 0.0;
  double largest = 0.0;
  check(VecNorm(error->get(), NORM_INFINITY, &largest_error));
  check(VecNorm(u, NORM_INFINITY, &largest));
  estimate.of_largest = largest_error == 0.0 ? 0.0 : largest_error / largest;
  estimate.error = std::move(*error);
  check(VecCopy(refined.residual(), f));
  return estimate;
}

}  // namespace sweepvi
