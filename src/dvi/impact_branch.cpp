#include "dvi/impact_branch.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace sweepvi {

namespace {

/// The real roots of a p^2 + b p + c, without cancellation; NaN where there is none.
std::array<double, 2> roots(double a, double b, double c) {
  constexpr double none = std::numeric_limits<double>::quiet_NaN();
  const double discriminant = b * b - 4.0 * a * c;
  if (!(discriminant >= 0.0)) return {none, none};
  const double t = -0.5 * (b + std::copysign(std::sqrt(discriminant), b));
  if (t == 0.0) return {a != 0.0 || c == 0.0 ? 0.0 : none, none};  // b = 0 and a c = 0
  return {c / t, a != 0.0 ? t / a : none};
}

/// 0 / 0 is 0: a sign fits where all terms vanish.
double over(double value, double terms) {
  return value == 0.0 ? 0.0 : value / terms;
}

/// The branches of one step, in the order of choice. A sign is +1 or -1, or 0: free, and its variable is 0.
class Branches {
public:
  explicit Branches(const OscillatorStep& step)
      : k_(step), s_old_(step.old.s), v_old_(step.old.v), drift_((1.0 - step.theta) * step.old.v) {}

  /// The one the rule asks about before all others.
  Branch first() { return clipped(kept_sign_s(k_.old), kept_sign_v(k_.old)); }

  /// Calls visit(branch) until it returns true.
  template <class Visit>
  void visit(Visit&& visit) {
    const double keep_s = kept_sign_s(k_.old);
    const double keep_v = kept_sign_v(k_.old);
    for (const double sign_s : {keep_s, -keep_s}) {
      for (const double sign_v : {keep_v, -keep_v})
        if (visit(clipped(sign_s, sign_v))) return;
      if (visit(turning(sign_s))) return;
    }
    for (const double sign_v : {keep_v, -keep_v})
      for (const Branch& branch : at_wall(sign_v))
        if (visit(branch)) return;
    if (drift_ == 0.0) return;
    for (const Branch& branch : stopping())
      if (visit(branch)) return;
  }

  /// Calls visit(branch) for those of these signs, until it returns true.
  template <class Visit>
  void visit(double sign_s, double sign_v, Visit&& visit) {
    if (sign_s != 0.0) {
      visit(sign_v != 0.0 ? clipped(sign_s, sign_v) : turning(sign_s));
    } else if (sign_v != 0.0) {
      for (const Branch& branch : at_wall(sign_v))
        if (visit(branch)) return;
    }
  }

private:
  double r(double p, double q) const { return 1.0 - k_.kappa * p * q; }
  /// x^ from |s|.
  double x_hat(double x) const { return k_.theta * x + (1.0 - k_.theta) * std::abs(s_old_); }
  double lambda(double hat, double old) const { return (hat - (1.0 - k_.gamma) * old) / k_.gamma; }

  /// Both signs known: linear in v.
  Branch clipped(double sign_s, double sign_v) {
    const double p = k_.lambda_s_hat(sign_s);
    const double q = k_.lambda_v_hat(sign_v);
    const double h_over_r = k_.h / r(p, q);
    const double s_drifted = s_old_ + k_.h * r(p, q) * drift_;
    const double known = k_.a + k_.by_x * x_hat(sign_s * s_drifted) + k_.by_velocity * p * r(p, q) * drift_;
    const double slope = k_.theta * r(p, q) * (k_.by_x * k_.theta * sign_s * k_.h + k_.by_velocity * p);
    const double v = (v_old_ + h_over_r * (p * (known - k_.mu1) - k_.mu2 * q)) / (1.0 - h_over_r * p * slope);
    const double s = s_old_ + k_.h * r(p, q) * k_.v_hat(v);
    return finished({s, v, sign_s, sign_v}, known + slope * v, sign_s, sign_v);
  }

  /// v = 0, lambda_v between -1 and 1: linear in it.
  Branch turning(double sign_s) {
    const double p = k_.lambda_s_hat(sign_s);
    const double known = k_.a + k_.by_x * x_hat(sign_s * s_old_);
    const double slope = (k_.by_x * k_.theta * sign_s * k_.h + k_.by_velocity * p) * drift_;  // in R
    const double q = (v_old_ + k_.h * p * (known + slope - k_.mu1)) /
                     (k_.kappa * p * (v_old_ + k_.h * p * slope) + k_.h * k_.mu2);
    return finished({s_old_ + k_.h * r(p, q) * drift_, 0.0, sign_s, lambda(q, k_.old.lambda_v)},
                    known + slope * r(p, q), sign_s, 0.0);
  }

  /// s = 0, lambda_s between -1 and 1: as R v^ = -s_k / h, quadratic in it.
  std::array<Branch, 2> at_wall(double sign_v) {
    const double q = k_.lambda_v_hat(sign_v);
    const double known = k_.a + k_.by_x * x_hat(0.0);
    const double speed = -s_old_ / k_.h;  // R v^
    const auto p =
        roots(-k_.h * k_.by_velocity * speed, k_.kappa * q * v_old_ / k_.theta - k_.h * (known - k_.mu1),
              k_.h * k_.mu2 * q + (speed - v_old_) / k_.theta);
    const auto branch = [&](double root) {
      const double v = (speed / r(root, q) - drift_) / k_.theta;  // + 0 below: no negative zeros
      return finished({0.0, v + 0.0, lambda(root, k_.old.lambda_s) + 0.0, sign_v},
                      known + k_.by_velocity * root * speed, 0.0, sign_v);
    };
    return {branch(p[0]), branch(p[1])};
  }

  /// s = v = 0, coming from elsewhere: for theta < 1 only. R and so the product of the signs are known.
  std::array<Branch, 2> stopping() {
    const double known_r = -s_old_ / (k_.h * drift_);
    const double product = (1.0 - known_r) / k_.kappa;
    const double a = k_.a + k_.by_x * x_hat(0.0) + k_.by_velocity * k_.velocity_hat;
    const auto p = roots(k_.h * (a - k_.mu1), known_r * v_old_, -k_.h * k_.mu2 * product);
    const auto branch = [&](double root) {
      return finished({0.0, 0.0, lambda(root, k_.old.lambda_s), lambda(product / root, k_.old.lambda_v)}, a,
                      0.0, 0.0);
    };
    return {branch(p[0]), branch(p[1])};
  }

  static Branch finished(const OscillatorState& state, double acceleration, double sign_s, double sign_v) {
    return {state, acceleration, sign_s, sign_v, 0.0};
  }

  const OscillatorStep& k_;
  double s_old_, v_old_;
  double drift_;  // the part of v^ that is known
};

}  // namespace

namespace {

/// Signs fit, to the bit; no rows' terms are needed to see that.
bool fits(const Branch& branch) {
  const OscillatorState& state = branch.state;
  const bool s_fits = branch.sign_s != 0.0 ? branch.sign_s * state.s >= 0.0 : std::abs(state.lambda_s) <= 1.0;
  const bool v_fits = branch.sign_v != 0.0 ? branch.sign_v * state.v >= 0.0 : std::abs(state.lambda_v) <= 1.0;
  return s_fits && v_fits && std::isfinite(state.s) && std::isfinite(state.v);
}

double misfit_of(const OscillatorStep& step, const Branch& branch) {
  const OscillatorState& state = branch.state;
  const OscillatorTerms terms = terms_of(step, state);
  const double misfit_s =
      branch.sign_s != 0.0 ? over(-branch.sign_s * state.s, terms.s) : std::abs(state.lambda_s) - 1.0;
  const double misfit_v =
      branch.sign_v != 0.0 ? over(-branch.sign_v * state.v, terms.v) : std::abs(state.lambda_v) - 1.0;
  const bool exists = std::isfinite(misfit_s) && std::isfinite(misfit_v);
  return exists ? std::max(misfit_s, misfit_v) : std::numeric_limits<double>::infinity();
}

}  // namespace

namespace {

Branch clamped(Branch branch) {
  branch.state.lambda_s = std::clamp(branch.state.lambda_s, -1.0, 1.0);
  branch.state.lambda_v = std::clamp(branch.state.lambda_v, -1.0, 1.0);
  return branch;
}

}  // namespace

/// An oscillator at rest on its wall, without control, that is pushed to it: signs make it move against the
/// push, so that no branch of those fits, and the rule has it stay (at_wall, lambda_s^ = 0).
bool is_pressed(const OscillatorStep& step) {
  return step.old.s == 0.0 && step.old.v == 0.0 && step.a < 0.0 && step.mu1 == 0.0 && step.mu2 == 0.0 &&
         (1.0 - step.gamma) * std::abs(step.old.lambda_s) < step.gamma &&
         step.h * step.theta * (step.h * step.theta * std::abs(step.by_x) + std::abs(step.by_velocity)) < 1.0;
}

Branch pressed(const OscillatorStep& step) {
  const double sign_v = kept_sign_v(step.old);
  const double lambda_s = -(1.0 - step.gamma) * step.old.lambda_s / step.gamma + 0.0;
  return {{0.0, 0.0, lambda_s, sign_v}, step.a, 0.0, sign_v, 0.0};
}

Branch choose_branch(const OscillatorStep& step) {
  if (is_pressed(step)) return pressed(step);
  const Branch first = Branches(step).first();  // most often it is that
  if (fits(first)) return first;
  Branch best;
  best.misfit = std::numeric_limits<double>::infinity();
  Branches(step).visit([&](const Branch& branch) {
    if (!fits(branch)) return false;
    best = branch;
    return true;
  });
  if (best.misfit <= 0.0) return clamped(best);
  Branches(step).visit([&](Branch branch) {  // rounding lies between all of them and a fit
    branch.misfit = misfit_of(step, branch);
    if (branch.misfit < best.misfit) best = branch;
    return best.misfit <= 0.0;
  });
  return clamped(best);
}

bool keep_branch(const OscillatorStep& step, Branch& branch) {
  if (branch.sign_s == 0.0 && branch.sign_v == kept_sign_v(step.old) && is_pressed(step)) {
    branch = pressed(step);
    return true;
  }
  bool kept = false;
  Branches(step).visit(branch.sign_s, branch.sign_v, [&](const Branch& now) {
    if (!fits(now)) return false;
    branch = clamped(now);
    return kept = true;
  });
  return kept;
}

bool prefers_another(const OscillatorStep& step, const OscillatorState& state) {
  constexpr double same = 1e-6;   // branches that meet are one; the others differ by much of their terms
  constexpr double clear = 1e-8;  // fits whatever the rounding
  const auto near = [&](const Branch& branch, double s, double v) {
    return std::abs(branch.state.s - state.s) <= same * s && std::abs(branch.state.v - state.v) <= same * v;
  };
  if (state.s == 0.0 && state.v == 0.0 && is_pressed(step)) return false;
  bool another = false;
  Branches(step).visit([&](const Branch& branch) {
    // Of their terms, or of two of them, which is less and known.
    bool reached = near(branch, std::abs(step.old.s), std::abs(step.old.v));
    if (!reached) {
      const OscillatorTerms terms = terms_of(step, state);
      reached = near(branch, terms.s, terms.v);
    }
    another = !reached && fits(branch) && misfit_of(step, branch) <= -clear;
    return reached || another;
  });
  return another;
}

}  // namespace sweepvi
