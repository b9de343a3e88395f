#include "dvi/zhuravlev_ivanov.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <tuple>
#include <utility>

#include "dvi/zhuravlev_ivanov_parts.hpp"
#include "petsc/sparse.hpp"
#include "sweepvi/scheme.hpp"
#include "vi/natural_residual.hpp"

namespace sweepvi {

namespace {

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
  looked_at_ = VectorValue{};
  ++version_;
  return true;
}

// The step --------------------------------------------------------------------------------------------

void ZhuravlevIvanov::begin(const Step& step, Vec lower, Vec upper, Vec guess) {
  t_hat_ = step.t_old + options_.theta * step.h;
  if (!(VectorValue(lower) == lower_ && VectorValue(upper) == upper_)) {
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
  lower_ = VectorValue(lower);
  upper_ = VectorValue(upper);
  if (options_.resample) start_from(x(), velocity());
  ++version_;  // columns of signs that stand on a bound change with the state
  looked_at_ = VectorValue{};
  ruled_ = false;
  check(VecCopy(u_.get(), guess));
  find_accelerations(guess);
  begun_at_ = looked_at_;
  differentiate();
}

/// da/dx and da/dx' at the point looked at last; of linear oscillators once.
void ZhuravlevIvanov::differentiate() {
  if (differentiated_ && oscillators_.linear()) return;
  derivative_.evaluate(t_hat_, x_hat_.get(), velocity_hat_.get());
  differentiated_ = true;
  abs_by_x_ = absolute_copy(derivative_.by_x());
  check(MatGetDiagonal(derivative_.by_x(), slope_x_.get()));
  if (oscillators_.linear()) x_rows_ = AffineRows(derivative_.by_x());
  if (derivative_.by_velocity() == nullptr) return;
  abs_by_velocity_ = absolute_copy(derivative_.by_velocity());
  check(MatGetDiagonal(derivative_.by_velocity(), slope_velocity_.get()));
  if (oscillators_.linear()) velocity_rows_ = AffineRows(derivative_.by_velocity());
}

/// x^, x'^ and a(t^, x^, x'^) at u, unless u is the point looked at last.
void ZhuravlevIvanov::find_accelerations(Vec u) {
  const VectorValue point(u);
  if (point == looked_at_) return;
  looked_at_ = point;
  has_force_terms_ = false;
  {
    const ReadArray values(u);
    const ReadArray old_values(u_.get());
    const WriteArray x(x_hat_.get());
    const WriteArray velocity(velocity_hat_.get());
    for (PetscInt i = 0; i < count(); ++i)
      std::tie(x[i], velocity[i]) = hats(i, state_at(old_values.data(), i), state_at(values.data(), i));
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
  if (oscillators_.linear()) {
    add_force_terms();
    return;
  }
  check(VecCopy(a_.get(), force_terms_.get()));
  check(VecAbs(force_terms_.get()));
  add_terms(abs_by_x_.get(), x_hat_.get());
  if (abs_by_velocity_) add_terms(abs_by_velocity_.get(), velocity_hat_.get());
}

/// The same by rows that are kept.
void ZhuravlevIvanov::add_force_terms() {
  const WriteArray terms(force_terms_.get());
  {
    const double* others = x_rows_.ghosts(x_hat_.get());
    const ReadArray x(x_hat_.get());
    const ReadArray a(a_.get());
    x_rows_.each_row(x.data(), others,
                     [&](PetscInt i, const AffineRows::Row& by_x) { terms[i] = std::abs(a[i]) + by_x.size; });
  }
  if (derivative_.by_velocity() == nullptr) return;
  const double* others = velocity_rows_.ghosts(velocity_hat_.get());
  const ReadArray velocity(velocity_hat_.get());
  velocity_rows_.each_row(velocity.data(), others,
                          [&](PetscInt i, const AffineRows::Row& by_v) { terms[i] += by_v.size; });
}

/// F of one oscillator. The rows of the signs are -s and -v.
inline OscillatorState ZhuravlevIvanov::rows_of(const OscillatorStep& step, const OscillatorState& now,
                                                double acceleration) const {
  const double p = step.lambda_s_hat(now.lambda_s);
  const double q = step.lambda_v_hat(now.lambda_v);
  const double r = 1.0 - step.kappa * p * q;
  const double push = p * (acceleration - step.mu1) - step.mu2 * q;
  return {now.s - step.old.s - h_ * r * step.v_hat(now.v), now.v - step.old.v - h_ / r * push, -now.s,
          -now.v};
}

void ZhuravlevIvanov::residual(Vec u, Vec f) {
  find_accelerations(u);
  bool between = false;  // some sign is neither 1 nor -1
  {
    Oscillators oscillators(*this);
    const ReadArray values(u);
    const ReadArray a(a_.get());
    const WriteArray rows(f);
    for (PetscInt i = 0; i < count(); ++i) {
      const OscillatorState now = state_at(values.data(), i);
      put(rows_of(oscillators[i], now, a[i]), rows.data(), i);
      between = between || now.is_between();
    }
  }
  if (between || !oscillators_.linear()) ++version_;
}

/// The rows of the signs are -s and -v: known as well as the rows that determine them.
void ZhuravlevIvanov::row_terms(Vec u, Vec terms) {
  find_accelerations(u);
  find_force_terms();
  Oscillators oscillators(*this);
  const ReadArray values(u);
  const WriteArray rows(terms);
  for (PetscInt i = 0; i < count(); ++i) {
    const OscillatorTerms own = terms_of(oscillators[i], state_at(values.data(), i));
    put({own.s, own.v, own.s, own.v}, rows.data(), i);
  }
}

namespace {

/// s exactly 0 where it is 0 up to the terms of its row, v too, unless its sign is that of motion off the
/// wall: there it is small when it turns, and fits as it is. Signs exactly 1 or -1 where they are those of s
/// and v.
OscillatorState settled(OscillatorState now, const OscillatorTerms& terms) {
  const auto vanishes = [](double value, double size) { return std::abs(value) <= held_rtol * size; };
  const auto settled_sign = [](double lambda, double value) {
    if (value != 0.0 && std::abs(lambda - sign(value)) <= held_rtol) return sign(value);
    return std::clamp(lambda, -1.0, 1.0);
  };
  if (vanishes(now.s, terms.s)) now.s = 0.0;
  now.lambda_s = settled_sign(now.lambda_s, now.s);
  now.lambda_v = settled_sign(now.lambda_v, now.v);
  const bool turning = now.s != 0.0 && now.lambda_v == sign(now.v);
  if (!turning && vanishes(now.v, terms.v)) now.v = 0.0;
  return now;
}

}  // namespace

void ZhuravlevIvanov::settle(Vec u) {
  find_accelerations(u);
  find_force_terms();
  Oscillators oscillators(*this);
  const WriteArray values(u);
  for (PetscInt i = 0; i < count(); ++i) {
    const OscillatorState now = state_at(values.data(), i);
    put(settled(now, terms_of(oscillators[i], now)), values.data(), i);
  }
}

/// Both, where nothing moves in one pass: what a predicted step does.
RowRatios ZhuravlevIvanov::settle_and_judge(Vec u, Vec lower, Vec upper, Vec f, Vec terms) {
  const bool is_what_was_ruled = looked_at_ == ruled_at_ && (VectorValue(u) == ruled_at_ || is_ruled(u));
  if (is_what_was_ruled) looked_at_ = VectorValue(u);  // it, or a copy
  find_accelerations(u);
  find_force_terms();
  const bool linear = oscillators_.linear();
  int moved = 0;
  bool between = false;
  RowJudge judge;
  {
    Oscillators oscillators(*this);
    const WriteArray values(u);
    const WriteArray rows(f);
    const WriteArray sizes(terms);
    const ReadArray a(a_.get());
    const auto judge_free = [&](double value, double row, double size) {
      judge.look_at_free(value, row, size);
    };
    const auto judge_sign = [&](double sign_of, double value, double row, double size) {
      const bool fits = value == 0.0 ? std::abs(sign_of) <= 1.0 : sign_of == sign(value);
      if (!fits) judge.look_at(sign_of, row, -1.0, 1.0, size);
    };
    for (PetscInt i = 0; i < count(); ++i) {
      const OscillatorState before = state_at(values.data(), i);
      const OscillatorStep& step = oscillators[i];
      const OscillatorTerms own = terms_of(step, before);
      const OscillatorState F = rows_of(step, before, a[i]);
      const OscillatorState now = settled(before, own);
      between = between || now.is_between();
      put(F, rows.data(), i);
      put({own.s, own.v, own.s, own.v}, sizes.data(), i);
      judge_free(before.s, F.s, own.s);
      judge_free(before.v, F.v, own.v);
      judge_sign(before.lambda_s, before.s, F.lambda_s, own.s);
      judge_sign(before.lambda_v, before.v, F.lambda_v, own.v);
      if (now == before) continue;
      moved = 1;
      put(now, values.data(), i);
    }
  }
  MPI_Allreduce(MPI_IN_PLACE, &moved, 1, MPI_INT, MPI_LOR, comm_);
  if (moved != 0) {
    residual_and_terms(u, f, terms);
    return judge_rows(u, f, lower, upper, terms);
  }
  looked_at_ = VectorValue(u);
  if (is_what_was_ruled) ruled_at_ = looked_at_;
  if (between || !linear) ++version_;
  return judge.ratios();
}

bool ZhuravlevIvanov::admissible(Vec u) {
  if ((ruled_ && VectorValue(u) == ruled_at_) || is_ruled(u)) return true;
  find_accelerations(u);
  find_force_terms();
  int spurious = 0;
  {
    Oscillators oscillators(*this);
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
  Oscillators oscillators(*this);
  const ReadArray values(u);
  const ReadArray a(a_.get());
  for (PetscInt i = 0; i < count(); ++i) {
    const OscillatorStep& step = oscillators[i];
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
  const auto add = [&](Mat derivative, bool of_velocity, Unknown unknown) {
    {
      Oscillators oscillators(*this);
      const ReadArray values(u);
      const WriteArray outer_factors(work_.get());
      const WriteArray inner_factors(inner_.get());
      for (PetscInt i = 0; i < count(); ++i) {
        const Derivatives d(oscillators[i], state_at(values.data(), i));
        outer_factors[i] = -h_ / d.r * d.p;
        inner_factors[i] = (of_velocity ? d.velocity : d.x)[unknown];
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
    add(derivative_.by_x(), false, unknown);
  if (derivative_.by_velocity() == nullptr) return;
  for (const Unknown unknown : {of_v, of_lambda_s, of_lambda_v})
    add(derivative_.by_velocity(), true, unknown);
}

// What comes of a step --------------------------------------------------------------------------------

void ZhuravlevIvanov::accept(Vec u, Vec) {
  note_events(u);
  check(VecCopy(u, u_.get()));
  shows_state_ = false;
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
  shows_state_ = false;
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

/// What is read from outside, from the unknowns, when somebody asks.
void ZhuravlevIvanov::show_state() const {
  if (std::exchange(shows_state_, true)) return;
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
  const ReadArray velocities(velocity());
  double sum = 0.0;
  for (PetscInt i = 0; i < count(); ++i)
    sum += 0.5 * velocities[i] * velocities[i];
  return sum;
}

PetscInt ZhuravlevIvanov::active() const {
  const ReadArray u(u_.get());
  PetscInt resting = 0;
  for (PetscInt i = 0; i < count(); ++i)
    resting += state_at(u.data(), i).s == 0.0 ? 1 : 0;
  return resting;
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
  shows_state_ = false;
}

}  // namespace sweepvi
