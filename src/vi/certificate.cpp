#include "vi/certificate.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "petsc/sparse.hpp"

namespace sweepvi {

namespace {
constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr double residue =
    1e-12;  // own terms that much smaller than those a row reads are no more than rounding
}  // namespace

Certificate::Certificate(Dvi& problem, const CertificateOptions& options)
    : problem_(problem),
      options_(options),
      terms_(duplicate(problem.state())),
      spread_(duplicate(problem.state())),
      own_(duplicate(problem.state())) {}

double Certificate::worst_ratio(Vec u, Vec lower, Vec upper, Vec f) {
  problem_.residual_and_terms(u, f, terms_.get());
  return judge(u, lower, upper, f);
}

double Certificate::settled_ratio(Vec u, Vec lower, Vec upper, Vec f) {
  problem_.settle_and_judge(u, f, terms_.get());
  return judge(u, lower, upper, f);
}

// By f and terms_.
double Certificate::judge(Vec u, Vec lower, Vec upper, Vec f) {
  constexpr int rounds = 4;
  constexpr int sweeps = 3;  // residue travels along that many unknowns before it is judged again
  double worst = ratio(u, lower, upper, f);
  if (worst <= options_.target) return worst;
  check(VecCopy(terms_.get(), spread_.get()));
  check(VecCopy(terms_.get(), own_.get()));
  for (int round = 0; round < rounds; ++round) {
    for (int sweep = 0; sweep < sweeps; ++sweep)
      if (!spread_once()) return worst;
    add_spread(lower, upper);
    const double spread = ratio(u, lower, upper, f);
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

double Certificate::ratio(Vec u, Vec lower, Vec upper, Vec f) {
  std::array<double, 2> worst = {0.0, 0.0};  // ratio; does any row rely on its distance from a bound?
  {
    const ReadArray x(u);
    const ReadArray value(f);
    const ReadArray l(lower);
    const ReadArray b(upper);
    const ReadArray terms(terms_.get());
    double not_finite = 0.0;  // or NaN
    for (PetscInt i = 0; i < x.size(); ++i) {
      not_finite += 0.0 * x[i] + 0.0 * value[i] + 0.0 * terms[i];
      const double natural = std::abs(natural_residual(x[i], value[i], l[i], b[i]));
      if (natural > worst[0] * terms[i])
        worst[0] = natural / terms[i];  // terms = 0: infinite, as it should be
      if (natural < std::abs(value[i]) && natural != 0.0) worst[1] = 1.0;
    }
    if (std::isnan(not_finite)) worst[0] = infinity;
  }
  MPI_Allreduce(MPI_IN_PLACE, worst.data(), 2, MPI_DOUBLE, MPI_MAX, problem_.comm());
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
      if (natural == 0.0) continue;
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
