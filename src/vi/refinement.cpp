#include "vi/refinement.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "petsc/direct_solver.hpp"
#include "petsc/sparse.hpp"
#include "vi/natural_residual.hpp"

namespace sweepvi {

namespace {

constexpr double epsilon = std::numeric_limits<double>::epsilon();
constexpr int most_corrections = 60;   // with changes of sets
constexpr double evaluation = 1e-31;   // of a row's terms: what twofold arithmetic rounds in its residual
constexpr double vanishing = 1e-29;    // the same, when corrections, themselves rounded, have ended
constexpr double contracts = 1e-3;     // a correction, over the terms of the rows that it changes
constexpr double newton_stays = 1e-6;  // the same, of a nonlinear step
constexpr double same = 1e-12;         // F by K and q, and by the process
constexpr double shifts[] = {0.0, 1e-15, 1e-12, 1e-9};  // of the diagonal, over the sum of the row's entries
constexpr int probes = 4;

/// 1 or -1, the same for a row on any number of ranks.
double sign_of(PetscInt row, int probe) {
  auto bits = static_cast<std::uint64_t>(row) * 4 + static_cast<std::uint64_t>(probe) + 1;
  bits = (bits ^ (bits >> 30)) * 0xbf58476d1ce4e5b9ULL;  // SplitMix64
  bits = (bits ^ (bits >> 27)) * 0x94d049bb133111ebULL;
  return ((bits >> 40) & 1U) != 0 ? 1.0 : -1.0;
}

}  // namespace

Refinement::Refinement(Dvi& problem) : problem_(problem), comm_(problem.comm()) {
  for (Vector* vector :
       {&from_, &own_, &q_, &data_, &terms_, &hi_, &lo_, &f_, &allowed_, &weights_, &right_, &step_})
    *vector = duplicate(problem.state());
  place_.assign(static_cast<std::size_t>(ReadArray(problem.state()).size()), between);
}

void Refinement::take(Vec u, Vec lower, Vec upper, Vec data) {
  lower_ = lower;
  upper_ = upper;
  check(VecCopy(u, from_.get()));
  check(VecCopy(data, own_.get()));
  factored_ = false;
  if (!K_) {
    K_ = problem_.create_jacobian();
    J_ = problem_.create_jacobian();
    check(MatSetOption(J_.get(), MAT_KEEP_NONZERO_PATTERN, PETSC_TRUE));
    rows_.reset();
  }
  int stale = rows_ && version_ == problem_.jacobian_version() ? 0 : 1;  // a rank's own count
  MPI_Allreduce(MPI_IN_PLACE, &stale, 1, MPI_INT, MPI_LOR, comm_);
  if (stale != 0) {
    problem_.derivative(u, K_.get());
    rows_.emplace(K_.get());
    abs_K_ = absolute_copy(K_.get());
    version_ = problem_.jacobian_version();
  }
  rows_->evaluate(u, lower, upper, own_.get(), data_.get(), terms_.get());
}

double Refinement::most(double value) const {
  MPI_Allreduce(MPI_IN_PLACE, &value, 1, MPI_DOUBLE, MPI_MAX, comm_);
  return value;
}

// How near 0 residuals can be told, or need be; weights_ = |K|' (1 / allowed): what a distance changes in the
// rows that read it.
void Refinement::weigh(double rtol) {
  {
    const ReadArray data(data_.get());
    const ReadArray terms(terms_.get());
    const WriteArray allowed(allowed_.get());
    const WriteArray inverse(right_.get());
    for (PetscInt i = 0; i < data.size(); ++i) {
      allowed[i] = std::max({rtol * data[i], vanishing * terms[i], negligible_residual});
      inverse[i] = 1.0 / allowed[i];
    }
  }
  check(MatMultTranspose(abs_K_.get(), right_.get(), weights_.get()));
}

bool Refinement::explained(Vec f, double rtol) {
  weigh(rtol);
  int doubtful = 0;
  {
    const ReadArray u(from_.get());
    const ReadArray values(f);
    const ReadArray l(lower_);
    const ReadArray b(upper_);
    const ReadArray data(data_.get());
    const ReadArray terms(terms_.get());
    const ReadArray weights(weights_.get());
    for (PetscInt i = 0; i < u.size() && doubtful == 0; ++i) {
      const double error = evaluation_error(terms[i]);
      if (largest_residual(u[i], values[i], l[i], b[i], error) <= negligible_residual) continue;
      const double natural = std::abs(natural_residual(u[i], values[i], l[i], b[i]));
      const bool by_force = std::abs(values[i]) + error <= rtol * data[i];
      const bool by_distance =
          natural < std::abs(values[i]) - error && natural * weights[i] <= 1.0;  // F pushes there
      if (!by_force && !by_distance) doubtful = 1;
    }
  }
  MPI_Allreduce(MPI_IN_PLACE, &doubtful, 1, MPI_INT, MPI_LOR, comm_);
  return doubtful == 0;
}

// q_ = F(0), if that and K give F(u).
bool Refinement::take_affine(Vec u) {
  check(VecSet(right_.get(), 0.0));
  problem_.residual(right_.get(), q_.get());
  problem_.residual(u, f_.get());
  check(MatMultAdd(K_.get(), u, q_.get(), step_.get()));
  double worst = 0.0;
  {
    const ReadArray own(f_.get());
    const ReadArray product(step_.get());
    const ReadArray terms(terms_.get());
    for (PetscInt i = 0; i < own.size(); ++i)
      if (!(std::abs(own[i] - product[i]) <= same * terms[i] + negligible_residual)) worst = 1.0;  // NaN, too
  }
  return most(worst) == 0.0;
}

bool Refinement::solve(Vec u, double rtol) {
  moved_ = false;
  affine_ = take_affine(u);
  if (!affine_) {
    weigh(rtol);
    return nonlinear_near(u);
  }
  for (const double shift : shifts) {
    start(u);
    if (!iterate(rtol, shift)) continue;
    check(VecWAXPY(step_.get(), -1.0, u, hi_.get()));
    moved_ = size_of_step(true) > rtol;
    if (moved_) move(u);
    return true;
  }
  return false;
}

void Refinement::move(Vec u) const {
  check(VecCopy(hi_.get(), u));
  const WriteArray values(u);
  const ReadArray l(lower_);
  const ReadArray b(upper_);
  for (PetscInt i = 0; i < values.size(); ++i)
    values[i] = std::min(std::max(values[i], l[i]), b[i]);
}

void Refinement::start(Vec u) {
  check(VecCopy(u, hi_.get()));
  check(VecSet(lo_.get(), 0.0));
  factored_ = false;
}

bool Refinement::iterate(double rtol, double shift) {
  double previous = std::numeric_limits<double>::infinity();
  double step = std::numeric_limits<double>::infinity();
  for (int correction = 0; correction < most_corrections; ++correction) {
    if (correction > 0) rows_->evaluate(hi_.get(), lower_, upper_, own_.get(), data_.get(), terms_.get());
    weigh(rtol);
    const Excess excess = evaluate(rtol);
    if (std::isnan(excess.terms) || excess.terms == HUGE_VAL) return false;
    if (!excess.changed && excess.data <= 1.0) return true;
    if (!excess.changed && excess.terms <= 1.0 && step <= contracts) return driven_by_data(rtol);
    if (!excess.changed && !(excess.terms <= 0.5 * previous)) return false;
    previous = excess.changed ? std::numeric_limits<double>::infinity() : excess.terms;
    if ((!factored_ || excess.changed) && !factor(shift)) return false;
    if (!correct()) return false;
    const double last = excess.changed ? std::numeric_limits<double>::infinity() : step;
    step = size_of_step();
    if (step > contracts && !(step <= 0.5 * last))
      return false;  // u runs away: its terms grow, not shrinks F
  }
  return false;
}

// Whether rounding that is left in rows without data of that size, rho, is nothing to what data make of u:
// see the formula in the header. What no data reach is 0 in one of the solutions.
bool Refinement::driven_by_data(double rtol) {
  if (!factored_) return false;
  const Vector rho = duplicate(from_.get());
  const Vector by_rho = duplicate(from_.get());
  const Vector by_data = duplicate(from_.get());
  check(VecSet(by_rho.get(), 0.0));
  check(VecSet(by_data.get(), 0.0));
  {
    const ReadArray data(data_.get());
    const ReadArray terms(terms_.get());
    const WriteArray left(rho.get());
    for (PetscInt i = 0; i < left.size(); ++i) {
      const double unseen = (vanishing + evaluation) * terms[i];
      left[i] = unseen > rtol * data[i] ? unseen : 0.0;
    }
  }
  for (int probe = 0; probe < probes; ++probe)
    if (!respond(rho.get(), probe, by_rho.get()) || !respond(own_.get(), probe, by_data.get())) return false;
  double worst = 0.0;
  {
    const ReadArray left(rho.get());
    const ReadArray noise(by_rho.get());
    const ReadArray driven(by_data.get());
    for (PetscInt i = 0; i < left.size(); ++i)
      if (driven[i] > 0.0 && !(noise[i] <= rtol * driven[i])) worst = 1.0;
  }
  return most(worst) == 0.0;
}

// What J^-1 makes of changes of rows by `size`, in random directions, in each row: of its terms where u is
// between its bounds, of its sum where F is what bounds hold. The most of it so far.
bool Refinement::respond(Vec size, int probe, Vec most_so_far) {
  const PetscInt first = row_range(K_.get()).first;
  const auto sign = [&](PetscInt i) { return sign_of(first + i, probe); };
  {
    const ReadArray sizes(size);
    const WriteArray right(right_.get());
    for (PetscInt i = 0; i < right.size(); ++i)
      right[i] = place_[static_cast<std::size_t>(i)] == between ? sizes[i] * sign(i) : 0.0;
  }
  if (!sweepvi::solve(solver_.get(), J_.get(), right_.get(), step_.get())) {
    factored_ = false;
    return false;
  }
  const Vector sums = duplicate(step_.get());
  check(MatMult(K_.get(), step_.get(), sums.get()));
  check(VecAbs(step_.get()));
  check(MatMult(abs_K_.get(), step_.get(), right_.get()));
  const ReadArray sizes(size);
  const ReadArray sum(sums.get());
  const ReadArray terms(right_.get());
  const WriteArray result(most_so_far);
  for (PetscInt i = 0; i < result.size(); ++i) {
    const bool free = place_[static_cast<std::size_t>(i)] == between;
    result[i] = std::max(result[i], free ? terms[i] : std::abs(sum[i] - sign(i) * sizes[i]));
  }
  return true;
}

// F in f_, places, and how far rows are from what is allowed.
Refinement::Excess Refinement::evaluate(double rtol) {
  const AffineRows& rows = rows_->rows();
  {
    const WithGhosts high(rows, hi_.get());
    const WithGhosts low(rows, lo_.get());
    const ReadArray q(q_.get());
    const WriteArray f(f_.get());
    for (PetscInt i = 0; i < f.size(); ++i) {
      Twofold sum{q[i], 0.0};
      for (const auto& [offset, value] : rows.entries(i))
        if (value != 0.0) sum = sum + value * Twofold{high[i + offset], low[i + offset]};
      f[i] = sum.value();
    }
  }
  const std::vector<Place> before = place_;
  place(!factored_);
  double worst[3] = {0.0, 0.0, place_ != before ? 1.0 : 0.0};
  {
    const ReadArray f(f_.get());
    const ReadArray data(data_.get());
    const ReadArray terms(terms_.get());
    const ReadArray allowed(allowed_.get());
    for (PetscInt i = 0; i < f.size(); ++i) {
      const Place where = place_[static_cast<std::size_t>(i)];
      const double wrong = where == between    ? std::abs(f[i])
                           : where == at_lower ? std::max(0.0, -f[i])
                                               : std::max(0.0, f[i]);
      const double error = evaluation * terms[i];
      if (wrong + error <= negligible_residual || (wrong == 0.0 && std::abs(f[i]) > error)) continue;
      const double over[2] = {(wrong + error) / (rtol * data[i]), wrong / allowed[i]};
      for (int k = 0; k < 2; ++k)
        if (!(over[k] <= worst[k])) worst[k] = std::isnan(over[k]) ? HUGE_VAL : over[k];
    }
  }
  MPI_Allreduce(MPI_IN_PLACE, worst, 3, MPI_DOUBLE, MPI_MAX, comm_);
  return {worst[0], worst[1], worst[2] != 0.0};
}

// Where unknowns are: what is so close to its bound that no row sees the difference, and is pushed there, is
// at it. @param first  by the point itself; else what forces and bounds make of the places before.
void Refinement::place(bool first) {
  const ReadArray high(hi_.get());
  const ReadArray low(lo_.get());
  const ReadArray f(f_.get());
  const ReadArray l(lower_);
  const ReadArray b(upper_);
  const ReadArray allowed(allowed_.get());
  const ReadArray weights(weights_.get());
  for (PetscInt i = 0; i < f.size(); ++i) {
    Place& where = place_[static_cast<std::size_t>(i)];
    const bool has_lower = l[i] > PETSC_NINFINITY;
    const bool has_upper = b[i] < PETSC_INFINITY;
    const double above = has_lower ? (high[i] - l[i]) + low[i] : HUGE_VAL;
    const double below = has_upper ? (b[i] - high[i]) - low[i] : HUGE_VAL;
    const auto invisible = [&](double distance) { return distance * weights[i] <= 1.0; };
    if (first) {
      where = between;
      if (above == 0.0 || (f[i] > 0.0 && invisible(above)))
        where = at_lower;
      else if (below == 0.0 || (f[i] < 0.0 && invisible(below)))
        where = at_upper;
    }
    if (has_lower && l[i] == b[i]) {
      where = at_lower;
      continue;
    }
    if (where == at_lower && f[i] < -allowed[i])
      where = between;
    else if (where == at_upper && f[i] > allowed[i])
      where = between;
    else if (where == between && above < 0.0 && !invisible(-above))
      where = at_lower;
    else if (where == between && below < 0.0 && !invisible(-below))
      where = at_upper;
  }
}

bool Refinement::factor(double shift) {
  if (!solver_) {
    check(KSPCreate(comm_, solver_.put()));
    check(KSPSetOperators(solver_.get(), J_.get(), J_.get()));
    default_to_mumps(solver_.get());
    check_options(KSPSetFromOptions(solver_.get()));
    check(KSPSetErrorIfNotConverged(solver_.get(), PETSC_FALSE));  // failing is a result
  }
  check(MatCopy(K_.get(), J_.get(), SAME_NONZERO_PATTERN));
  const PetscInt first = row_range(K_.get()).first;
  std::vector<PetscInt> held;
  double open = 0.0;  // rows that read nothing determine nothing: their u stays
  for (std::size_t i = 0; i < place_.size(); ++i) {
    const auto entries = rows_->rows().entries(static_cast<PetscInt>(i));
    const bool reads =
        std::any_of(entries.begin(), entries.end(), [](const auto& e) { return e.value != 0.0; });
    if (place_[i] == between && !reads) open = 1.0;
    if (place_[i] != between || !reads) held.push_back(first + static_cast<PetscInt>(i));
  }
  check(MatZeroRows(J_.get(), static_cast<PetscInt>(held.size()), held.data(), 1.0, nullptr, nullptr));
  if (shift > 0.0) {
    {
      const WriteArray diagonal(right_.get());
      for (PetscInt i = 0; i < diagonal.size(); ++i) {
        double entries = 0.0;
        for (const auto& [offset, value] : rows_->rows().entries(i))
          entries += std::abs(value);
        diagonal[i] = place_[static_cast<std::size_t>(i)] == between ? shift * entries : 0.0;
      }
    }
    check(MatDiagonalSet(J_.get(), right_.get(), ADD_VALUES));
  }
  factored_ = true;
  determined_ = most(open) == 0.0 && shift == 0.0;
  return true;
}

// hi + lo takes a correction.
bool Refinement::correct() {
  {
    const ReadArray high(hi_.get());
    const ReadArray low(lo_.get());
    const ReadArray f(f_.get());
    const ReadArray l(lower_);
    const ReadArray b(upper_);
    const WriteArray right(right_.get());
    for (PetscInt i = 0; i < right.size(); ++i) {
      const Place where = place_[static_cast<std::size_t>(i)];
      right[i] = where == between    ? -f[i]
                 : where == at_lower ? (l[i] - high[i]) - low[i]
                                     : (b[i] - high[i]) - low[i];
    }
  }
  if (!sweepvi::solve(solver_.get(), J_.get(), right_.get(), step_.get())) {
    factored_ = false;
    return false;
  }
  const ReadArray step(step_.get());
  const ReadArray l(lower_);
  const ReadArray b(upper_);
  const WriteArray high(hi_.get());
  const WriteArray low(lo_.get());
  for (PetscInt i = 0; i < step.size(); ++i) {
    const Place where = place_[static_cast<std::size_t>(i)];
    Twofold sum{where == at_lower ? l[i] : b[i], 0.0};
    if (where == between) sum = Twofold{high[i], low[i]} + Twofold{step[i], 0.0};
    high[i] = sum.hi;
    low[i] = sum.lo;
  }
  return true;
}

// Of step_, in the units of the rows: the largest |K| |c| over the terms. @param all  of rows at bounds, too
double Refinement::size_of_step(bool all) const {
  check(VecAbs(step_.get()));
  check(MatMult(abs_K_.get(), step_.get(), right_.get()));
  double worst = 0.0;
  {
    const ReadArray change(right_.get());
    const ReadArray terms(terms_.get());
    for (PetscInt i = 0; i < change.size(); ++i) {
      if ((!all && place_[static_cast<std::size_t>(i)] != between) || change[i] <= negligible_residual)
        continue;
      if (!(change[i] <= worst * terms[i])) worst = terms[i] > 0.0 ? change[i] / terms[i] : HUGE_VAL;
    }
  }
  return most(std::isnan(worst) ? HUGE_VAL : worst);
}

bool Refinement::nonlinear_near(Vec u) {
  start(u);
  place(true);
  // Where its derivative is singular nothing is learned: of Zhuravlev and Ivanov's systems at rest a family
  // of points are solutions, none of them far away.
  return !factor(0.0) || !correct() || size_of_step() <= newton_stays;
}

std::optional<Vector> Refinement::error() {
  if (!affine_ || (!factored_ && !factor(0.0)) || !determined_) return std::nullopt;
  Vector error = duplicate(from_.get());
  check(VecWAXPY(error.get(), -1.0, from_.get(), hi_.get()));
  check(VecAbs(error.get()));
  const PetscInt first = row_range(K_.get()).first;
  for (int probe = 0; probe < probes; ++probe) {
    {
      const ReadArray terms(terms_.get());
      const WriteArray right(right_.get());
      for (PetscInt i = 0; i < right.size(); ++i)
        right[i] = place_[static_cast<std::size_t>(i)] == between
                       ? epsilon * terms[i] * sign_of(first + i, probe)
                       : 0.0;
    }
    if (!sweepvi::solve(solver_.get(), J_.get(), right_.get(), step_.get())) {
      factored_ = false;
      return std::nullopt;
    }
    const ReadArray step(step_.get());
    const WriteArray values(error.get());
    for (PetscInt i = 0; i < step.size(); ++i)
      values[i] = std::max(values[i], std::abs(step[i]));
  }
  return error;
}

}  // namespace sweepvi
