#include "dvi/zhuravlev_ivanov.hpp"

#include <petsc/private/petscimpl.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "petsc/sparse.hpp"
#include "sweepvi/scheme.hpp"
#include "vi/natural_residual.hpp"

namespace sweepvi {

namespace {

/// Of one oscillator, one after the other.
enum Unknown { of_s, of_v, of_lambda_s, of_lambda_v, unknowns };

OscillatorState state_at(const double* u, PetscInt i) {
  const double* own = u + std::ptrdiff_t{unknowns} * i;
  return {own[of_s], own[of_v], own[of_lambda_s], own[of_lambda_v]};
}

void put(const OscillatorState& state, double* u, PetscInt i) {
  double* own = u + std::ptrdiff_t{unknowns} * i;
  own[of_s] = state.s;
  own[of_v] = state.v;
  own[of_lambda_s] = state.lambda_s;
  own[of_lambda_v] = state.lambda_v;
}

double sign(double value) {
  return value > 0.0 ? 1.0 : value < 0.0 ? -1.0 : 0.0;
}

int read_most_sweeps(MPI_Comm comm) {
  PetscInt sweeps = 100;
  const auto read = [&]() -> PetscErrorCode {
    PetscFunctionBeginUser;
    PetscOptionsBegin(comm, nullptr, "sweepvi: guess of zhuravlev-ivanov", "sweepvi");
    PetscCall(
        PetscOptionsInt("-sweepvi_zi_sweeps",
                        "Most sweeps over the oscillators in a step's guess [-], >= 0; 0: the last state",
                        "ImpactDvi", sweeps, &sweeps, nullptr));
    PetscOptionsEnd();
    PetscFunctionReturn(static_cast<PetscErrorCode>(0));  // an enumeration in newer PETSc
  };
  check_options(read());
  if (sweeps < 0) throw InputError("-sweepvi_zi_sweeps must be 0 or more; 100 by default");
  return static_cast<int>(sweeps);
}

}  // namespace

class ZhuravlevIvanov::Oscillators {
public:
  explicit Oscillators(const ZhuravlevIvanov& dvi)
      : kappa_(dvi.kappa_),
        old_(dvi.u_.get()),
        a_(dvi.a_.get()),
        x_(dvi.x_hat_.get()),
        velocity_(dvi.velocity_hat_.get()),
        by_x_(dvi.slope_x_.get()),
        by_velocity_(dvi.slope_velocity_.get()),
        terms_(dvi.force_terms_.get()) {
    step_.h = dvi.h_;
    step_.theta = dvi.options_.theta;
    step_.gamma = dvi.options_.gamma;
    if (!dvi.options_.regulator) return;
    step_.mu1 = dvi.options_.regulator->mu1;
    step_.mu2 = dvi.options_.regulator->mu2;
  }

  OscillatorStep operator[](PetscInt i) const {
    OscillatorStep step = step_;
    step.old = state_at(old_.data(), i);
    step.kappa = kappa_[static_cast<std::size_t>(i)];
    step.a = a_[i] - by_x_[i] * x_[i] - by_velocity_[i] * velocity_[i];
    step.by_x = by_x_[i];
    step.by_velocity = by_velocity_[i];
    step.terms = terms_[i];
    step.velocity_hat = velocity_[i];
    return step;
  }

private:
  const std::vector<double>& kappa_;
  ReadArray old_, a_, x_, velocity_, by_x_, by_velocity_, terms_;
  OscillatorStep step_;  // what all have in common
};

ZhuravlevIvanov::Point::Point(Vec vector) {
  const auto object = reinterpret_cast<PetscObject>(vector);
  check(PetscObjectGetId(object, &id));
  check(PetscObjectStateGet(object, &state));
}

// The communicator is that of the derivatives, and lives as long.
ZhuravlevIvanov::ZhuravlevIvanov(const ImpactOscillators& oscillators, const TimeGrid& grid,
                                 const ImpactOptions& options)
    : oscillators_(oscillators),
      options_(options),
      h_(grid.h()),
      kappa_(oscillators.kappa()),
      derivative_(oscillators) {
  comm_ = PetscObjectComm(reinterpret_cast<PetscObject>(derivative_.by_x()));
  most_sweeps_ = read_most_sweeps(comm_);
  u_ = make_vector(comm_, unknowns * count());
  for (Vector* vector : {&x_, &velocity_, &s_, &v_, &lambda_s_, &lambda_v_, &x_hat_, &velocity_hat_, &a_,
                         &force_terms_, &work_, &inner_, &slope_x_, &slope_velocity_})
    *vector = make_vector(comm_, count());
  oscillators.start(x_.get(), velocity_.get());
  agreed(comm_, [&] { check_options_and_start(); });
  branches_.resize(kappa_.size());
  set_physical(x_.get(), velocity_.get());
}

void ZhuravlevIvanov::check_options_and_start() const {
  require_weight("theta of impact oscillators", options_.theta);
  require_weight("gamma of impact oscillators", options_.gamma);
  for (const double kappa : kappa_)
    if (!(kappa > 0.0 && kappa < 1.0))
      throw InputError("kappa of an impact oscillator is " + std::to_string(kappa) +
                       "; expected between 0 and 1, as e = (1 - kappa)/(1 + kappa)");
  const ReadArray x(x_.get());
  for (PetscInt i = 0; i < x.size(); ++i)
    if (!(x[i] >= 0.0))
      throw InputError("an impact oscillator starts at x = " + std::to_string(x[i]) +
                       "; expected 0 or more, above its wall");
}

Matrix ZhuravlevIvanov::create_jacobian() const {
  const Matrix pattern = oscillators_.pattern();
  const bool damped = oscillators_.reads_velocities();
  RowBuilder rows;
  for_each_row(pattern.get(), [&](PetscInt i, auto neighbours, auto) {
    const auto add = [&](PetscInt j, std::initializer_list<Unknown> read) {
      for (const Unknown unknown : read)
        rows.add(unknowns * j + unknown, 0.0);
    };
    add(i, {of_s, of_v, of_lambda_s, of_lambda_v});
    rows.end_row();
    add(i, {of_s, of_v, of_lambda_s, of_lambda_v});
    for (const PetscInt j : neighbours) {
      add(j, {of_s, of_lambda_s});
      if (damped) add(j, {of_v, of_lambda_v});
    }
    rows.end_row();
    add(i, {of_s, of_lambda_s});
    rows.end_row();
    add(i, {of_v, of_lambda_v});
    rows.end_row();
  });
  return rows.finish(comm_, unknowns * count());
}

// A regulator samples the state at the start of each step and holds its control: with other steps it is
// another one. The same goes for the resampling.
bool ZhuravlevIvanov::set_step(double h) {
  if (options_.regulator || options_.resample) return false;
  h_ = h;
  looked_at_ = Point{};
  ++version_;
  return true;
}

// The step --------------------------------------------------------------------------------------------

void ZhuravlevIvanov::begin(const Step& step, Vec lower, Vec upper, Vec guess) {
  t_hat_ = step.t_old + options_.theta * step.h;
  {
    const WriteArray l(lower);
    const WriteArray b(upper);
    for (PetscInt i = 0; i < count(); ++i) {
      for (const Unknown free : {of_s, of_v}) {
        l[unknowns * i + free] = PETSC_NINFINITY;
        b[unknowns * i + free] = PETSC_INFINITY;
      }
      for (const Unknown boxed : {of_lambda_s, of_lambda_v}) {
        l[unknowns * i + boxed] = -1.0;
        b[unknowns * i + boxed] = 1.0;
      }
    }
  }
  if (options_.resample) start_from(x_.get(), velocity_.get());
  ++version_;  // columns of signs that stand on a bound change with the state
  looked_at_ = Point{};
  check(VecCopy(u_.get(), guess));
  find_accelerations(guess);
  differentiate();
}

/// Each oscillator's step is solved with its neighbours as they are, in the first sweep by the rule; then,
/// where its acceleration turns out to be another than it counted on, again. The guess is the point looked at
/// last, before and after.
bool ZhuravlevIvanov::predict(Vec guess) {
  if (most_sweeps_ == 0) return false;
  find_accelerations(guess);
  find_force_terms();  // good enough for all sweeps: what misfits are told apart by
  {
    const Oscillators oscillators(*this);
    const WriteArray values(guess);
    for (PetscInt i = 0; i < count(); ++i) {
      Branch& branch = branches_[static_cast<std::size_t>(i)];
      branch = choose_branch(oscillators[i]);
      put(branch.state, values.data(), i);
    }
  }
  for (int sweeps = 1; sweeps <= most_sweeps_; ++sweeps) {
    find_accelerations(guess);
    if (!sweep(guess, false)) continue;
    if (sweep(guess, true)) return true;
  }
  return false;
}

/// da/dx and da/dx' at the point looked at last; of linear oscillators once.
void ZhuravlevIvanov::differentiate() {
  if (differentiated_ && oscillators_.linear()) return;
  derivative_.evaluate(t_hat_, x_hat_.get(), velocity_hat_.get());
  differentiated_ = true;
  abs_by_x_ = absolute_copy(derivative_.by_x());
  check(MatGetDiagonal(derivative_.by_x(), slope_x_.get()));
  if (derivative_.by_velocity() == nullptr) return;
  abs_by_velocity_ = absolute_copy(derivative_.by_velocity());
  check(MatGetDiagonal(derivative_.by_velocity(), slope_velocity_.get()));
}

/// x^, x'^ and a(t^, x^, x'^) at u, unless u is the point looked at last.
void ZhuravlevIvanov::find_accelerations(Vec u) {
  const Point point(u);
  if (point == looked_at_) return;
  looked_at_ = point;
  has_force_terms_ = false;
  {
    const ReadArray values(u);
    const ReadArray old_values(u_.get());
    const WriteArray x(x_hat_.get());
    const WriteArray velocity(velocity_hat_.get());
    const auto [theta, gamma] = std::pair{options_.theta, options_.gamma};
    for (PetscInt i = 0; i < count(); ++i) {
      const OscillatorState now = state_at(values.data(), i);
      const OscillatorState old = state_at(old_values.data(), i);
      const double p = gamma * now.lambda_s + (1.0 - gamma) * old.lambda_s;
      const double q = gamma * now.lambda_v + (1.0 - gamma) * old.lambda_v;
      const double r = 1.0 - kappa_[static_cast<std::size_t>(i)] * p * q;
      x[i] = theta * now.lambda_s * now.s + (1.0 - theta) * std::abs(old.s);
      velocity[i] = p * r * (theta * now.v + (1.0 - theta) * old.v);
    }
  }
  oscillators_.acceleration(t_hat_, x_hat_.get(), velocity_hat_.get(), a_.get());
}

/// And the sums of the absolute values of the terms of a: |a| + |da/dx||x^| + |da/dx'||x'^|, which has them
/// all where a is linear.
void ZhuravlevIvanov::find_force_terms() {
  if (has_force_terms_) return;
  has_force_terms_ = true;
  const auto add_terms = [&](Mat magnitude, Vec at) {
    check(VecCopy(at, work_.get()));
    check(VecAbs(work_.get()));
    check(MatMultAdd(magnitude, work_.get(), force_terms_.get(), force_terms_.get()));
  };
  check(VecCopy(a_.get(), force_terms_.get()));
  check(VecAbs(force_terms_.get()));
  add_terms(abs_by_x_.get(), x_hat_.get());
  if (abs_by_velocity_) add_terms(abs_by_velocity_.get(), velocity_hat_.get());
}

/// Solves oscillators again that counted on other accelerations, on the branch they are on if that fits; or,
/// by the rule, those for which it takes another branch now. Returns true, on all ranks, if there were none,
/// with the guess as it was.
bool ZhuravlevIvanov::sweep(Vec guess, bool by_rule) {
  constexpr double solved = 2e-15;  // of the terms of a row: rounding of the accelerations
  int changed = 0;
  {
    const Oscillators oscillators(*this);
    const ReadArray a(a_.get());
    const WriteArray values(guess);
    for (PetscInt i = 0; i < count(); ++i) {
      Branch& branch = branches_[static_cast<std::size_t>(i)];
      const OscillatorState& now = branch.state;
      const OscillatorStep step = oscillators[i];
      if (by_rule) {
        if (!prefers_another(step, now)) continue;
        branch = choose_branch(step);
      } else {
        const double off = h_ / step.r(now) * std::abs(step.lambda_s_hat(now.lambda_s)) *
                           std::abs(a[i] - branch.acceleration);
        if (off <= solved * std::abs(now.v) || off <= solved * terms_of(step, now).v) continue;
        if (!keep_branch(step, branch)) branch = choose_branch(step);
      }
      put(branch.state, values.data(), i);
      changed = 1;
    }
  }
  MPI_Allreduce(MPI_IN_PLACE, &changed, 1, MPI_INT, MPI_LOR, comm_);
  if (changed == 0) looked_at_ = Point(guess);
  return changed == 0;
}

void ZhuravlevIvanov::residual(Vec u, Vec f) {
  find_accelerations(u);
  bool between = false;  // some sign is neither 1 nor -1
  {
    const Oscillators oscillators(*this);
    const ReadArray values(u);
    const ReadArray a(a_.get());
    const WriteArray rows(f);
    for (PetscInt i = 0; i < count(); ++i) {
      const OscillatorState now = state_at(values.data(), i);
      const OscillatorStep step = oscillators[i];
      const double p = step.lambda_s_hat(now.lambda_s);
      const double q = step.lambda_v_hat(now.lambda_v);
      const double push = p * (a[i] - step.mu1) - step.mu2 * q;
      put({now.s - step.old.s - h_ * step.r(now) * step.v_hat(now.v),
           now.v - step.old.v - h_ / step.r(now) * push, -now.s, -now.v},
          rows.data(), i);
      between = between || std::abs(now.lambda_s) != 1.0 || std::abs(now.lambda_v) != 1.0;
    }
  }
  if (between || !oscillators_.linear()) ++version_;
}

/// The rows of the signs are -s and -v: known as well as the rows that determine them.
void ZhuravlevIvanov::row_terms(Vec u, Vec terms) {
  find_accelerations(u);
  find_force_terms();
  const Oscillators oscillators(*this);
  const ReadArray values(u);
  const WriteArray rows(terms);
  for (PetscInt i = 0; i < count(); ++i) {
    const OscillatorTerms own = terms_of(oscillators[i], state_at(values.data(), i));
    put({own.s, own.v, own.s, own.v}, rows.data(), i);
  }
}

/// s exactly 0 where it is 0 up to the terms of its row, v too, unless its sign is that of motion off the
/// wall: there it is small when it turns, and fits as it is. Signs exactly 1 or -1 where they are those of s
/// and v.
void ZhuravlevIvanov::settle(Vec u) {
  find_accelerations(u);
  find_force_terms();
  put_settled(u, [](PetscInt, const OscillatorTerms&) {});
}

/// Both, where nothing moves in one pass: what a predicted step does.
RowRatios ZhuravlevIvanov::settle_and_judge(Vec u, Vec lower, Vec upper, Vec f, Vec terms) {
  find_accelerations(u);
  find_force_terms();
  int moved = 0;
  {
    const WriteArray rows(terms);
    const auto keep = [&](PetscInt i, const OscillatorTerms& own) {
      put({own.s, own.v, own.s, own.v}, rows.data(), i);
    };
    moved = put_settled(u, keep) ? 1 : 0;
  }
  MPI_Allreduce(MPI_IN_PLACE, &moved, 1, MPI_INT, MPI_LOR, comm_);
  if (moved != 0) {
    residual_and_terms(u, f, terms);
  } else {
    looked_at_ = Point(u);
    residual(u, f);
  }
  return judge_rows(u, f, lower, upper, terms);
}

/// Calls visit(i, terms) on the way. Says whether anything moved.
template <class Visit>
bool ZhuravlevIvanov::put_settled(Vec u, Visit&& visit) {
  bool moved = false;
  const Oscillators oscillators(*this);
  const WriteArray values(u);
  const auto vanishes = [](double value, double terms) { return std::abs(value) <= held_rtol * terms; };
  const auto settled_sign = [](double lambda, double value) {
    if (value != 0.0 && std::abs(lambda - sign(value)) <= held_rtol) return sign(value);
    return std::clamp(lambda, -1.0, 1.0);
  };
  for (PetscInt i = 0; i < count(); ++i) {
    OscillatorState now = state_at(values.data(), i);
    const OscillatorState before = now;
    const OscillatorTerms terms = terms_of(oscillators[i], now);
    visit(i, terms);
    if (vanishes(now.s, terms.s)) now.s = 0.0;
    now.lambda_s = settled_sign(now.lambda_s, now.s);
    now.lambda_v = settled_sign(now.lambda_v, now.v);
    const bool turning = now.s != 0.0 && now.lambda_v == sign(now.v);
    if (!turning && vanishes(now.v, terms.v)) now.v = 0.0;
    moved = moved || !(now == before);
    put(now, values.data(), i);
  }
  return moved;
}

bool ZhuravlevIvanov::admissible(Vec u) {
  find_accelerations(u);
  find_force_terms();
  int spurious = 0;
  {
    const Oscillators oscillators(*this);
    const ReadArray values(u);
    for (PetscInt i = 0; i < count() && spurious == 0; ++i)
      if (prefers_another(oscillators[i], state_at(values.data(), i))) spurious = 1;
  }
  MPI_Allreduce(MPI_IN_PLACE, &spurious, 1, MPI_INT, MPI_LOR, comm_);
  return spurious == 0;
}

// The Jacobian ----------------------------------------------------------------------------------------

void ZhuravlevIvanov::jacobian(Vec u, Mat jacobian) {
  find_accelerations(u);
  if (!oscillators_.linear()) derivative_.evaluate(t_hat_, x_hat_.get(), velocity_hat_.get());
  check(MatZeroEntries(jacobian));
  set_own_entries(u, jacobian);
  add_coupling(u, jacobian);
  check(MatAssemblyBegin(jacobian, MAT_FINAL_ASSEMBLY));
  check(MatAssemblyEnd(jacobian, MAT_FINAL_ASSEMBLY));
}

namespace {

/// How (R v)^, x^ and x'^ of an oscillator change with its unknowns.
struct Derivatives {
  double p, q, r, v_hat;
  double r_by_s, r_by_v;  // dR/d lambda_s, dR/d lambda_v
  std::array<double, unknowns> x{}, velocity{};

  Derivatives(const OscillatorStep& step, const OscillatorState& now)
      : p(step.lambda_s_hat(now.lambda_s)),
        q(step.lambda_v_hat(now.lambda_v)),
        r(step.r(now)),
        v_hat(step.v_hat(now.v)),
        r_by_s(-step.kappa * step.gamma * q),
        r_by_v(-step.kappa * step.gamma * p) {
    x[of_s] = step.theta * now.lambda_s;
    x[of_lambda_s] = step.theta * now.s;
    velocity[of_v] = step.theta * p * r;
    velocity[of_lambda_s] = (step.gamma * r + p * r_by_s) * v_hat;
    velocity[of_lambda_v] = p * r_by_v * v_hat;
  }
};

}  // namespace

/// All but da/dx and da/dx'.
void ZhuravlevIvanov::set_own_entries(Vec u, Mat jacobian) {
  const PetscInt first = row_range(jacobian).first;
  const Oscillators oscillators(*this);
  const ReadArray values(u);
  const ReadArray a(a_.get());
  for (PetscInt i = 0; i < count(); ++i) {
    const OscillatorStep step = oscillators[i];
    const Derivatives d(step, state_at(values.data(), i));
    const double push_over_r = (d.p * (a[i] - step.mu1) - d.q * step.mu2) / d.r;
    const auto set = [&](Unknown row, Unknown column, double value) {
      const PetscInt at = first + unknowns * i;
      check(MatSetValue(jacobian, at + row, at + column, value, ADD_VALUES));
    };
    set(of_s, of_s, 1.0);
    set(of_s, of_v, -h_ * d.r * step.theta);
    set(of_s, of_lambda_s, -h_ * d.r_by_s * d.v_hat);
    set(of_s, of_lambda_v, -h_ * d.r_by_v * d.v_hat);
    set(of_v, of_v, 1.0);
    set(of_v, of_lambda_s, -h_ / d.r * (step.gamma * (a[i] - step.mu1) - push_over_r * d.r_by_s));
    set(of_v, of_lambda_v, h_ / d.r * (step.gamma * step.mu2 + push_over_r * d.r_by_v));
    set(of_lambda_s, of_s, -1.0);
    set(of_lambda_v, of_v, -1.0);
  }
}

/// -h/R lambda_s^ da in the rows of v, with da through x^ and x'^ of each oscillator.
void ZhuravlevIvanov::add_coupling(Vec u, Mat jacobian) {
  const auto add = [&](Mat derivative, std::array<double, unknowns> Derivatives::*inner, Unknown unknown) {
    {
      const Oscillators oscillators(*this);
      const ReadArray values(u);
      const WriteArray outer_factors(work_.get());
      const WriteArray inner_factors(inner_.get());
      for (PetscInt i = 0; i < count(); ++i) {
        const Derivatives d(oscillators[i], state_at(values.data(), i));
        outer_factors[i] = -h_ / d.r * d.p;
        inner_factors[i] = (d.*inner)[unknown];
      }
    }
    Matrix scaled;
    check(MatDuplicate(derivative, MAT_COPY_VALUES, scaled.put()));
    check(MatDiagonalScale(scaled.get(), work_.get(), inner_.get()));
    for_each_row(scaled.get(), [&](PetscInt i, auto neighbours, auto factors) {
      for (std::size_t k = 0; k < neighbours.size(); ++k)
        if (factors[k] != 0.0)
          check(MatSetValue(jacobian, unknowns * i + of_v, unknowns * neighbours[k] + unknown, factors[k],
                            ADD_VALUES));
    });
  };
  for (const Unknown unknown : {of_s, of_lambda_s})
    add(derivative_.by_x(), &Derivatives::x, unknown);
  if (derivative_.by_velocity() == nullptr) return;
  for (const Unknown unknown : {of_v, of_lambda_s, of_lambda_v})
    add(derivative_.by_velocity(), &Derivatives::velocity, unknown);
}

// What comes of a step --------------------------------------------------------------------------------

void ZhuravlevIvanov::accept(Vec u, Vec) {
  note_events(u);
  check(VecCopy(u, u_.get()));
  show_state();
}

void ZhuravlevIvanov::note_events(Vec u) {
  events_.clear();
  const ReadArray before(u_.get());
  const ReadArray after(u);
  for (PetscInt i = 0; i < count(); ++i) {
    const OscillatorState old = state_at(before.data(), i);
    const OscillatorState now = state_at(after.data(), i);
    const double kappa = kappa_[static_cast<std::size_t>(i)];
    if (old.s != 0.0 && sign(now.s) != sign(old.s)) {
      events_.push_back({i, Side::lower, 2, true, 2.0 * std::abs(now.v)});
      dissipated_ += 2.0 * kappa * now.v * now.v;  // (1 - e^2)/2 of the square of (1 + kappa) v
    }
    if (old.s == 0.0 && old.v == 0.0 && now.s != 0.0) events_.push_back({i, Side::lower, 2, false, 0.0});
    if (old.s == 0.0 && now.s == 0.0 && now.v == 0.0)  // what was left when it came to rest
      dissipated_ += 0.5 * (1.0 - kappa) * (1.0 - kappa) * old.v * old.v;
  }
}

void ZhuravlevIvanov::set_physical(Vec x, Vec velocity) {
  start_from(x, velocity);
  show_state();
}

/// The unknowns with sgn(s) = 1.
void ZhuravlevIvanov::start_from(Vec x, Vec velocity) {
  const ReadArray positions(x);
  const ReadArray velocities(velocity);
  const WriteArray u(u_.get());
  for (PetscInt i = 0; i < count(); ++i) {
    const auto [own_s, own_v] =
        to_transformed({positions[i], velocities[i]}, kappa_[static_cast<std::size_t>(i)]);
    put({own_s, own_v, 1.0, own_v < 0.0 ? -1.0 : 1.0}, u.data(), i);
  }
}

/// What is read from outside, from the unknowns.
void ZhuravlevIvanov::show_state() {
  const ReadArray u(u_.get());
  const WriteArray own_s(s_.get());
  const WriteArray own_v(v_.get());
  const WriteArray own_lambda_s(lambda_s_.get());
  const WriteArray own_lambda_v(lambda_v_.get());
  const WriteArray positions(x_.get());
  const WriteArray velocities(velocity_.get());
  for (PetscInt i = 0; i < count(); ++i) {
    const OscillatorState now = state_at(u.data(), i);
    own_s[i] = now.s;
    own_v[i] = now.v;
    own_lambda_s[i] = now.lambda_s;
    own_lambda_v[i] = now.lambda_v;
    const Physical physical = to_physical({now.s, now.v}, kappa_[static_cast<std::size_t>(i)]);
    positions[i] = physical.x;
    velocities[i] = physical.velocity;
  }
}

double ZhuravlevIvanov::kinetic() const {
  const ReadArray velocities(velocity_.get());
  double sum = 0.0;
  for (PetscInt i = 0; i < count(); ++i)
    sum += 0.5 * velocities[i] * velocities[i];
  return sum;
}

PetscInt ZhuravlevIvanov::active() const {
  const ReadArray own_s(s_.get());
  return static_cast<PetscInt>(std::count(own_s.data(), own_s.data() + own_s.size(), 0.0));
}

std::unique_ptr<ImpactDvi> make_impact_dvi(const ImpactOscillators& oscillators, const TimeGrid& grid,
                                           const ImpactOptions& options) {
  return std::make_unique<ZhuravlevIvanov>(oscillators, grid, options);
}

void ZhuravlevIvanov::visit(StateVisitor& visitor) {
  visitor.visit("s, v and signs", Belongs::constraint, u_.get(), unknowns);
  visitor.visit("dissipated", Belongs::rank, std::span<double>(&dissipated_, 1), 1);
  if (!visitor.replaces()) return;
  events_.clear();
  ++version_;
  show_state();
}

}  // namespace sweepvi
