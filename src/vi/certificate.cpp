#include "vi/certificate.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "petsc/sparse.hpp"

namespace sweepvi {

namespace {
constexpr double residue =
    1e-12;  // own terms that much smaller than those a row reads are no more than rounding
}  // namespace

RowRatios judge_rows(Vec u, Vec f, Vec lower, Vec upper, Vec terms) {
  const ReadArray x(u);
  const ReadArray value(f);
  const ReadArray l(lower);
  const ReadArray b(upper);
  const ReadArray size(terms);
  RowJudge judge;
  for (PetscInt i = 0; i < x.size(); ++i)
    judge.look_at(x[i], value[i], l[i], b[i], size[i]);
  return judge.ratios();
}

RowRatios Dvi::settle_and_judge(Vec u, Vec lower, Vec upper, Vec f, Vec terms) {
  settle(u);
  residual_and_terms(u, f, terms);
  return judge_rows(u, f, lower, upper, terms);
}

Certificate::Certificate(Dvi& problem, const CertificateOptions& options)
    : problem_(problem),
      options_(options),
      terms_(duplicate(problem.state())),
      spread_(duplicate(problem.state())),
      own_(duplicate(problem.state())) {}

double Certificate::worst_ratio(Vec u, Vec lower, Vec upper, Vec f) {
  problem_.residual_and_terms(u, f, terms_.get());
  return judge(u, lower, upper, f, judge_rows(u, f, lower, upper, terms_.get()));
}

double Certificate::settled_ratio(Vec u, Vec lower, Vec upper, Vec f) {
  const RowRatios rows = problem_.settle_and_judge(u, lower, upper, f, terms_.get());
  return judge(u, lower, upper, f, rows);
}

// By f and terms_.
double Certificate::judge(Vec u, Vec lower, Vec upper, Vec f, const RowRatios& rows) {
  constexpr int rounds = 4;
  constexpr int sweeps = 3;  // residue travels along that many unknowns before it is judged again
  double worst = ratio(u, lower, upper, f, rows);
  if (worst <= options_.target) return worst;
  check(VecCopy(terms_.get(), spread_.get()));
  check(VecCopy(terms_.get(), own_.get()));
  for (int round = 0; round < rounds; ++round) {
    for (int sweep = 0; sweep < sweeps; ++sweep)
      if (!spread_once()) return worst;
    add_spread(lower, upper);
    const double spread = ratio(u, lower, upper, f, judge_rows(u, f, lower, upper, terms_.get()));
    const bool better = spread < 0.5 * worst;
    worst = std::min(worst, spread);
    if (!better || worst <= options_.target) break;
  }
  return worst;
}

// Rows with terms of their own answer for those, and hand on no more.
bool Certificate::spread_once() {
  if (!problem_.spread_terms(spread_.get())) return false;
  const ReadArray own(own_.get());
  const WriteArray spread(spread_.get());
  for (PetscInt i = 0; i < spread.size(); ++i)
    if (own[i] >= residue * spread[i]) spread[i] = own[i];
  return true;
}

// Only where there are no bounds: what is left of an output that is held must not pass for an open one.
void Certificate::add_spread(Vec lower, Vec upper) {
  const ReadArray spread(spread_.get());
  const ReadArray l(lower);
  const ReadArray b(upper);
  const WriteArray terms(terms_.get());
  for (PetscInt i = 0; i < terms.size(); ++i) {
    const bool bounded = l[i] > PETSC_NINFINITY || b[i] < PETSC_INFINITY;
    if (!bounded && terms[i] < residue * spread[i]) terms[i] = 0.1 * spread[i];
  }
}

double Certificate::ratio(Vec u, Vec lower, Vec upper, Vec f, const RowRatios& rows) {
  std::array<double, 3> worst = {rows.worst, rows.by_distance ? 1.0 : 0.0, rows.outside ? 1.0 : 0.0};
  MPI_Allreduce(MPI_IN_PLACE, worst.data(), 3, MPI_DOUBLE, MPI_MAX, problem_.comm());
  inside_ = worst[2] == 0.0;
  const bool in_doubt = worst[0] <= options_.rtol && worst[1] > 0.0;
  return in_doubt ? weighted_ratio(u, lower, upper, f) : worst[0];
}

double Certificate::weighted_ratio(Vec u, Vec lower, Vec upper, Vec f) {
  weigh(u);
  double worst = 0.0;
  {
    const ReadArray x(u);
    const ReadArray value(f);
    const ReadArray l(lower);
    const ReadArray b(upper);
    const ReadArray terms(terms_.get());
    const ReadArray weights(weights_.get());
    for (PetscInt i = 0; i < x.size(); ++i) {
      const double natural = std::abs(natural_residual(x[i], value[i], l[i], b[i]));
      if (natural <= negligible_residual) continue;
      const double distance =
          natural * (weights[i] < 1.0 / terms[i] ? 1.0 / terms[i] : weights[i]);  // or NaN
      const double residual = std::abs(value[i]) / terms[i];
      worst = std::max(worst, distance < residual ? distance : residual);
    }
  }
  MPI_Allreduce(MPI_IN_PLACE, &worst, 1, MPI_DOUBLE, MPI_MAX, problem_.comm());
  return worst;
}

// weights = |dF/du|' (1 / terms). A row without terms reads nothing but zeros: it has nothing to say.
void Certificate::weigh(Vec u) {
  if (!jacobian_) {
    jacobian_ = problem_.create_jacobian();
    inverse_ = duplicate(u);
    weights_ = duplicate(u);
  }
  problem_.derivative(u, jacobian_.get());
  {
    const ReadArray terms(terms_.get());
    const WriteArray inverse(inverse_.get());
    for (PetscInt i = 0; i < terms.size(); ++i)
      inverse[i] = terms[i] > 0.0 ? std::min(1.0 / terms[i], std::numeric_limits<double>::max()) : 0.0;
  }
  const Matrix absolute = absolute_copy(jacobian_.get());
  check(MatMultTranspose(absolute.get(), inverse_.get(), weights_.get()));
}

}  // namespace sweepvi
