#include "vi/interior_point.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "petsc/direct_solver.hpp"
#include "petsc/sparse.hpp"

namespace sweepvi {

namespace {

// Entries of A are at most 1. Far above what a factorization rounds, so that dependent rows are no longer
// singular; far below the entries, so that one or two refinements take it back.
constexpr double rho = 1e-9;
// A v beyond this times what v and q are at the start has gone along a null vector of A, which leads it to
// the size of 1 / rho: there is no solution that way, and far out rounding would pass for one.
constexpr double escape = 0.1 / rho;
constexpr double residue = 1e-14;  // of the largest entry of v and q: what rounding leaves of 0
constexpr int most_refinements = 3;
constexpr double refined = 1e-12;  // residual of a linear system over its right side

constexpr double spring = 1e-2;       // on every row, where the path begins
constexpr double least_pull = 1e-13;  // what is left of it: more than a factorization rounds
constexpr int most_path_steps = 100;  // 10 to 30 are usual
constexpr int most_short_steps = 8;   // in a row: there is no solution, or the problem is not monotone
constexpr double short_step = 0.05;
constexpr double to_boundary = 0.995;  // of the way there
// Proximal steps are tried when the products (v - l) zl have fallen to the squares of these, relative to the
// square of the largest of v and q: what is zero, in v or G, is then far below what is not.
constexpr std::array<double, 3> goals = {1e-10, 1e-13, 1e-16};
constexpr double primal = 1e-11;  // of the same, for A v + q - zl + zu

constexpr int most_linearisations = 20;
constexpr int most_early_steps = 12;  // proximal ones, before the path
constexpr int most_last_steps = 20;

double ordinary(double value, double otherwise) {
  return value > 0.0 && std::isfinite(value) ? value : otherwise;
}

double largest_of(MPI_Comm comm, double mine) {
  MPI_Allreduce(MPI_IN_PLACE, &mine, 1, MPI_DOUBLE, MPI_MAX, comm);
  return mine;
}

double largest(Vec vector) {
  double norm = 0.0;
  check(VecNorm(vector, NORM_INFINITY, &norm));
  return norm;
}

}  // namespace

InteriorPoint::InteriorPoint(Dvi& problem) : problem_(problem), vi_(problem) {
  check(MatDuplicate(vi_.matrix(), MAT_DO_NOT_COPY_VALUES, system_.put()));
  for (Vector* vector :
       {&v_, &g_, &right_, &scale_, &shift_, &change_, &work_, &best_, &predictor_.v, &way_.v})
    *vector = duplicate(problem.state());
  PetscInt size = 0;
  check(VecGetLocalSize(problem.state(), &size));
  const auto rows = static_cast<std::size_t>(size);
  for (std::vector<double>* array : {&zl_, &zu_, &gap_l_, &gap_u_, &stiffness_, &change_l_, &change_u_,
                                     &predictor_.zl, &predictor_.zu, &way_.zl, &way_.zu})
    array->resize(rows);
  active_.resize(rows);
  below_.resize(rows);
  above_.resize(rows);
  check(KSPCreate(problem.comm(), solver_.put()));
  configure(solver_.get());  // failing is a result
}

InteriorPoint::Result InteriorPoint::solve(Vec u, Vec lower, Vec upper, const CertificateOptions& options,
                                           Begin begin, const Ratio& ratio) {
  Result result;
  best_ratio_ = std::numeric_limits<double>::infinity();
  check(VecCopy(u, best_.get()));
  check(KSPSetOperators(solver_.get(), system_.get(), system_.get()));
  for (int linearisation = 0; linearisation < most_linearisations; ++linearisation) {
    const double before = best_ratio_;
    vi_.linearise(u, lower, upper);
    const bool solved = solve_affine(u, options, begin, ratio, result);
    check(VecCopy(best_.get(), u));
    if (solved || !(best_ratio_ < 0.5 * before)) break;
  }
  check(KSPReset(solver_.get()));  // few steps come here: the memory is for others
  result.reason = best_ratio_ <= options.stagnation ? "INTERIOR_CONVERGED"
                  : result.linear_failure           ? "INTERIOR_DIVERGED_LINEAR_SOLVE"
                                                    : "INTERIOR_DIVERGED";
  return result;
}

void InteriorPoint::keep(Vec u, double ratio) {
  if (!(ratio < best_ratio_)) return;
  check(VecCopy(u, best_.get()));
  best_ratio_ = ratio;
}

// Of the linearisation at u, which is lost. @return whether the best point solves the step
bool InteriorPoint::solve_affine(Vec u, const CertificateOptions& options, Begin begin, const Ratio& ratio,
                                 Result& result) {
  const Vector inside = duplicate(u);
  vi_.to_scaled(u, v_.get());
  size_ = std::max(largest(v_.get()), largest(vi_.q()));
  check(VecCopy(v_.get(), inside.get()));
  std::fill(active_.begin(), active_.end(), static_cast<signed char>(0));
  if (begin == Begin::by_sets && proximal_steps(u, most_early_steps, options, ratio, result)) return true;
  check(VecCopy(inside.get(), v_.get()));
  enter(result);
  for (const double goal : goals) {
    result.linear_failure = false;
    const bool arrived = follow_path(goal, result);
    check(VecCopy(v_.get(), inside.get()));
    classify_on_path();
    if (proximal_steps(u, most_last_steps, options, ratio, result)) return true;
    if (!arrived || best_ratio_ <= options.stagnation) break;
    check(VecCopy(inside.get(), v_.get()));
  }
  return best_ratio_ <= options.stagnation;
}

bool InteriorPoint::solve_system(Result& result) {
  if (sweepvi::solve(solver_.get(), system_.get(), right_.get(), change_.get())) return true;
  result.linear_failure = true;
  factored_.clear();
  return false;
}

// diag(rows) A diag(columns) + diag(shift_); null: 1.
void InteriorPoint::set_matrix(Vec rows, Vec columns) {
  check(MatCopy(vi_.matrix(), system_.get(), SAME_NONZERO_PATTERN));
  check(MatDiagonalScale(system_.get(), rows, columns));
  check(MatDiagonalSet(system_.get(), shift_.get(), ADD_VALUES));
}

// ---- Proximal steps by active sets, from v_.

// u becomes the last point. @return whether it is at the target
bool InteriorPoint::proximal_steps(Vec u, int most, const CertificateOptions& options, const Ratio& ratio,
                                   Result& result) {
  double reached = std::numeric_limits<double>::infinity();
  factored_.clear();
  for (int step = 0; step < most; ++step) {
    vi_.residual(v_.get(), g_.get());
    const bool changed = classify() || step == 0;
    if (changed) {
      set_proximal_matrix();
      ++result.iterations;
    }
    set_proximal_right_side();
    if (!solve_system(result)) return false;
    check(VecAXPY(v_.get(), 1.0, change_.get()));
    if (escaped()) return false;
    put_on_bounds();
    vi_.from_scaled(v_.get(), u);
    const double previous = reached;
    reached = ratio(u);
    keep(u, reached);
    if (reached <= options.target || without_residue(u, options, ratio)) return true;
    if (!std::isfinite(reached) || (!changed && !(reached < 0.5 * previous))) return false;
  }
  return false;
}

// u, of v_, without what a solve leaves of unknowns that are zero: rows of nothing but those have no terms to
// judge them by. @return whether that is at the target
bool InteriorPoint::without_residue(Vec u, const CertificateOptions& options, const Ratio& ratio) {
  const double size = largest(v_.get());
  if (largest(change_.get()) > residue * size) return false;
  check(VecCopy(v_.get(), work_.get()));
  {
    const WriteArray v(work_.get());
    for (PetscInt i = 0; i < v.size(); ++i)
      if (std::abs(v[i]) <= residue * size) v[i] = 0.0;
  }
  vi_.from_scaled(work_.get(), u);
  const double reached = ratio(u);
  keep(u, reached);
  return reached <= options.target;
}

// Sets active_ by v and G; what they say by no more than rounding leaves it as it was. @return whether they
// are others than those of the factorization
bool InteriorPoint::classify() {
  const double tolerance = residue * std::max(largest(v_.get()), largest(vi_.q()));
  {
    const ReadArray v(v_.get());
    const ReadArray g(g_.get());
    const ReadArray l(vi_.lower());
    const ReadArray b(vi_.upper());
    for (PetscInt i = 0; i < v.size(); ++i) {
      signed char& at = active_[static_cast<std::size_t>(i)];
      const auto margin = [&](int side) { return at == side ? -tolerance : tolerance; };
      const bool at_lower = l[i] > PETSC_NINFINITY && g[i] - (v[i] - l[i]) >= margin(-1);
      const bool at_upper = b[i] < PETSC_INFINITY && (v[i] - b[i]) - g[i] >= margin(1);
      at = static_cast<signed char>(at_lower ? -1 : at_upper ? 1 : 0);
    }
  }
  return largest_of(problem_.comm(), active_ == factored_ ? 0.0 : 1.0) > 0.0;
}

// Sets active_ by which factor of each product is the smaller one.
void InteriorPoint::classify_on_path() {
  for (std::size_t i = 0; i < active_.size(); ++i) {
    const bool at_lower = below_[i] != 0 && gap_l_[i] <= zl_[i];
    const bool at_upper = above_[i] != 0 && gap_u_[i] <= zu_[i];
    active_[i] = static_cast<signed char>(at_lower ? -1 : at_upper ? 1 : 0);
  }
}

bool InteriorPoint::escaped() const {
  return !(largest(v_.get()) <= escape * size_);  // or NaN
}

// Rows at a bound: v = bound; the others those of A + rho diag(s).
void InteriorPoint::set_proximal_matrix() {
  {
    const WriteArray rows(scale_.get());
    const WriteArray shift(shift_.get());
    for (std::size_t i = 0; i < active_.size(); ++i) {
      const auto row = static_cast<PetscInt>(i);
      rows[row] = active_[i] != 0 ? 0.0 : 1.0;
      shift[row] = active_[i] != 0 ? 1.0 : rho * vi_.regularisation()[i];
    }
  }
  set_matrix(scale_.get(), nullptr);
  factored_ = active_;
}

void InteriorPoint::set_proximal_right_side() {
  const ReadArray v(v_.get());
  const ReadArray g(g_.get());
  const ReadArray l(vi_.lower());
  const ReadArray b(vi_.upper());
  const WriteArray right(right_.get());
  for (PetscInt i = 0; i < g.size(); ++i) {
    const int at = active_[static_cast<std::size_t>(i)];
    right[i] = at < 0 ? l[i] - v[i] : at > 0 ? b[i] - v[i] : -g[i];
  }
}

// Exactly, not up to the rounding of a solve.
void InteriorPoint::put_on_bounds() {
  const ReadArray l(vi_.lower());
  const ReadArray b(vi_.upper());
  const WriteArray v(v_.get());
  for (PetscInt i = 0; i < v.size(); ++i) {
    const int at = active_[static_cast<std::size_t>(i)];
    if (at != 0) v[i] = at < 0 ? l[i] : b[i];
  }
}

// ---- The path.

// How far a free v would go against a spring on every row, from where G is g_.
double InteriorPoint::reach(Result& result) {
  {
    const WriteArray shift(shift_.get());
    for (PetscInt i = 0; i < shift.size(); ++i)
      shift[i] = spring * vi_.regularisation()[static_cast<std::size_t>(i)];
  }
  set_matrix(nullptr, nullptr);
  ++result.iterations;
  check(VecCopy(g_.get(), right_.get()));
  return solve_system(result) ? largest(change_.get()) : 0.0;
}

// Its start: v projected on the box and pushed into it, by as much as G is large there.
void InteriorPoint::enter(Result& result) {
  const ReadArray l(vi_.lower());
  const ReadArray b(vi_.upper());
  {
    const WriteArray v(v_.get());
    for (PetscInt i = 0; i < v.size(); ++i)
      v[i] = std::clamp(v[i], l[i], b[i]);
  }
  vi_.residual(v_.get(), g_.get());
  const double force = ordinary(largest(g_.get()), 1.0);
  const double push = ordinary(reach(result), force);
  double count = 0.0;
  {
    const WriteArray v(v_.get());
    for (std::size_t i = 0; i < gap_l_.size(); ++i) {
      const auto row = static_cast<PetscInt>(i);
      below_[i] = l[row] > PETSC_NINFINITY ? 1 : 0;
      above_[i] = b[row] < PETSC_INFINITY ? 1 : 0;
      const bool both = below_[i] != 0 && above_[i] != 0;
      const double inside = both ? std::min(push, 0.5 * (b[row] - l[row])) : push;
      if (below_[i] != 0) v[row] = std::max(v[row], l[row] + inside);
      if (above_[i] != 0) v[row] = std::min(v[row], b[row] - inside);
      zl_[i] = below_[i] != 0 ? force : 0.0;
      zu_[i] = above_[i] != 0 ? force : 0.0;
      // Where v is large, l + inside - l is not inside: rounding.
      gap_l_[i] = below_[i] != 0 ? std::max(v[row] - l[row], 0.5 * inside) : 1.0;
      gap_u_[i] = above_[i] != 0 ? std::max(b[row] - v[row], 0.5 * inside) : 1.0;
      count += static_cast<double>(below_[i]) + static_cast<double>(above_[i]);
    }
  }
  MPI_Allreduce(&count, &bounds_, 1, MPI_DOUBLE, MPI_SUM, problem_.comm());
  mu_at_start_ = mean_product(nullptr, 0.0);
}

// On from v_, zl_, zu_ until the products are below (goal size)^2 on average. @return false if that fails
bool InteriorPoint::follow_path(double goal, Result& result) {
  int short_steps = 0;
  for (int step = 0; step < most_path_steps; ++step) {
    const double mu = mean_product(nullptr, 0.0);
    const double left = mu_at_start_ > 0.0 ? std::min(1.0, mu / mu_at_start_) : 0.0;
    pull_ = std::max(least_pull, spring * left);
    vi_.residual(v_.get(), g_.get());
    {
      const ReadArray v(v_.get());
      const WriteArray g(g_.get());
      for (std::size_t i = 0; i < zl_.size(); ++i) {
        const auto row = static_cast<PetscInt>(i);
        g[row] += zu_[i] - zl_[i] + pull_ * vi_.regularisation()[i] * v[row];
      }
    }
    const double residual = largest(g_.get());
    const double size = std::max(largest(v_.get()), largest(vi_.q()));
    if (!std::isfinite(mu) || !std::isfinite(residual) || escaped()) return false;
    if (mu <= goal * goal * size * size && residual <= primal * size) return true;
    set_newton_matrix();
    ++result.iterations;
    double length = 0.0;
    if (!advance(mu, length, result)) return false;
    short_steps = length < short_step ? short_steps + 1 : 0;
    if (short_steps == most_short_steps) return false;
  }
  return false;
}

// S (A + diag(zl / (v - l) + zu / (b - v) + pull s)) S, where S makes large entries of the diagonal 1.
void InteriorPoint::set_newton_matrix() {
  {
    const WriteArray scale(scale_.get());
    const WriteArray shift(shift_.get());
    for (std::size_t i = 0; i < stiffness_.size(); ++i) {
      const auto row = static_cast<PetscInt>(i);
      stiffness_[i] = zl_[i] / gap_l_[i] + zu_[i] / gap_u_[i] + pull_ * vi_.regularisation()[i];
      scale[row] = 1.0 / std::sqrt(std::max(1.0, stiffness_[i]));
      shift[row] = scale[row] * scale[row] * stiffness_[i];
    }
  }
  set_matrix(scale_.get(), scale_.get());
}

// A step of the predictor-corrector method; where that is short, towards the centre. `length` is what was
// possible of it.
bool InteriorPoint::advance(double mu, double& length, Result& result) {
  if (!direction(0.0, nullptr, predictor_, result)) return false;
  const double predicted = std::max(0.0, mean_product(&predictor_, longest(predictor_)));
  const double centring = mu > 0.0 ? std::pow(std::min(1.0, predicted / mu), 3) : 0.0;
  if (!direction(centring * mu, &predictor_, way_, result)) return false;
  length = longest(way_);
  if (length < 0.1) {
    if (!direction(std::max(0.5, centring) * mu, nullptr, predictor_, result)) return false;
    const double central = longest(predictor_);
    if (central > length) {
      std::swap(way_, predictor_);
      length = central;
    }
  }
  go(way_, length);
  return true;
}

// The direction in which all products become `product`, to first order, or, given one to first order, to
// second.
bool InteriorPoint::direction(double product, const Direction* second_order, Direction& way, Result& result) {
  set_newton_right_side(product, second_order);  // in work_
  check(VecSet(way.v.get(), 0.0));
  double first = 0.0;
  for (int round = 0; round <= most_refinements; ++round) {
    // right_ = S (work_ - (A + diag(stiffness)) way)
    check(MatMult(vi_.matrix(), way.v.get(), right_.get()));
    {
      const ReadArray wanted(work_.get());
      const ReadArray v(way.v.get());
      const ReadArray scale(scale_.get());
      const WriteArray right(right_.get());
      for (PetscInt i = 0; i < right.size(); ++i)
        right[i] = scale[i] * (wanted[i] - right[i] - stiffness_[static_cast<std::size_t>(i)] * v[i]);
    }
    const double left = largest(right_.get());
    if (round == 0) first = left;
    if (!std::isfinite(left)) return false;
    if (left <= refined * first) break;
    if (!solve_system(result)) return false;
    check(VecPointwiseMult(change_.get(), change_.get(), scale_.get()));
    check(VecAXPY(way.v.get(), 1.0, change_.get()));
  }
  const ReadArray v(way.v.get());
  for (std::size_t i = 0; i < zl_.size(); ++i) {
    const auto row = static_cast<PetscInt>(i);
    const double second_l = second_order != nullptr ? change_l_[i] : 0.0;
    const double second_u = second_order != nullptr ? change_u_[i] : 0.0;
    way.zl[i] = below_[i] != 0 ? (product - second_l - zl_[i] * v[row]) / gap_l_[i] - zl_[i] : 0.0;
    way.zu[i] = above_[i] != 0 ? (product - second_u + zu_[i] * v[row]) / gap_u_[i] - zu_[i] : 0.0;
  }
  return true;
}

// -(A v + q - zl + zu) + what the products lack over their gaps, in work_.
void InteriorPoint::set_newton_right_side(double product, const Direction* second_order) {
  const ReadArray g(g_.get());
  const WriteArray wanted(work_.get());
  std::fill(change_l_.begin(), change_l_.end(), 0.0);
  std::fill(change_u_.begin(), change_u_.end(), 0.0);
  if (second_order != nullptr) {
    const ReadArray v(second_order->v.get());
    for (std::size_t i = 0; i < zl_.size(); ++i) {
      change_l_[i] = v[static_cast<PetscInt>(i)] * second_order->zl[i];
      change_u_[i] = -v[static_cast<PetscInt>(i)] * second_order->zu[i];
    }
  }
  for (std::size_t i = 0; i < zl_.size(); ++i) {
    const auto row = static_cast<PetscInt>(i);
    wanted[row] = -g[row];
    if (below_[i] != 0) wanted[row] += (product - change_l_[i]) / gap_l_[i] - zl_[i];
    if (above_[i] != 0) wanted[row] -= (product - change_u_[i]) / gap_u_[i] - zu_[i];
  }
}

// The largest part, up to 1, of a direction that leaves everything positive.
double InteriorPoint::longest(const Direction& way) const {
  const ReadArray v(way.v.get());
  double inverse = to_boundary;
  const auto look = [&](double value, double change) { inverse = std::max(inverse, -change / value); };
  for (std::size_t i = 0; i < zl_.size(); ++i) {
    const double change = v[static_cast<PetscInt>(i)];
    if (below_[i] != 0) {
      look(gap_l_[i], change);
      look(zl_[i], way.zl[i]);
    }
    if (above_[i] != 0) {
      look(gap_u_[i], -change);
      look(zu_[i], way.zu[i]);
    }
  }
  return to_boundary / largest_of(problem_.comm(), inverse);
}

double InteriorPoint::mean_product(const Direction* way, double length) const {
  if (bounds_ == 0.0) return 0.0;
  double sum = 0.0;
  if (way == nullptr) {
    for (std::size_t i = 0; i < zl_.size(); ++i)
      sum += gap_l_[i] * zl_[i] + gap_u_[i] * zu_[i];
  } else {
    const ReadArray v(way->v.get());
    for (std::size_t i = 0; i < zl_.size(); ++i) {
      const double change = length * v[static_cast<PetscInt>(i)];
      sum += (gap_l_[i] + change) * (zl_[i] + length * way->zl[i]);
      sum += (gap_u_[i] - change) * (zu_[i] + length * way->zu[i]);
    }
  }
  MPI_Allreduce(MPI_IN_PLACE, &sum, 1, MPI_DOUBLE, MPI_SUM, problem_.comm());
  return sum / bounds_;
}

void InteriorPoint::go(const Direction& way, double length) {
  check(VecAXPY(v_.get(), length, way.v.get()));
  const ReadArray v(way.v.get());
  for (std::size_t i = 0; i < zl_.size(); ++i) {
    const double change = length * v[static_cast<PetscInt>(i)];
    if (below_[i] != 0) gap_l_[i] += change;
    if (above_[i] != 0) gap_u_[i] -= change;
    zl_[i] += length * way.zl[i];
    zu_[i] += length * way.zu[i];
  }
}

}  // namespace sweepvi
