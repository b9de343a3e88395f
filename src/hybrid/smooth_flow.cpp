#include "hybrid/smooth_flow.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "dvi/level_state.hpp"
#include "hybrid/first_root.hpp"
#include "hybrid/series_terms.hpp"
#include "petsc/agreement.hpp"
#include "petsc/sparse.hpp"

namespace sweepvi {

namespace {

constexpr int decisive_terms = 8;  // derivatives that may say whether a contact is left
constexpr double noisy = 64.0 * std::numeric_limits<double>::epsilon();  // an output, relative to its terms

using Numbers = std::vector<double>;

double fastest_of(const Forcing& forcing) {
  double fastest = 0.0;
  for (const Forcing::Entry& entry : forcing.varying)
    fastest = std::max(fastest, 2.0 * std::numbers::pi * std::abs(entry.signal.frequency));
  return fastest;
}

}  // namespace

SmoothFlow::SmoothFlow(const LinearSystem& system, const RelativeDegree& degree, const Forcing* offset,
                       std::vector<char> equations, int most_terms)
    : most_terms_(std::min(most_terms, enough_terms)),
      system_(system),
      degree_(degree),
      offset_(offset),
      equation_(std::move(equations)),
      forcing_(system, degree),
      forces_(system, degree) {
  const std::size_t count = degree.degree.size();
  const PetscInt first = row_range(degree.Z.get()).first;
  const PetscInt first_constraint = row_range(system.C.get()).first;
  const PetscInt columns = column_range(degree.Z.get()).size();
  RowBuilder rows, direct;
  for (std::size_t a = 0; a < count; ++a) {
    if (degree.degree[a] > 0)
      rows.add(get_row(degree.Z.get(), first + degree.first_level[a + 1] - 1));
    else
      direct.add(get_row(system.C.get(), first_constraint + static_cast<PetscInt>(a)));
    rows.end_row();
    direct.end_row();
  }
  last_rows_ = rows.finish(system.comm(), columns);
  abs_A_ = absolute_copy(system.A.get());
  abs_B_ = absolute_copy(system.B.get());
  abs_Z_ = absolute_copy(degree.Z.get());
  abs_last_ = absolute_copy(last_rows_.get());
  any_direct_ = degree.lowest == 0;
  direct_rows_ = direct.finish(system.comm(), columns);
  if (any_direct_)
    abs_direct_ = absolute_copy(direct_rows_.get());
  else
    direct_rows_.reset();
  equation_.resize(count, 0);
  upper_.assign(count, PETSC_INFINITY);
  if (system.wmax) copy_to(system.wmax.get(), upper_);
  fastest_ = std::max(fastest_of(system.f), offset != nullptr ? fastest_of(*offset) : 0.0);
  MPI_Allreduce(MPI_IN_PLACE, &fastest_, 1, MPI_DOUBLE, MPI_MAX, system.comm());
  for (Vector* vector : {&rate_, &work_, &bound_, &bound_next_})
    *vector = duplicate(system.x0.get());
  for (Vector* vector : {&w_now_, &w_terms_})
    *vector = duplicate(system.w0.get());
  check(MatCreateVecs(degree.Z.get(), nullptr, outputs_.put()));
  g_ = duplicate(outputs_.get());
  contact_.assign(count, Side::none);
  wall_.assign(count, Side::none);
  stand_.assign(count, Stand::away);
  for (std::vector<int>* zeros : {&leading_, &pull_leading_})
    zeros->assign(count, 0);
  for (std::vector<char>* flags : {&tied_, &weightless_})
    flags->assign(count, 0);
  for (Numbers* numbers : {&a_, &lambda_now_, &rest_, &small_, &least_})
    numbers->assign(count, 0.0);
  meeting_.assign(static_cast<std::size_t>(degree.first_level.back()), 0);
  moving_.assign(meeting_.size(), 0.0);
  for (int i = 1; offset_ != nullptr && i <= degree.highest; ++i) {
    check(VecSet(w_now_.get(), 0.0));
    offset_->add_bound_to(w_now_.get(), i - 1, 1.0);
    const ReadArray bound(w_now_.get());
    for (std::size_t a = 0; a < count; ++a)
      if (i <= levels(a)) moving_[at(a, i)] = bound[static_cast<PetscInt>(a)];
  }
  PetscInt local = 0;
  check(VecGetLocalSize(system.x0.get(), &local));
  traversed_.assign(static_cast<std::size_t>(local), 0.0);
}

// Outputs ------------------------------------------------------------------------------------------------

void SmoothFlow::evaluate_forcing(double t) {
  forcing_.evaluate(t, g_.get());
  for (int i = 1; offset_ != nullptr && i <= degree_.highest; ++i) {  // the (i-1)-th derivative on level i
    check(VecSet(w_now_.get(), 0.0));
    offset_->add_to(w_now_.get(), t, i - 1, 1.0);
    const ReadArray moved(w_now_.get());
    const WriteArray g(g_.get());
    for (std::size_t a = 0; a < constraints(); ++a)
      if (i <= levels(a)) g[static_cast<PetscInt>(at(a, i))] += moved[static_cast<PetscInt>(a)];
  }
}

void SmoothFlow::find_outputs(double t, Vec x, Outputs& to) {
  evaluate_forcing(t);
  check(MatMultAdd(degree_.Z.get(), x, g_.get(), outputs_.get()));
  copy_to(outputs_.get(), to.z);
  {
    const ReadArray now(x);
    const WriteArray sizes(work_.get());
    for (PetscInt i = 0; i < now.size(); ++i)
      sizes[i] = std::max(std::abs(now[i]), traversed_[static_cast<std::size_t>(i)]);
  }
  check(MatMult(abs_Z_.get(), work_.get(), outputs_.get()));
  copy_to(outputs_.get(), to.terms);
  const ReadArray g(g_.get());
  to.noise.resize(to.terms.size());
  for (std::size_t q = 0; q < to.terms.size(); ++q) {
    to.terms[q] += std::max(std::abs(g[static_cast<PetscInt>(q)]), moving_[q]);
    to.noise[q] = noisy * to.terms[q];
  }
}

bool SmoothFlow::place(double t, Vec x, const std::vector<char>& known) {
  t_ = t;
  find_outputs(t, x, at_begin_);
  std::array<int, 3> found{};  // out, touching, at a wall
  for (std::size_t a = 0; a < constraints(); ++a) {
    Stand stand = Stand::touching;
    wall_[a] = Side::lower;
    leading_[a] = levels(a);
    if (levels(a) > 0) {
      double& z1 = at_begin_.z[at(a, 1)];
      const double from_upper = z1 - upper_[a];
      const bool above = std::abs(from_upper) < std::abs(z1);
      const bool stands =
          known[at(a, 1)] != 0 || std::abs(above ? from_upper : z1) <= at_begin_.noise[at(a, 1)];
      wall_[a] = above ? Side::upper : Side::lower;
      if (stands)
        z1 = above ? upper_[a] : 0.0;
      else
        stand = z1 < 0.0 || from_upper > 0.0 || equation_[a] != 0 ? Stand::out : Stand::away;
      for (int i = 2; i <= levels(a) && stand == Stand::touching; ++i) {
        double& output = at_begin_.z[at(a, i)];
        leading_[a] = i - 1;
        if (known[at(a, i)] != 0 || std::abs(output) <= at_begin_.noise[at(a, i)])
          output = 0.0;
        else
          stand = sign(wall_[a]) * output < 0.0 ? Stand::out : Stand::leaving;
      }
      if (stand == Stand::touching) leading_[a] = levels(a);
      if (!stands) leading_[a] = 0;
      if (stands) found[2] = 1;
    }
    stand_[a] = stand;
    if (stand == Stand::out) found[0] = 1;
    if (stand == Stand::touching) found[1] = 1;
  }
  MPI_Allreduce(MPI_IN_PLACE, found.data(), 3, MPI_INT, MPI_LOR, system_.comm());
  any_touching_ = found[1] != 0;
  any_at_wall_ = found[2] != 0;
  return found[0] != 0;
}

// Outputs that stand nowhere are then those of x. States that a move has brought to 0 up to rounding of what
// they were are 0: there is nothing else that a jump could judge what is left of them against.
void SmoothFlow::pull_in(Vec x) {
  if (!any_at_wall_) return;
  check(VecCopy(x, work_.get()));
  move_to_walls(x, leading_);
  {
    const ReadArray before(work_.get());
    const WriteArray now(x);
    for (PetscInt i = 0; i < now.size(); ++i) {
      const double size = std::max(std::abs(before[i]), traversed_[static_cast<std::size_t>(i)]);
      if (now[i] != before[i] && std::abs(now[i]) <= lost * size) now[i] = 0.0;
    }
  }
  check(MatMultAdd(degree_.Z.get(), x, g_.get(), outputs_.get()));
  const ReadArray moved(outputs_.get());
  for (std::size_t a = 0; a < constraints(); ++a)
    for (int i = leading_[a] + 1; i <= levels(a); ++i)
      at_begin_.z[at(a, i)] = moved[static_cast<PetscInt>(at(a, i))];
}

// A direction of a level moves outputs of its own depth r - i and of lesser ones: deepest first.
void SmoothFlow::move_to_walls(Vec x, const std::vector<int>& leading) {
  const int sweeps = forces_.coupled() ? 2 * degree_.highest : 1;
  std::vector<char> set(constraints());
  Numbers defect(constraints());
  for (int sweep = 0; sweep < sweeps; ++sweep) {
    const int depth = degree_.highest - 1 - sweep / 2;
    check(MatMultAdd(degree_.Z.get(), x, g_.get(), outputs_.get()));
    if (forces_.coupled()) {
      const ReadArray z(outputs_.get());
      for (std::size_t a = 0; a < constraints(); ++a) {
        const int level = levels(a) - depth;
        set[a] = level >= 1 && level <= leading[a] ? 1 : 0;
        defect[a] = set[a] == 0 ? 0.0
                                : z[static_cast<PetscInt>(at(a, level))] -
                                      (level == 1 && wall_[a] == Side::upper ? upper_[a] : 0.0);
      }
    }
    if (forces_.coupled() && !forces_.solve(set, defect)) return;
    {
      const WriteArray z(outputs_.get());
      for (std::size_t a = 0; a < constraints(); ++a)
        for (int i = 1; i <= levels(a); ++i) {
          double& value = z[static_cast<PetscInt>(at(a, i))];
          if (i > leading[a] || (forces_.coupled() && levels(a) - i != depth))
            value = 0.0;
          else if (forces_.coupled())
            value = -defect[a] * degree_.markov_diagonal[a];
          else
            value = (i == 1 && wall_[a] == Side::upper ? upper_[a] : 0.0) - value;
        }
    }
    check(MatMultTransposeAdd(degree_.directions.get(), outputs_.get(), x, x));
  }
}

bool SmoothFlow::push_out(double t, Vec x, Numbers& pushes) {
  std::vector<Role> roles(constraints(), Role::off);
  std::vector<Side> guess(constraints(), Side::none);
  Numbers distance(constraints(), 0.0), small(constraints(), 0.0), rest;
  for (std::size_t a = 0; a < constraints(); ++a) {
    if (levels(a) == 0) continue;
    roles[a] = wall_[a] == Side::upper ? Role::upper : Role::lower;
    distance[a] = at_begin_.z[at(a, 1)] - (wall_[a] == Side::upper ? upper_[a] : 0.0);
    small[a] = at_begin_.noise[at(a, 1)];
    if (sign(wall_[a]) * distance[a] < 0.0) guess[a] = wall_[a];
  }
  if (!forces_.complement(t, roles, distance, small, guess, pushes, rest)) return false;
  check(VecSet(outputs_.get(), 0.0));
  {
    const WriteArray z(outputs_.get());
    for (std::size_t a = 0; a < constraints(); ++a)
      if (levels(a) > 0) z[static_cast<PetscInt>(at(a, 1))] = pushes[a] * degree_.markov_diagonal[a];
  }
  check(MatMultTransposeAdd(degree_.directions.get(), outputs_.get(), x, x));
  return true;
}

// Who stays in contact -----------------------------------------------------------------------------------

void SmoothFlow::reset_terms(Vec x) {
  if (X_.empty()) X_.push_back(duplicate(x));
  if (x != X_[0].get()) check(VecCopy(x, X_[0].get()));
  known_ = 1;
  lambda_.clear();
  w_.assign(1, Numbers(constraints(), 0.0));
  for (std::size_t a = 0; a < constraints(); ++a)
    if (levels(a) > 0) w_[0][a] = at_begin_.z[at(a, 1)];
}

bool SmoothFlow::choose(Vec x, const std::vector<Side>& guess) {
  reset_terms(x);
  guess_ = guess;
  for (std::size_t a = 0; a < constraints(); ++a) {
    tied_[a] = stand_[a] == Stand::touching && equation_[a] == 0 ? 1 : 0;
    contact_[a] = equation_[a] != 0 ? Side::lower : Side::none;
    weightless_[a] = 0;
    pull_leading_[a] = 0;
    least_[a] = 0.0;
  }
  any_contact_ = deciding_ = any_touching_;
  if (deciding_) {
    const ReadArray now(x);
    const WriteArray bound(bound_.get());
    for (PetscInt i = 0; i < now.size(); ++i)
      bound[i] = std::max(std::abs(now[i]), traversed_[static_cast<std::size_t>(i)]);
  }
  for (int k = 0; deciding_ && k < decisive_terms; ++k)
    if (!next()) return false;
  deciding_ = false;
  // What is left is held by no force: it stays until something moves it.
  for (std::size_t a = 0; a < constraints(); ++a) {
    if (tied_[a] == 0) continue;
    contact_[a] = wall_[a];
    weightless_[a] = 1;
  }
  any_contact_ = anywhere(system_.comm(), std::any_of(contact_.begin(), contact_.end(),
                                                      [](Side side) { return side != Side::none; }));
  reset_terms(X_[0].get());
  return true;
}

void SmoothFlow::begin_again(double t, Vec x) {
  t_ = t;
  find_outputs(t, x, at_begin_);
  for (std::size_t a = 0; a < constraints(); ++a)
    for (int i = 1; i <= std::min(levels(a), leading_[a]); ++i)
      at_begin_.z[at(a, i)] = i == 1 && wall_[a] == Side::upper ? upper_[a] : 0.0;
  any_contact_ = anywhere(system_.comm(), std::any_of(contact_.begin(), contact_.end(),
                                                      [](Side side) { return side != Side::none; }));
  reset_terms(x);
}

// Who of those that touch stays, by the k-th derivative.
bool SmoothFlow::decide(int k) {
  check(MatMult(abs_A_.get(), bound_.get(), bound_next_.get()));
  if (system_.f.any) system_.f.add_bound_to(bound_next_.get(), k, 1.0 / factorial(k));
  check(MatMult(abs_last_.get(), bound_next_.get(), w_terms_.get()));
  if (offset_ != nullptr) offset_->add_bound_to(w_terms_.get(), degree_.highest + k, 1.0 / factorial(k));
  if (any_direct_) {
    check(MatMultAdd(abs_direct_.get(), bound_.get(), w_terms_.get(), w_terms_.get()));
    const ReadArray w0(system_.w0.get());
    const WriteArray terms(w_terms_.get());
    for (std::size_t a = 0; k == 0 && a < constraints(); ++a)
      if (levels(a) == 0) terms[static_cast<PetscInt>(a)] += std::abs(w0[static_cast<PetscInt>(a)]);
  }
  copy_to(w_terms_.get(), small_);
  for (double& value : small_)
    value *= tie;
  std::vector<Role> roles(constraints(), Role::off);
  for (std::size_t a = 0; a < constraints(); ++a) {
    if (tied_[a] != 0 && levels(a) == 0 && k == 0)
      roles[a] = Role::between;
    else if (tied_[a] != 0)
      roles[a] = wall_[a] == Side::upper ? Role::upper : Role::lower;
    else if (contact_[a] != Side::none)
      roles[a] = Role::holds;
  }
  if (!forces_.complement(t_, roles, a_, small_, guess_, lambda_now_, rest_)) return false;
  const Numbers least = forces_.negligible(roles, rest_, small_);
  if (k == 0) least_ = least;
  bool undecided = false;
  for (std::size_t a = 0; a < constraints(); ++a) {
    if (tied_[a] == 0) continue;
    double rest = rest_[a];
    if (roles[a] == Role::between) {  // which wall it is about
      wall_[a] = lambda_now_[a] < -least[a] || (lambda_now_[a] <= least[a] && rest > 0.5 * upper_[a])
                     ? Side::upper
                     : Side::lower;
      if (wall_[a] == Side::upper) rest -= upper_[a];
    }
    const double s = sign(wall_[a]);
    if (s * lambda_now_[a] > least[a]) {
      contact_[a] = wall_[a];
      pull_leading_[a] = k;
    } else if (s * rest > small_[a]) {
      leading_[a] = levels(a) + k;
      stand_[a] = Stand::leaving;
    } else {
      undecided = true;
      continue;
    }
    tied_[a] = 0;
  }
  deciding_ = anywhere(system_.comm(), undecided);
  // What the next term is made of.
  {
    const WriteArray sizes(w_now_.get());
    for (std::size_t a = 0; a < constraints(); ++a)
      sizes[static_cast<PetscInt>(a)] = std::abs(lambda_now_[a]);
  }
  check(MatMultAdd(abs_B_.get(), w_now_.get(), bound_next_.get(), bound_.get()));
  check(VecScale(bound_.get(), 1.0 / static_cast<double>(k + 1)));
  return true;
}

// Events -------------------------------------------------------------------------------------------------

// The distance from a wall: coefficients that are 0 in exact arithmetic are exactly so.
Numbers SmoothFlow::distance(std::size_t a, Side wall) const {
  Numbers coefficients(levels(a) > 0 ? w_.size() : lambda_.size());
  const double s = sign(wall);
  for (std::size_t k = 0; k < coefficients.size(); ++k)
    coefficients[k] = s * w_[k][a];
  if (wall == Side::upper) coefficients[0] += upper_[a];
  if (wall == wall_[a])
    std::fill_n(coefficients.begin(), std::min(coefficients.size(), static_cast<std::size_t>(leading_[a])),
                0.0);
  return coefficients;
}

std::optional<double> SmoothFlow::event_of(std::size_t a, double length) const {
  if (equation_[a] != 0) return std::nullopt;
  if (contact_[a] != Side::none) {
    Numbers pull(lambda_.size());
    for (std::size_t k = 0; k < pull.size(); ++k)
      pull[k] = sign(contact_[a]) * lambda_[k][a];
    std::fill_n(pull.begin(), std::min(pull.size(), static_cast<std::size_t>(pull_leading_[a])), 0.0);
    if (pull.empty()) return std::nullopt;
    if (weightless_[a] != 0) pull[0] = std::max(0.0, pull[0]) + least_[a];
    return first_crossing(pull, length, noisy * lambda_scale_[a]);  // to vanish for an instant is to stay
  }
  // Without a velocity of its own it is no event to touch a wall, up to rounding, and to turn back.
  const double noise = levels(a) == 1 ? at_begin_.noise[at(a, 1)] : 0.0;
  const auto meets = [&](Side wall) { return first_crossing(distance(a, wall), length, noise); };
  std::optional<double> first = meets(Side::lower);
  if (upper_[a] < PETSC_INFINITY)
    if (const auto other = meets(Side::upper); other && (!first || *other < *first)) first = other;
  return first;
}

std::optional<double> SmoothFlow::first_event(double length) {
  Numbers when(constraints(), PETSC_INFINITY);
  double first = PETSC_INFINITY;
  for (std::size_t a = 0; a < constraints(); ++a) {
    if (const auto root = event_of(a, length)) when[a] = *root;
    first = std::min(first, when[a]);
  }
  MPI_Allreduce(MPI_IN_PLACE, &first, 1, MPI_DOUBLE, MPI_MIN, system_.comm());
  std::fill(meeting_.begin(), meeting_.end(), 0);
  for (std::size_t a = 0; a < constraints(); ++a)
    if (levels(a) > 0 && contact_[a] == Side::none && when[a] < PETSC_INFINITY &&
        when[a] <= first * (1.0 + lost))
      meeting_[at(a, 1)] = 1;
  return first < PETSC_INFINITY ? std::optional(first) : std::nullopt;
}

Outputs SmoothFlow::outputs(double tau, Vec x) {
  Outputs now;
  find_outputs(t_ + tau, x, now);
  for (std::size_t a = 0; a < constraints(); ++a) {
    if (levels(a) == 0) continue;
    double& z1 = now.z[at(a, 1)];
    if (contact_[a] != Side::none) {
      for (int i = 1; i <= levels(a); ++i)
        now.z[at(a, i)] = i == 1 && contact_[a] == Side::upper ? upper_[a] : 0.0;
    } else if (z1 < 0.0 && z1 >= -now.noise[at(a, 1)]) {
      z1 = 0.0;
    } else if (z1 > upper_[a] && z1 <= upper_[a] + now.noise[at(a, 1)]) {
      z1 = upper_[a];
    }
  }
  return now;
}

void SmoothFlow::hold(double tau, Vec x) {
  if (!any_contact_) return;
  evaluate_forcing(t_ + tau);
  std::vector<int> held(constraints(), 0);
  for (std::size_t a = 0; a < constraints(); ++a)
    if (contact_[a] != Side::none) held[a] = levels(a);
  move_to_walls(x, held);
}

Numbers SmoothFlow::w(double tau, const Outputs& outputs) const {
  Numbers values(constraints());
  for (std::size_t a = 0; a < constraints(); ++a) {
    if (levels(a) > 0)
      values[a] = outputs.z[at(a, 1)];
    else if (contact_[a] != Side::none)
      values[a] = contact_[a] == Side::upper ? upper_[a] : 0.0;
    else
      values[a] = wall_[a] == Side::upper
                      ? std::min(upper_[a], upper_[a] - polynomial(distance(a, Side::upper), tau))
                      : std::max(0.0, polynomial(distance(a, Side::lower), tau));
  }
  return values;
}

void SmoothFlow::add_measures(double from, double to, Numbers& mu) const {
  for (std::size_t a = 0; a < constraints(); ++a) {
    if (contact_[a] == Side::none) continue;
    Numbers integral(lambda_.size() + 1, 0.0);
    for (std::size_t k = 0; k < lambda_.size(); ++k)
      integral[k + 1] = lambda_[k][a] / static_cast<double>(k + 1);
    mu[a] += polynomial(integral, to) - (from > 0.0 ? polynomial(integral, from) : 0.0);
  }
}

double SmoothFlow::excursion(std::size_t a, double tau) const {
  const Numbers coefficients = distance(a, wall_[a]);
  double largest = 0.0;
  for (int i = 1; i <= 8; ++i)
    largest = std::max(largest, std::abs(polynomial(coefficients, 0.125 * i * tau)));
  return largest;
}

void SmoothFlow::visit(const Show& states, const Show& constraints) {
  const auto small = [&](const char* name, auto& values) {
    using Small = typename std::decay_t<decltype(values)>::value_type;
    Numbers numbers;
    for (const Small value : values)
      numbers.push_back(static_cast<double>(value));
    constraints(name, numbers);
    for (std::size_t a = 0; a < numbers.size(); ++a)
      values[a] = static_cast<Small>(static_cast<int>(numbers[a]));
  };
  small("stand", stand_);
  small("wall", wall_);
  small("leading", leading_);
  small("pull leading", pull_leading_);
  small("contact", contact_);
  small("weightless", weightless_);
  constraints("least", least_);
  states("traversed", traversed_);
}

}  // namespace sweepvi
