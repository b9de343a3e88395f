#pragma once

#include <utility>
#include <vector>

#include "dvi/impact_branch.hpp"
#include "petsc/affine_rows.hpp"
#include "petsc/vector_value.hpp"
#include "sweepvi/impact_oscillators.hpp"

namespace sweepvi {

/// Impact oscillators in (s, v), see ImpactDvi.
///
/// `predict` solves the step by itself where springs are soft against the step (h^2 da/dx below 1, as
/// accuracy wants it anyway): each oscillator's VI exactly, branch by branch, its neighbours frozen, again
/// and again until the accelerations no longer change; that contracts like h^2 da/dx. Else the guess is left
/// to the predictor.
class ZhuravlevIvanov final : public ImpactDvi {
public:
  ZhuravlevIvanov(const ImpactOscillators& oscillators, const TimeGrid& grid, const ImpactOptions& options);

  MPI_Comm comm() const override { return comm_; }
  Vec state() const override { return u_.get(); }
  Matrix create_jacobian() const override;
  void begin(const Step& step, Vec lower, Vec upper, Vec guess) override;
  bool predict(Vec guess) override;
  bool predicts() const override { return most_sweeps_ > 0; }
  void residual(Vec u, Vec f) override;
  void row_terms(Vec u, Vec terms) override;
  void jacobian(Vec u, Mat jacobian) override;
  /// Where all signs are 1 or -1, the Jacobian of the other rows depends on them alone, and the solver knows
  /// them by its active set.
  std::uint64_t jacobian_version() const override { return version_; }
  void settle(Vec u) override;
  RowRatios settle_and_judge(Vec u, Vec lower, Vec upper, Vec f, Vec terms) override;
  bool admissible(Vec u) override;
  void accept(Vec u, Vec f) override;
  double penetration() const override { return 0.0; }  // x = |s|
  PetscInt active() const override;

  Vec x() const override { return shown(x_); }
  Vec velocity() const override { return shown(velocity_); }
  Vec s() const override { return shown(s_); }
  Vec v() const override { return shown(v_); }
  Vec lambda_s() const override { return shown(lambda_s_); }
  Vec lambda_v() const override { return shown(lambda_v_); }
  const std::vector<StepEvent>& events() const override { return events_; }
  void tell(std::vector<StepEvent> events) override { events_ = std::move(events); }
  double kinetic() const override;
  double dissipated() const override { return dissipated_; }
  void set_physical(Vec x, Vec velocity) override;
  void visit(StateVisitor& visitor) override;
  bool set_step(double h) override;

private:
  class Oscillators;

  /// How x^ and x'^ of an oscillator follow its acceleration a on its branch: x + x_by_a a, and so on.
  struct Motion {
    double x = 0.0, x_by_a = 0.0, velocity = 0.0, velocity_by_a = 0.0;
    double weight = 0.0;     // 1 / (1 - what a reads of both of its own)
    double per_terms = 0.0;  // what a change of a is over the terms of the row of v, or more
  };

  PetscInt count() const { return static_cast<PetscInt>(kappa_.size()); }
  void check_options_and_start() const;
  void differentiate();
  void find_accelerations(Vec u);
  void find_force_terms();
  void add_force_terms();
  /// x^ and x'^ of an oscillator.
  std::pair<double, double> hats(PetscInt i, const OscillatorState& old, const OscillatorState& now) const {
    const double theta = options_.theta;
    const double gamma = options_.gamma;
    const double p = gamma * now.lambda_s + (1.0 - gamma) * old.lambda_s;
    const double q = gamma * now.lambda_v + (1.0 - gamma) * old.lambda_v;
    const double r = 1.0 - kappa_[static_cast<std::size_t>(i)] * p * q;
    return {theta * now.lambda_s * now.s + (1.0 - theta) * std::abs(old.s),
            p * r * (theta * now.v + (1.0 - theta) * old.v)};
  }
  void choose_all(Vec guess);
  void relax(Vec guess);
  void choose_in_turn(Vec known, const double* others, const double* other_velocities);
  Motion motion_on(const Branch& branch, const OscillatorStep& step, double x, double velocity) const;
  void finish(Vec known, const double* others, const double* other_velocities, Vec guess);
  void renew_accelerations(Vec guess);
  double move_once(Vec known, const double* others, const double* other_velocities);
  bool counts_on(PetscInt i, double acceleration, double force_terms) const;
  bool sweep(Vec guess);
  void follow(Vec guess);
  bool is_ruled(Vec u) const;
  OscillatorState rows_of(const OscillatorStep& step, const OscillatorState& now, double acceleration) const;
  void set_own_entries(Vec u, Mat jacobian);
  void add_coupling(Vec u, Mat jacobian);
  void note_events(Vec u);
  void start_from(Vec x, Vec velocity);
  void show_state() const;
  Vec shown(const Vector& part) const {
    show_state();
    return part.get();
  }

  MPI_Comm comm_;
  const ImpactOscillators& oscillators_;
  ImpactOptions options_;
  double h_;
  std::vector<double> kappa_;
  int most_sweeps_ = 0;
  double t_hat_ = 0.0;
  std::uint64_t version_ = 0;

  ImpactJacobian derivative_;
  bool differentiated_ = false;
  Matrix abs_by_x_, abs_by_velocity_;
  AffineRows x_rows_, velocity_rows_;  // of da/dx and da/dx', where a is linear
  Vector slope_x_, slope_velocity_;    // diagonals of da/dx and da/dx'

  Vector u_;                            // four per oscillator
  mutable bool shows_state_ = false;    // what follows is that of u_
  Vector x_, velocity_;                 // state in physical coordinates
  Vector s_, v_, lambda_s_, lambda_v_;  // and in the others, each by itself
  VectorValue looked_at_;
  VectorValue begun_at_;       // where the step's guess was looked at
  VectorValue lower_, upper_;  // vectors that have the bounds: they are always the same
  bool has_force_terms_ = false;
  Vector x_hat_, velocity_hat_, a_;  // of the point looked at last
  Vector force_terms_, work_, inner_;
  std::vector<Branch> branches_;   // of each oscillator, in the guess
  std::vector<Motion> motions_;    // on them
  std::vector<PetscInt> changed_;  // in the last sweep
  bool ruled_ = false;             // the rule takes all of them; the point was
  VectorValue ruled_at_;
  std::vector<StepEvent> events_;
  double dissipated_ = 0.0;
};

}  // namespace sweepvi
