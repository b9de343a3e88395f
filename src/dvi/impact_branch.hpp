#pragma once

#include <cmath>

namespace sweepvi {

/// An oscillator in transformed coordinates.
struct OscillatorState {
  double s = 0.0, v = 0.0, lambda_s = 0.0, lambda_v = 0.0;
  bool operator==(const OscillatorState&) const = default;
  /// Some sign is neither 1 nor -1.
  bool is_between() const { return std::abs(lambda_s) != 1.0 || std::abs(lambda_v) != 1.0; }
};

/// One step of one oscillator, its neighbours frozen: the acceleration is a + by_x x^ + by_velocity x'^. The
/// equations are those of ImpactDvi.
struct OscillatorStep {
  OscillatorState old;
  double kappa = 0.5, h = 0.0, theta = 1.0, gamma = 1.0;
  double mu1 = 0.0, mu2 = 0.0;
  double a = 0.0, by_x = 0.0, by_velocity = 0.0;
  double terms = 0.0;         ///< sum of the absolute values of the terms of the acceleration
  double velocity_hat = 0.0;  ///< x'^ where nothing better is known

  // p = lambda_s^, q = lambda_v^, v^, and r = R^ = 1 - kappa p q.
  double lambda_s_hat(double lambda_s) const { return gamma * lambda_s + (1.0 - gamma) * old.lambda_s; }
  double lambda_v_hat(double lambda_v) const { return gamma * lambda_v + (1.0 - gamma) * old.lambda_v; }
  double v_hat(double v) const { return theta * v + (1.0 - theta) * old.v; }
  double r(const OscillatorState& now) const {
    return 1.0 - kappa * lambda_s_hat(now.lambda_s) * lambda_v_hat(now.lambda_v);
  }
  /// What a change of the acceleration makes of the equation of v.
  double off(const OscillatorState& now, double acceleration) const {
    return h / r(now) * std::abs(lambda_s_hat(now.lambda_s) * acceleration);
  }
  /// No more than the terms of that equation (terms_of), and known at less expense: 1/(1 + kappa) is the
  /// least of what multiplies forces there.
  double least_terms(const OscillatorState& now) const {
    return std::abs(now.v) + std::abs(old.v) + 0.5 * h * (terms + mu1 + mu2);
  }
};

/// Sums of the absolute values of the terms of an oscillator's two equations. The one of s has those of v in
/// it, as HO (23): s is s_k + h R v, and v is known up to its own terms. So has R = 1 - kappa lambda_s
/// lambda_v. Signs count as 1 where they multiply a force: at rest a sign is the sum of forces over a force.
struct OscillatorTerms {
  double s = 0.0, v = 0.0;
};
OscillatorTerms terms_of(const OscillatorStep& step, const OscillatorState& state);

/// A solution of an oscillator's VI in its two signs.
struct Branch {
  OscillatorState state;
  double acceleration = 0.0;          ///< that it was found with
  double sign_s = 0.0, sign_v = 0.0;  ///< signs it is made for; 0: between -1 and 1, where the variable is 0
  /// How far, relative to the rows' terms, its signs are from fitting; 0 or less: it is a solution.
  double misfit = 0.0;
};

/// The branch that the rule of ImpactDvi takes: the first that fits, or the one that comes nearest.
Branch choose_branch(const OscillatorStep& step);

/// The branch of the same signs, after data of the step changed a little, if that fits: `branch` becomes it.
/// Its state is not looked at. Whether the rule takes another one now is for prefers_another to say.
bool keep_branch(const OscillatorStep& step, Branch& branch);

/// Whether the rule asks about a branch of these signs before all others: one that fits is taken, then.
bool is_first_choice(const OscillatorState& old, const Branch& branch);

/// Whether the rule prefers another branch to `state`, a solution of the step: one that fits by more than
/// rounding.
bool prefers_another(const OscillatorStep& step, const OscillatorState& state);

}  // namespace sweepvi
