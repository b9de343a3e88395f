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
inline OscillatorTerms terms_of(const OscillatorStep& step, const OscillatorState& state) {
  const double product = step.kappa * step.lambda_s_hat(state.lambda_s) * step.lambda_v_hat(state.lambda_v);
  const double r = 1.0 - product;
  const double r_terms = 1.0 + std::abs(product);
  OscillatorTerms terms;
  terms.v = std::abs(state.v) + std::abs(step.old.v) +
            step.h * r_terms / (r * r) * (step.terms + step.mu1 + step.mu2);
  terms.s = std::abs(state.s) + std::abs(step.old.s) + step.h * r_terms * terms.v;
  return terms;
}

/// A solution of an oscillator's VI in its two signs.
struct Branch {
  OscillatorState state;
  double acceleration = 0.0;          ///< that it was found with
  double sign_s = 0.0, sign_v = 0.0;  ///< signs it is made for; 0: between -1 and 1, where the variable is 0
  /// How far, relative to the rows' terms, its signs are from fitting; 0 or less: it is a solution.
  double misfit = 0.0;

  bool has_both_signs() const { return sign_s != 0.0 && sign_v != 0.0; }
};

/// The branch that the rule of ImpactDvi takes: the first that fits, or the one that comes nearest.
Branch choose_branch(const OscillatorStep& step);

/// The branch of the same signs, after data of the step changed a little, if that fits: `branch` becomes it.
/// Its state is not looked at. Whether the rule takes another one now is for prefers_another to say.
bool keep_branch(const OscillatorStep& step, Branch& branch);

/// One of both signs where the acceleration is that, if s and v fit it: `branch` becomes it.
inline bool move_on(Branch& branch, const OscillatorStep& step, double acceleration) {
  const double p = step.lambda_s_hat(branch.sign_s);
  const double q = step.lambda_v_hat(branch.sign_v);
  const double r = 1.0 - step.kappa * p * q;
  const double v = step.old.v + step.h / r * (p * (acceleration - step.mu1) - step.mu2 * q);
  const double s = step.old.s + step.h * r * step.v_hat(v);
  if (!(branch.sign_s * s >= 0.0 && branch.sign_v * v >= 0.0)) return false;
  branch.state = {s, v, branch.sign_s, branch.sign_v};
  branch.acceleration = acceleration;
  return true;
}

/// The signs that an oscillator has, or starts with.
inline double sign_or(double value, double otherwise) {
  return value > 0.0 ? 1.0 : value < 0.0 ? -1.0 : otherwise;
}
inline double kept_sign_s(const OscillatorState& old) {
  return sign_or(old.s, sign_or(old.v, 1.0));
}
inline double kept_sign_v(const OscillatorState& old) {
  return sign_or(old.v, sign_or(old.lambda_v, 1.0));
}

/// Whether the rule asks about a branch of these signs before all others: one that fits is taken, then.
inline bool is_first_choice(const OscillatorState& old, const Branch& branch) {
  return branch.sign_s == kept_sign_s(old) && branch.sign_v == kept_sign_v(old);
}

/// Whether the rule prefers another branch to `state`, a solution of the step: one that fits by more than
/// rounding.
bool prefers_another(const OscillatorStep& step, const OscillatorState& state);

}  // namespace sweepvi
