// The steps that the process solves by itself.
#include <algorithm>
#include <cmath>
#include <tuple>

#include "dvi/zhuravlev_ivanov.hpp"
#include "dvi/zhuravlev_ivanov_parts.hpp"

namespace sweepvi {

/// Each oscillator's step is solved with its neighbours as they are, in the first sweep by the rule; then,
/// where its acceleration turns out to be another than it counted on, again. The guess is the point looked at
/// last, before and after.
bool ZhuravlevIvanov::predict(Vec guess) {
  if (most_sweeps_ == 0) return false;
  if (looked_at_ == begun_at_) looked_at_ = VectorValue(guess);  // it has the same numbers
  find_accelerations(guess);
  find_force_terms();  // good enough for all sweeps: what misfits are told apart by
  if (oscillators_.linear())
    relax(guess);
  else
    choose_all(guess);
  for (int sweeps = 1; sweeps <= most_sweeps_; ++sweeps) {
    if (oscillators_.linear())
      renew_accelerations(guess);
    else
      find_accelerations(guess);
    if (!sweep(guess)) {
      if (oscillators_.linear()) follow(guess);
      continue;
    }
    ruled_ = true;
    ruled_at_ = looked_at_;
    return true;
  }
  return false;
}

/// The first sweep: all at once.
void ZhuravlevIvanov::choose_all(Vec guess) {
  Oscillators oscillators(*this);
  const WriteArray values(guess);
  for (PetscInt i = 0; i < count(); ++i) {
    Branch& branch = branches_[static_cast<std::size_t>(i)];
    branch = choose_branch(oscillators[i]);
    put(branch.state, values.data(), i);
  }
}

namespace {
constexpr double solved = 2e-15;  // of the terms of a row: rounding of the accelerations
}

/// Linear oscillators, every other one first, each with its neighbours as they are by now (those of other
/// ranks as they were): Gauss-Seidel, which contracts like the square of h^2 da/dx. In the first sweep
/// neighbours that were not yet seen stand where they fly to without contact.
void ZhuravlevIvanov::relax(Vec guess) {
  const bool damped = derivative_.by_velocity() != nullptr;
  Vec known = work_.get();  // the accelerations but for what x and x' give
  const double* others = x_rows_.ghosts(x_hat_.get());
  const double* other_velocities = damped ? velocity_rows_.ghosts(velocity_hat_.get()) : nullptr;
  {
    const ReadArray a(a_.get());
    const WriteArray x(x_hat_.get());
    const WriteArray velocity(velocity_hat_.get());
    const WriteArray left(known);
    x_rows_.each_row(x.data(), others,
                     [&](PetscInt i, const AffineRows::Row& by_x) { left[i] = a[i] - by_x.sum; });
    if (damped)
      velocity_rows_.each_row(velocity.data(), other_velocities,
                              [&](PetscInt i, const AffineRows::Row& by_v) { left[i] -= by_v.sum; });
    const double ahead = options_.theta * h_;
    for (PetscInt i = 0; i < count(); ++i) {
      const double faster = velocity[i] + ahead * a[i];
      const double there = x[i] + ahead * faster;
      x[i] = std::max(there, 0.0);
      velocity[i] = there > 0.0 ? faster : std::max(faster, 0.0);
    }
  }
  others = x_rows_.ghosts(x_hat_.get());
  other_velocities = damped ? velocity_rows_.ghosts(velocity_hat_.get()) : nullptr;
  choose_in_turn(known, others, other_velocities);
  double before = 1.0;
  for (int sweeps = 1; sweeps < most_sweeps_; ++sweeps) {
    others = x_rows_.ghosts(x_hat_.get());
    other_velocities = damped ? velocity_rows_.ghosts(velocity_hat_.get()) : nullptr;
    double off = move_once(known, others, other_velocities);
    MPI_Allreduce(MPI_IN_PLACE, &off, 1, MPI_DOUBLE, MPI_MAX, comm_);
    // What the last sweep, that of the branches, will leave: that much times the contraction, twice.
    const double contraction = off / before;
    if (!(off * contraction * contraction > solved) || !(contraction < 1.0)) break;
    before = off;
  }
  others = x_rows_.ghosts(x_hat_.get());
  other_velocities = damped ? velocity_rows_.ghosts(velocity_hat_.get()) : nullptr;
  finish(known, others, other_velocities, guess);
  looked_at_ = VectorValue{};
}

/// Those of linear oscillators by x^ and x'^, which are those of the guess already.
void ZhuravlevIvanov::renew_accelerations(Vec guess) {
  const double* others = x_rows_.ghosts(x_hat_.get());
  {
    const ReadArray x(x_hat_.get());
    const ReadArray left(work_.get());
    const WriteArray a(a_.get());
    x_rows_.each_row(x.data(), others,
                     [&](PetscInt i, const AffineRows::Row& by_x) { a[i] = left[i] + by_x.sum; });
  }
  if (derivative_.by_velocity() != nullptr) {
    others = velocity_rows_.ghosts(velocity_hat_.get());
    const ReadArray velocity(velocity_hat_.get());
    const WriteArray a(a_.get());
    velocity_rows_.each_row(velocity.data(), others,
                            [&](PetscInt i, const AffineRows::Row& by_v) { a[i] += by_v.sum; });
  }
  looked_at_ = VectorValue(guess);
  has_force_terms_ = false;
}

/// The first sweep over the branches chooses them.
void ZhuravlevIvanov::choose_in_turn(Vec known, const double* others, const double* other_velocities) {
  const bool damped = derivative_.by_velocity() != nullptr;
  motions_.resize(branches_.size());
  const WriteArray x(x_hat_.get());
  const WriteArray velocity(velocity_hat_.get());
  const WriteArray a(a_.get());
  const ReadArray left(known);
  Oscillators oscillators(*this);
  x_rows_.each_row_apart(x.data(), others, [&](PetscInt i, const AffineRows::Row& by_others) {
    Branch& branch = branches_[static_cast<std::size_t>(i)];
    a[i] = left[i] + by_others.sum;
    if (damped) a[i] += velocity_rows_.row(i, velocity.data(), other_velocities).sum;
    const OscillatorStep& step = oscillators[i];
    branch = choose_branch(step);
    std::tie(x[i], velocity[i]) = hats(i, step.old, branch.state);
    motions_[static_cast<std::size_t>(i)] = motion_on(branch, step, x[i], velocity[i]);
  });
}

/// Where both signs are known s and v follow a, on the wall they stand still; on other branches, which are
/// few, they are left where they are.
ZhuravlevIvanov::Motion ZhuravlevIvanov::motion_on(const Branch& branch, const OscillatorStep& step, double x,
                                                   double velocity) const {
  Motion motion;
  if (branch.has_both_signs()) {
    const double p = step.lambda_s_hat(branch.sign_s);
    motion.x_by_a = step.theta * step.theta * h_ * h_ * branch.sign_s * p;
    motion.velocity_by_a = step.theta * h_ * p * p;
  }
  motion.x = x - motion.x_by_a * branch.acceleration;
  motion.velocity = velocity - motion.velocity_by_a * branch.acceleration;
  motion.weight = 1.0 / (1.0 - step.by_x * motion.x_by_a - step.by_velocity * motion.velocity_by_a);
  motion.per_terms = h_ / (std::abs(branch.state.v) + 0.5 * h_ * step.terms);
  return motion;
}

/// One sweep of them. @return the largest change of an acceleration, over the terms of its row
double ZhuravlevIvanov::move_once(Vec known, const double* others, const double* other_velocities) {
  const bool damped = derivative_.by_velocity() != nullptr;
  double worst = 0.0;
  const WriteArray x(x_hat_.get());
  const WriteArray velocity(velocity_hat_.get());
  const WriteArray a(a_.get());
  const ReadArray left(known);
  const ReadArray by_x(slope_x_.get());
  const ReadArray by_velocity(slope_velocity_.get());
  x_rows_.each_row_apart(x.data(), others, [&](PetscInt i, const AffineRows::Row& by_others) {
    const Motion& motion = motions_[static_cast<std::size_t>(i)];
    double sum = left[i] + by_others.sum - by_x[i] * (x[i] - motion.x);
    if (damped)
      sum += velocity_rows_.row(i, velocity.data(), other_velocities).sum -
             by_velocity[i] * (velocity[i] - motion.velocity);
    const double now = motion.weight * sum;
    const double change = std::abs(now - a[i]) * motion.per_terms;
    if (change > worst) worst = change;
    a[i] = now;
    x[i] = motion.x + motion.x_by_a * now;
    if (damped) velocity[i] = motion.velocity + motion.velocity_by_a * now;
  });
  return worst;
}

/// Whether an oscillator's branch was found with this acceleration, but for rounding. Below what its row's
/// terms are, and known at little expense: 1/R <= 1/(1 - kappa).
inline bool ZhuravlevIvanov::counts_on(PetscInt i, double acceleration, double force_terms) const {
  const Branch& branch = branches_[static_cast<std::size_t>(i)];
  const double least_terms = std::abs(branch.state.v) + 0.5 * h_ * force_terms;
  return h_ * std::abs(acceleration - branch.acceleration) <=
         solved * (1.0 - kappa_[static_cast<std::size_t>(i)]) * least_terms;
}

/// The last sweep, over the branches themselves: where both signs are known, s and v that belong to a.
void ZhuravlevIvanov::finish(Vec known, const double* others, const double* other_velocities, Vec guess) {
  const bool damped = derivative_.by_velocity() != nullptr;
  const WriteArray values(guess);
  const WriteArray x(x_hat_.get());
  const WriteArray velocity(velocity_hat_.get());
  const WriteArray a(a_.get());
  const ReadArray left(known);
  Oscillators oscillators(*this);
  x_rows_.each_row_apart(x.data(), others, [&](PetscInt i, const AffineRows::Row& by_others) {
    Branch& branch = branches_[static_cast<std::size_t>(i)];
    a[i] = left[i] + by_others.sum;
    if (damped) a[i] += velocity_rows_.row(i, velocity.data(), other_velocities).sum;
    const OscillatorStep& step = oscillators[i];
    const Motion& motion = motions_[static_cast<std::size_t>(i)];
    const double known_of_own = step.a + step.by_x * motion.x + step.by_velocity * motion.velocity;
    if (!branch.has_both_signs() || !move_on(branch, step, motion.weight * known_of_own))
      if (!keep_branch(step, branch)) branch = choose_branch(step);
    put(branch.state, values.data(), i);
    std::tie(x[i], velocity[i]) = hats(i, step.old, branch.state);
  });
}

/// Solves oscillators again that counted on other accelerations, on the branch they are on if that fits; and
/// those for which the rule takes another branch. Returns true, on all ranks, if there were none, with the
/// guess as it was.
bool ZhuravlevIvanov::sweep(Vec guess) {
  changed_.clear();
  {
    Oscillators oscillators(*this);
    const ReadArray a(a_.get());
    const ReadArray old(u_.get());
    const ReadArray sizes(force_terms_.get());
    const WriteArray values(guess);
    for (PetscInt i = 0; i < count(); ++i) {
      Branch& branch = branches_[static_cast<std::size_t>(i)];
      const bool counts = counts_on(i, a[i], sizes[i]);
      if (counts && is_first_choice(state_at(old.data(), i), branch)) continue;
      const OscillatorStep& step = oscillators[i];
      const OscillatorState& now = branch.state;
      if (counts || step.off(now, a[i] - branch.acceleration) <= solved * terms_of(step, now).v) {
        if (is_first_choice(step.old, branch) || !prefers_another(step, now)) continue;
        branch = choose_branch(step);
      } else if (!keep_branch(step, branch)) {
        branch = choose_branch(step);
      }
      put(branch.state, values.data(), i);
      changed_.push_back(i);
    }
  }
  int changed = changed_.empty() ? 0 : 1;
  MPI_Allreduce(MPI_IN_PLACE, &changed, 1, MPI_INT, MPI_LOR, comm_);
  if (changed == 0) looked_at_ = VectorValue(guess);
  return changed == 0;
}

/// Those that changed carry along those of this rank that read them, until nobody counts on another
/// acceleration: that is few, while a sweep asks all.
void ZhuravlevIvanov::follow(Vec guess) {
  const bool damped = derivative_.by_velocity() != nullptr;
  const WriteArray values(guess);
  {
    const ReadArray old(u_.get());
    const WriteArray x(x_hat_.get());
    const WriteArray velocity(velocity_hat_.get());
    for (const PetscInt i : changed_)
      std::tie(x[i], velocity[i]) = hats(i, state_at(old.data(), i), state_at(values.data(), i));
  }
  const double* others = x_rows_.ghosts(x_hat_.get());
  const double* other_velocities = damped ? velocity_rows_.ghosts(velocity_hat_.get()) : nullptr;
  const WriteArray x(x_hat_.get());
  const WriteArray velocity(velocity_hat_.get());
  const WriteArray a(a_.get());
  const ReadArray left(work_.get());
  const ReadArray sizes(force_terms_.get());
  Oscillators oscillators(*this);
  std::vector<PetscInt> readers;
  const auto take_readers = [&](const AffineRows& rows) {
    for (const PetscInt i : changed_)
      for (const AffineRows::Entry& entry : rows.entries(i))
        if (i + entry.offset < count()) readers.push_back(i + entry.offset);
  };
  for (int rounds = 0; rounds < most_sweeps_ && !changed_.empty(); ++rounds) {
    readers = changed_;
    take_readers(x_rows_);  // who reads whom is symmetric; where it is not, the next sweep finds them
    if (damped) take_readers(velocity_rows_);
    std::sort(readers.begin(), readers.end());
    readers.erase(std::unique(readers.begin(), readers.end()), readers.end());
    changed_.clear();
    for (const PetscInt i : readers) {
      Branch& branch = branches_[static_cast<std::size_t>(i)];
      a[i] = left[i] + x_rows_.row(i, x.data(), others).sum;
      if (damped) a[i] += velocity_rows_.row(i, velocity.data(), other_velocities).sum;
      if (counts_on(i, a[i], sizes[i])) continue;
      const OscillatorStep& step = oscillators[i];
      if (step.off(branch.state, a[i] - branch.acceleration) <= solved * step.least_terms(branch.state))
        continue;
      if (!keep_branch(step, branch)) branch = choose_branch(step);
      put(branch.state, values.data(), i);
      std::tie(x[i], velocity[i]) = hats(i, step.old, branch.state);
      changed_.push_back(i);
    }
  }
  looked_at_ = VectorValue{};
}

/// Whether u is what `predict` found: the rule was asked about it.
bool ZhuravlevIvanov::is_ruled(Vec u) const {
  int same = ruled_ ? 1 : 0;
  {
    const ReadArray values(u);
    for (PetscInt i = 0; i < count() && same != 0; ++i)
      if (!(state_at(values.data(), i) == branches_[static_cast<std::size_t>(i)].state)) same = 0;
  }
  MPI_Allreduce(MPI_IN_PLACE, &same, 1, MPI_INT, MPI_LAND, comm_);
  return same != 0;
}

}  // namespace sweepvi
