#include "hybrid/smooth_flow.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "dvi/affine_vi.hpp"
#include "dvi/level_state.hpp"
#include "hybrid/first_root.hpp"
#include "petsc/direct_solver.hpp"
#include "petsc/sparse.hpp"
#include "sweepvi/step_solver.hpp"

namespace sweepvi {

namespace {

constexpr int most_terms = 40;
constexpr int decisive_terms = 8;   // derivatives that may say whether a contact is left
constexpr double tie = 1e-12;       // a derivative that is this small, relative to its terms, is zero
constexpr double lost = 1e-16;      // by rounding of a sum, relative to its largest term
constexpr double together = 1e-13;  // events so close, relative to the time, are one

std::vector<double> values_of(Vec vector) {
  const ReadArray values(vector);
  return {values.data(), values.data() + values.size()};
}

bool anywhere(MPI_Comm comm, bool here) {
  int found = here ? 1 : 0;
  MPI_Allreduce(MPI_IN_PLACE, &found, 1, MPI_INT, MPI_LOR, comm);
  return found != 0;
}

double factorial(int k) {
  static const auto table = [] {
    std::array<double, most_terms + 2> values{1.0};
    for (std::size_t i = 1; i < values.size(); ++i)
      values[i] = values[i - 1] * static_cast<double>(i);
    return values;
  }();
  return table[static_cast<std::size_t>(k)];
}

double norm(Vec vector) {
  double value = 0.0;
  check(VecNorm(vector, NORM_INFINITY, &value));
  return value;
}

}  // namespace

SmoothFlow::SmoothFlow(const LinearSystem& system, const RelativeDegree& degree, const Forcing* offset)
    : system_(system), degree_(degree), offset_(offset), forcing_(system, degree) {
  const std::size_t count = degree.degree.size();
  const PetscInt first = row_range(degree.Z.get()).first;
  RowBuilder rows;
  for (std::size_t a = 0; a < count; ++a) {
    rows.add(get_row(degree.Z.get(), first + degree.first_level[a + 1] - 1));
    rows.end_row();
  }
  last_rows_ = rows.finish(system.comm(), column_range(degree.Z.get()).size());
  abs_A_ = absolute_copy(system.A.get());
  abs_last_ = absolute_copy(last_rows_.get());
  bool coupled = false;
  for_each_row(degree.markov.get(), [&](PetscInt row, auto columns, auto values) {
    for (std::size_t k = 0; k < columns.size(); ++k)
      coupled = coupled || (columns[k] != row && values[k] != 0.0);
  });
  coupled_ = anywhere(system.comm(), coupled);
  upper_.assign(count, PETSC_INFINITY);
  if (system.wmax) upper_ = values_of(system.wmax.get());
  for (Vector* vector : {&rate_, &work_})
    *vector = duplicate(system.x0.get());
  for (Vector* vector : {&a_, &lambda_now_, &terms_, &w_now_})
    *vector = duplicate(system.w0.get());
  check(MatCreateVecs(degree.Z.get(), nullptr, outputs_.put()));
  g_ = duplicate(outputs_.get());
  contact_.assign(count, Side::none);
  tied_.assign(count, 0);
  leading_.assign(count, 0);
  meets_.assign(count, 0);
}

bool SmoothFlow::start(double t, Vec x, const std::vector<double>& z, bool continues) {
  t_ = t;
  z_ = z;
  if (X_.empty()) X_.push_back(duplicate(x));
  check(VecCopy(x, X_[0].get()));
  norms_.assign(1, norm(x));
  pushes_.assign(1, 0.0);
  shifts_.assign(1, 0.0);
  w_.assign(1, std::vector<double>(constraints(), 0.0));
  lambda_.clear();
  known_ = 1;
  bool touching = false, unclear = !continues;
  for (std::size_t a = 0; a < constraints(); ++a) {
    const double z1 = z[at(a, 1)];
    const bool above = z1 == upper_[a];
    int leading = z1 == 0.0 || above ? 1 : 0;
    while (leading > 0 && leading < levels(a) && z[at(a, leading + 1)] == 0.0)
      ++leading;
    leading_[a] = leading;
    const bool touches = leading == levels(a);
    unclear = unclear || touches != (contact_[a] != Side::none);
    w_[0][a] = z1;
    touching = touching || touches;
  }
  any_contact_ = anywhere(system_.comm(), touching);
  undecided_ = any_contact_ && anywhere(system_.comm(), unclear);
  if (undecided_) {
    for (std::size_t a = 0; a < constraints(); ++a) {
      tied_[a] = leading_[a] == levels(a) ? 1 : 0;
      contact_[a] = Side::none;
    }
  }
  for (int k = 0; undecided_ && k < decisive_terms; ++k)
    if (!next()) return false;
  // What is left is held by no force: it stays until something moves it.
  for (std::size_t a = 0; a < constraints(); ++a)
    if (tied_[a] != 0) contact_[a] = wall_of(a);
  any_contact_ = anywhere(system_.comm(), std::any_of(contact_.begin(), contact_.end(),
                                                      [](Side side) { return side != Side::none; }));
  undecided_ = false;
  return true;
}

// a_k = z_r^(k+1) / k! where lambda = 0, and what it is made of.
void SmoothFlow::find_acceleration(int k) {
  check(MatMult(last_rows_.get(), rate_.get(), a_.get()));
  if (offset_ != nullptr) offset_->add_to(a_.get(), t_, degree_.highest + k, 1.0 / factorial(k));
  if (system_.f.varies) {
    forcing_.remaining_rate(t_, k, outputs_.get());
    const ReadArray extra(outputs_.get());
    const WriteArray a(a_.get());
    for (std::size_t b = 0; b < constraints(); ++b)
      a[static_cast<PetscInt>(b)] += extra[static_cast<PetscInt>(at(b, levels(b)))] / factorial(k);
  }
}

void SmoothFlow::find_terms(int k) {
  check(VecCopy(X_[static_cast<std::size_t>(k)].get(), work_.get()));
  check(VecAbs(work_.get()));
  const Vector sum = duplicate(work_.get());
  check(MatMult(abs_A_.get(), work_.get(), sum.get()));
  if (system_.f.any) system_.f.add_bound_to(sum.get(), k, 1.0 / factorial(k));
  check(MatMult(abs_last_.get(), sum.get(), terms_.get()));
  if (offset_ != nullptr) offset_->add_bound_to(terms_.get(), degree_.highest + k, 1.0 / factorial(k));
}

// Who of those that touch stays, by the k-th derivative: 0 <= a + M Lambda _|_ Lambda >= 0.
bool SmoothFlow::decide(int k) {
  find_terms(k);
  if (coupled_ && !solve_contact_problem()) return false;
  const ReadArray a(a_.get());
  const ReadArray lambda(lambda_now_.get());
  const ReadArray terms(terms_.get());
  bool undecided = false;
  for (std::size_t b = 0; b < constraints(); ++b) {
    if (tied_[b] == 0) continue;
    const auto i = static_cast<PetscInt>(b);
    const double s = sign(wall_of(b)), small = tie * terms[i];
    const double pull = coupled_ ? -s * lambda[i] * degree_.markov_diagonal[b] : s * a[i];
    const double leaves = coupled_ ? s * leaving_[b] : s * a[i];
    if (pull < -small) {
      contact_[b] = wall_of(b);
    } else if (leaves > small) {
      leading_[b] = levels(b) + k;
    } else {
      undecided = true;
      continue;
    }
    tied_[b] = 0;
  }
  undecided_ = anywhere(system_.comm(), undecided);
  return true;
}

// The mixed complementarity problem of constraints that share inputs, certified like any step.
bool SmoothFlow::solve_contact_problem() {
  Vector lower = duplicate(a_.get()), upper = duplicate(a_.get()), q = duplicate(a_.get()),
         start = duplicate(a_.get());
  check(VecSet(start.get(), 0.0));
  {
    const ReadArray a(a_.get());
    const WriteArray l(lower.get());
    const WriteArray u(upper.get());
    const WriteArray right(q.get());
    for (std::size_t b = 0; b < constraints(); ++b) {
      const auto i = static_cast<PetscInt>(b);
      const bool one_sided = tied_[b] != 0;
      const bool takes_part = one_sided || contact_[b] != Side::none;
      l[i] = one_sided && wall_of(b) == Side::lower ? 0.0 : PETSC_NINFINITY;
      u[i] = one_sided && wall_of(b) == Side::upper ? 0.0 : PETSC_INFINITY;
      right[i] = takes_part ? a[i] : 0.0;
    }
  }
  AffineVi vi(masked_markov(true), std::move(q), std::move(lower), std::move(upper), std::move(start));
  NonlinearSolver snes;
  check(SNESCreate(system_.comm(), snes.put()));
  StepSolver solver(snes.get(), vi);
  const StepReport report = solver.solve(Step{1, t_, t_, 0.0});
  if (!report.certified) return false;
  check(VecCopy(solver.solution(), lambda_now_.get()));
  leaving_ = values_of(solver.residual());
  return true;
}

// M with the rows of free constraints replaced by the identity's: their Lambda is 0.
Matrix SmoothFlow::masked_markov(bool with_tied) const {
  const LocalRange range = row_range(degree_.markov.get());
  RowBuilder rows;
  for (std::size_t b = 0; b < constraints(); ++b) {
    const PetscInt row = range.first + static_cast<PetscInt>(b);
    if ((with_tied && tied_[b] != 0) || contact_[b] != Side::none)
      rows.add(get_row(degree_.markov.get(), row));
    else
      rows.add(row, 1.0);
    rows.end_row();
  }
  return rows.finish(system_.comm(), range.size());
}

// M Lambda_k = -a_k on those in contact.
bool SmoothFlow::find_multipliers() {
  {
    const ReadArray a(a_.get());
    const WriteArray lambda(lambda_now_.get());
    for (std::size_t b = 0; b < constraints(); ++b) {
      const auto i = static_cast<PetscInt>(b);
      const double right = contact_[b] != Side::none ? -a[i] : 0.0;
      lambda[i] = coupled_ ? right : right / degree_.markov_diagonal[b];
    }
  }
  if (!coupled_) return true;
  if (anywhere(system_.comm(), !contact_matrix_ || factored_ != contact_)) {
    contact_matrix_ = masked_markov(false);
    factored_ = contact_;
    if (!contact_solver_) {
      check(KSPCreate(system_.comm(), contact_solver_.put()));
      check(KSPSetOptionsPrefix(contact_solver_.get(), "sweepvi_contact_"));
      default_to_mumps(contact_solver_.get());
      // Many solves with small matrices, whose principal minors do not vanish: MUMPS is ten times slower.
      PC pc = nullptr;
      int ranks = 1;
      MPI_Comm_size(system_.comm(), &ranks);
      check(KSPGetPC(contact_solver_.get(), &pc));
      if (ranks == 1) check(PCFactorSetMatSolverType(pc, MATSOLVERPETSC));
      check_options(KSPSetFromOptions(contact_solver_.get()));
    }
    check(KSPSetOperators(contact_solver_.get(), contact_matrix_.get(), contact_matrix_.get()));
  }
  const Vector right = duplicate(lambda_now_.get());
  check(VecCopy(lambda_now_.get(), right.get()));
  if (solve(contact_solver_.get(), contact_matrix_.get(), right.get(), lambda_now_.get())) return true;
  contact_matrix_.reset();
  return false;
}

// The next term of x, w and lambda.
bool SmoothFlow::next() {
  const int k = known_ - 1;
  const Vec x = X_[static_cast<std::size_t>(k)].get();
  check(MatMult(system_.A.get(), x, rate_.get()));
  if (system_.f.any) system_.f.add_to(rate_.get(), t_, k, 1.0 / factorial(k));
  pushes_.push_back(0.0);
  if (any_contact_) {
    find_acceleration(k);
    if (undecided_ && !decide(k)) return false;
    if (!find_multipliers()) return false;
    check(MatMult(system_.B.get(), lambda_now_.get(), work_.get()));
    check(VecAXPY(rate_.get(), 1.0, work_.get()));
    pushes_.back() = norm(work_.get()) / static_cast<double>(known_);
    lambda_.push_back(values_of(lambda_now_.get()));
  }
  if (X_.size() <= static_cast<std::size_t>(known_)) X_.push_back(duplicate(x));
  const Vec term = X_[static_cast<std::size_t>(known_)].get();
  check(VecCopy(rate_.get(), term));
  check(VecScale(term, 1.0 / static_cast<double>(known_)));
  check(MatMult(system_.C.get(), term, w_now_.get()));
  shifts_.push_back(0.0);
  if (offset_ != nullptr) {
    check(VecSet(a_.get(), 0.0));
    offset_->add_to(a_.get(), t_, known_, 1.0 / factorial(known_));
    check(VecAXPY(w_now_.get(), 1.0, a_.get()));
    shifts_.back() = norm(a_.get());
  }
  w_.push_back(values_of(w_now_.get()));
  for (std::size_t a = 0; a < constraints(); ++a)
    if (known_ < levels(a)) w_.back()[a] = z_[at(a, known_ + 1)] / factorial(known_);
  norms_.push_back(norm(term));
  ++known_;
  return true;
}

// What a term may be over this length and be left out: the error allowed, or rounding of the largest term. A
// state that rests in contact is 0 for as long as it does, and begins to grow with a power of tau when it is
// let go.
double SmoothFlow::negligible(const std::vector<double>& terms, double length, double rate) const {
  double largest = 0.0, power = 1.0;
  for (const double term : terms) {
    largest = std::max(largest, term * power);
    power *= length;
  }
  return std::max(rate * length * std::max(norms_[0], norms_[1] * length), lost * largest);
}

// Two terms in a row: signals may have only odd ones.
bool SmoothFlow::has_converged(double length, double rate) const {
  for (const std::vector<double>* terms : {&norms_, &pushes_, &shifts_}) {
    const double small = negligible(*terms, length, rate);
    for (auto k = static_cast<std::size_t>(known_ - 2); k < static_cast<std::size_t>(known_); ++k)
      if (!((*terms)[k] * std::pow(length, k) <= small)) return false;
  }
  return true;
}

std::optional<double> SmoothFlow::expand(double length, double rate) {
  const int least = std::max(4, degree_.highest + 2);
  while (true) {
    if (!std::isfinite(norms_[static_cast<std::size_t>(known_ - 1)])) return std::nullopt;
    if (known_ > least && has_converged(length, rate)) return length;
    if (known_ == most_terms) break;
    if (!next()) return std::nullopt;
  }
  for (const std::vector<double>* terms : {&norms_, &pushes_, &shifts_})
    for (std::size_t k = most_terms - 2; k < most_terms; ++k)
      length = std::min(length, 0.9 * convergent_length(*terms, k, length, rate));
  return length;
}

// Over which term k is negligible.
double SmoothFlow::convergent_length(const std::vector<double>& terms, std::size_t k, double length,
                                     double rate) const {
  if (terms[k] == 0.0) return PETSC_INFINITY;
  const double size = std::max(norms_[0], norms_[1] * length);
  double longest = std::pow(rate * size / terms[k], 1.0 / static_cast<double>(k - 1));
  for (std::size_t j = 0; j + 2 < most_terms; ++j)
    longest = std::max(longest, std::pow(lost * terms[j] / terms[k], 1.0 / static_cast<double>(k - j)));
  return longest;
}

// The distance from a wall: coefficients that are 0 in exact arithmetic are exactly so.
std::vector<double> SmoothFlow::guard(std::size_t a, Side wall) const {
  std::vector<double> coefficients(static_cast<std::size_t>(known_));
  const double s = sign(wall);
  for (std::size_t k = 0; k < coefficients.size(); ++k)
    coefficients[k] = s * w_[k][a];
  if (wall == Side::upper) coefficients[0] += upper_[a];
  if (leading_[a] > 0 && wall == wall_of(a))
    std::fill_n(coefficients.begin(),
                std::min<std::size_t>(coefficients.size(), static_cast<std::size_t>(leading_[a])), 0.0);
  return coefficients;
}

std::optional<double> SmoothFlow::event_of(std::size_t a, double length) const {
  if (contact_[a] != Side::none) {
    if (tied_[a] != 0) return std::nullopt;  // weightless
    std::vector<double> pull(lambda_.size());
    for (std::size_t k = 0; k < pull.size(); ++k)
      pull[k] = sign(contact_[a]) * lambda_[k][a];
    return first_root(pull, length);
  }
  std::optional<double> first = first_root(guard(a, Side::lower), length);
  if (upper_[a] < PETSC_INFINITY)
    if (const auto other = first_root(guard(a, Side::upper), length); other && (!first || *other < *first))
      first = other;
  return first;
}

std::optional<double> SmoothFlow::first_event(double length) {
  std::vector<double> when(constraints(), PETSC_INFINITY);
  double first = PETSC_INFINITY;
  for (std::size_t a = 0; a < constraints(); ++a) {
    if (const auto root = event_of(a, length)) when[a] = *root;
    first = std::min(first, when[a]);
  }
  MPI_Allreduce(MPI_IN_PLACE, &first, 1, MPI_DOUBLE, MPI_MIN, system_.comm());
  const double last = first + together * (std::abs(t_) + length);
  for (std::size_t a = 0; a < constraints(); ++a)
    meets_[a] = when[a] <= last ? 1 : 0;
  return first < PETSC_INFINITY ? std::optional(first) : std::nullopt;
}

void SmoothFlow::evaluate(double tau, bool at_event, Vec x, std::vector<double>& z, std::vector<double>& mu) {
  check(VecCopy(X_[static_cast<std::size_t>(known_ - 1)].get(), x));
  for (int k = known_ - 2; k >= 0; --k)
    check(VecAYPX(x, tau, X_[static_cast<std::size_t>(k)].get()));
  for (std::size_t a = 0; a < constraints(); ++a) {
    if (contact_[a] != Side::none) {
      for (std::size_t k = lambda_.size(); k-- > 0;)
        mu[a] += lambda_[k][a] * std::pow(tau, k + 1) / static_cast<double>(k + 1);
      for (int i = 1; i <= levels(a); ++i)
        z[at(a, i)] = i == 1 && contact_[a] == Side::upper ? upper_[a] : 0.0;
      continue;
    }
    const Side wall = leading_[a] > 0 ? wall_of(a) : Side::lower;
    std::vector<double> distance = guard(a, wall);
    for (int i = 1; i <= levels(a); ++i) {
      z[at(a, i)] =
          sign(wall) * polynomial(distance, tau) + (i == 1 && wall == Side::upper ? upper_[a] : 0.0);
      for (std::size_t k = 1; k < distance.size(); ++k)
        distance[k - 1] = static_cast<double>(k) * distance[k];
      distance.back() = 0.0;
    }
    if (!at_event || meets_[a] == 0) continue;
    double& z1 = z[at(a, 1)];
    z1 = std::abs(z1) <= std::abs(upper_[a] - z1) ? 0.0 : upper_[a];
  }
  if (at_event || any_contact_) project(x, t_ + tau, at_event);
}

// To the outputs' own g: level i is the (i-1)-th derivative.
void SmoothFlow::add_offset(double t) {
  for (int i = 1; i <= degree_.highest; ++i) {
    check(VecSet(w_now_.get(), 0.0));
    offset_->add_to(w_now_.get(), t, i - 1, 1.0);
    const ReadArray moved(w_now_.get());
    const WriteArray g(g_.get());
    for (std::size_t a = 0; a < constraints(); ++a)
      g[static_cast<PetscInt>(at(a, i))] += moved[static_cast<PetscInt>(a)];
  }
}

void SmoothFlow::put_in_contact(const std::vector<Side>& contact, double t, Vec x) {
  contact_ = contact;
  project(x, t, false);
}

// Rounding and truncation leave outputs that are known: back along their directions. In contact these are
// all, at an event the first.
void SmoothFlow::project(Vec x, double t, bool at_event) {
  forcing_.evaluate(t, g_.get());
  if (offset_ != nullptr) add_offset(t);
  for (int sweep = 0; sweep < (coupled_ ? 1 + degree_.highest : 1); ++sweep) {
    check(MatMultAdd(degree_.Z.get(), x, g_.get(), outputs_.get()));
    {
      const WriteArray values(outputs_.get());
      for (std::size_t a = 0; a < constraints(); ++a)
        for (int i = 1; i <= levels(a); ++i) {
          double& value = values[static_cast<PetscInt>(at(a, i))];
          const bool holds = contact_[a] != Side::none;
          if (!holds && !(at_event && meets_[a] != 0 && i == 1))
            value = 0.0;
          else if (i == 1 &&
                   (holds ? contact_[a] == Side::upper : std::abs(value) > std::abs(upper_[a] - value)))
            value -= upper_[a];
        }
    }
    check(VecScale(outputs_.get(), -1.0));
    check(MatMultTransposeAdd(degree_.directions.get(), outputs_.get(), x, x));
  }
}

}  // namespace sweepvi
