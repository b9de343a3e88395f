#include "dvi/tracking_step.hpp"

#include <algorithm>
#include <cmath>

namespace sweepvi {

void TrackingStep::begin(const Step& step, const Unknowns& start) {
  h_ = step.h;
  t_ = step.t_old + options_.theta * step.h;
  start_ = start;
}

double TrackingStep::weighted_sign(const Unknowns& u, int lambda) const {
  return options_.gamma * u[lambda] + (1.0 - options_.gamma) * start_[lambda];
}

double TrackingStep::weighted_x(const Unknowns& u, int s, int lambda_s) const {
  return options_.theta * u[lambda_s] * u[s] + (1.0 - options_.theta) * std::abs(start_[s]);
}

TrackingStep::Mass TrackingStep::mass(const Bouncer& bouncer, const Unknowns& u, int s, int lambda_s) const {
  Mass mass{};
  mass.sign_s = weighted_sign(u, lambda_s);
  mass.sign_v = weighted_sign(u, lambda_s + 1);
  mass.R = 1.0 - bouncer.kappa * mass.sign_s * mass.sign_v;
  mass.v = options_.theta * u[s + 1] + (1.0 - options_.theta) * start_[s + 1];
  mass.force = bouncer.force(t_, weighted_x(u, s, lambda_s), mass.R * mass.v * mass.sign_s);
  return mass;
}

// The derivatives of the force by s, v, lambda_s, lambda_v of its mass; those of the law by differences.
Eigen::Vector4d TrackingStep::force_gradient(const Bouncer& bouncer, const Mass& mass, const Unknowns& u,
                                             int s, int lambda_s) const {
  if (bouncer.force.of_time()) return Eigen::Vector4d::Zero();
  const double x = weighted_x(u, s, lambda_s);
  const double velocity = mass.R * mass.v * mass.sign_s;
  const double dx = 1e-7 * (1.0 + std::abs(x));  // upwards: a law need not know x < 0
  const double dv = 1e-7 * (1.0 + std::abs(velocity));
  const double by_x = (bouncer.force(t_, x + dx, velocity) - mass.force) / dx;
  const double by_velocity = (bouncer.force(t_, x, velocity + dv) - mass.force) / dv;
  const double theta = options_.theta;
  const double gamma = options_.gamma;
  return {by_x * theta * u[lambda_s], by_velocity * theta * mass.R * mass.sign_s,
          by_x * theta * u[s] + by_velocity * gamma * mass.v * (2.0 * mass.R - 1.0),
          -by_velocity * gamma * mass.v * bouncer.kappa * mass.sign_s * mass.sign_s};
}

// mu1 lambda_es + mu2 lambda_ev
double TrackingStep::brake(const Unknowns& u) const {
  return problem_.gains.mu1 * weighted_sign(u, LES) + problem_.gains.mu2 * weighted_sign(u, LEV);
}

TrackingStep::Unknowns TrackingStep::residual(const Unknowns& u) const {
  const Mass plant = mass(problem_.plant, u, S, LS);
  const Mass ref = mass(problem_.reference, u, SREF, LSREF);
  const double g = ref.sign_s * ref.force / ref.R;
  const double square = plant.sign_s * plant.sign_s;
  Unknowns f;
  f[S] = u[S] - start_[S] - h_ * plant.R * plant.v;
  f[V] = u[V] - start_[V] -
         h_ * (square * (g - brake(u)) + plant.sign_s * (1.0 - square) * plant.force / plant.R);
  f[SREF] = u[SREF] - start_[SREF] - h_ * ref.R * ref.v;
  f[VREF] = u[VREF] - start_[VREF] - h_ * g;
  f.segment<4>(LS) = -u.segment<4>(S);
  f[LES] = u[SREF] - u[S];
  f[LEV] = u[VREF] - u[V];
  return f;
}

// s is known no better than the v it moves with: its row counts the terms of v's row in place of v, as HO
// (26) does by inserting (25). Weighted signs are sums, too.
TrackingStep::Unknowns TrackingStep::terms(const Unknowns& u) const {
  const double theta = options_.theta;
  const double gamma = options_.gamma;
  const auto size_of_sign = [&](int lambda) {
    return gamma * std::abs(u[lambda]) + (1.0 - gamma) * std::abs(start_[lambda]);
  };
  const Mass plant = mass(problem_.plant, u, S, LS);
  const Mass ref = mass(problem_.reference, u, SREF, LSREF);
  const double sign_s = size_of_sign(LS);
  const double square = sign_s * sign_s;
  const double g = size_of_sign(LSREF) * std::abs(ref.force) / ref.R;
  const double brakes = problem_.gains.mu1 * size_of_sign(LES) + problem_.gains.mu2 * size_of_sign(LEV);
  Unknowns terms;
  terms[V] = std::abs(u[V]) + std::abs(start_[V]) +
             h_ * (square * (g + brakes) + sign_s * (1.0 + square) * std::abs(plant.force) / plant.R);
  terms[VREF] = std::abs(u[VREF]) + std::abs(start_[VREF]) + h_ * g;
  const auto path = [&](const Bouncer& bouncer, int s, int lambda_s) {
    const double R = 1.0 + bouncer.kappa * size_of_sign(lambda_s) * size_of_sign(lambda_s + 1);
    const double v = theta * terms[s + 1] + (1.0 - theta) * std::abs(start_[s + 1]);
    return std::abs(u[s]) + std::abs(start_[s]) + h_ * R * v;
  };
  terms[S] = path(problem_.plant, S, LS);
  terms[SREF] = path(problem_.reference, SREF, LSREF);
  terms.segment<4>(LS) = terms.segment<4>(S);
  terms[LES] = terms[S] + terms[SREF];
  terms[LEV] = terms[V] + terms[VREF];
  return terms;
}

TrackingStep::Jacobian TrackingStep::jacobian(const Unknowns& u) const {
  const Mass plant = mass(problem_.plant, u, S, LS);
  const Mass ref = mass(problem_.reference, u, SREF, LSREF);
  const double theta = options_.theta;
  const double gamma = options_.gamma;
  Jacobian J = Jacobian::Zero();

  // s - s_k - h R^ v^
  const auto path = [&](const Bouncer& bouncer, const Mass& mass, int s, int lambda_s) {
    J(s, s) = 1.0;
    J(s, s + 1) = -h_ * theta * mass.R;
    J(s, lambda_s) = h_ * gamma * bouncer.kappa * mass.sign_v * mass.v;
    J(s, lambda_s + 1) = h_ * gamma * bouncer.kappa * mass.sign_s * mass.v;
  };
  path(problem_.plant, plant, S, LS);
  path(problem_.reference, ref, SREF, LSREF);

  // g = sign_s F / R by s, v, lambda_s, lambda_v of the reference
  const double kappa_ref = problem_.reference.kappa;
  const double per_force = ref.sign_s / ref.R;
  Eigen::Vector4d g = per_force * force_gradient(problem_.reference, ref, u, SREF, LSREF);
  g[2] += gamma * ref.force / (ref.R * ref.R);  // 1/R + sign_s kappa sign_v / R^2 = 1/R^2
  g[3] += gamma * per_force * per_force * kappa_ref * ref.force;
  const std::array<int, 4> of_ref = {SREF, VREF, LSREF, LVREF};
  const std::array<int, 4> of_plant = {S, V, LS, LV};
  const double square = plant.sign_s * plant.sign_s;
  J(V, V) = J(VREF, VREF) = 1.0;
  for (int i = 0; i < 4; ++i) {
    J(VREF, of_ref[static_cast<std::size_t>(i)]) -= h_ * g[i];
    J(V, of_ref[static_cast<std::size_t>(i)]) -= h_ * square * g[i];
  }

  // sign_s^2 (g - brake) + K F with K = sign_s (1 - sign_s^2) / R
  const double K = plant.sign_s * (1.0 - square) / plant.R;
  const double kappa = problem_.plant.kappa;
  Eigen::Vector4d a = K * force_gradient(problem_.plant, plant, u, S, LS);
  a[2] += gamma * (2.0 * plant.sign_s * (per_force * ref.force - brake(u)) +
                   ((1.0 - 3.0 * square) + K * kappa * plant.sign_v) * plant.force / plant.R);
  a[3] += gamma * K * kappa * plant.sign_s * plant.force / plant.R;
  for (int i = 0; i < 4; ++i)
    J(V, of_plant[static_cast<std::size_t>(i)]) -= h_ * a[i];
  J(V, LES) = h_ * gamma * square * problem_.gains.mu1;
  J(V, LEV) = h_ * gamma * square * problem_.gains.mu2;

  for (int i = 0; i < 4; ++i)
    J(LS + i, S + i) = -1.0;
  J(LES, S) = J(LEV, V) = -1.0;
  J(LES, SREF) = J(LEV, VREF) = 1.0;
  return J;
}

double TrackingStep::control(const Unknowns& u) const {
  const Mass plant = mass(problem_.plant, u, S, LS);
  const Mass ref = mass(problem_.reference, u, SREF, LSREF);
  const double g = ref.sign_s * ref.force / ref.R;
  return plant.R * plant.sign_s * (g - brake(u)) - plant.sign_s * plant.sign_s * plant.force;
}

double TrackingStep::control_bound(const Unknowns& u) const {
  const double force = std::abs(mass(problem_.plant, u, S, LS).force);
  const double force_ref = std::abs(mass(problem_.reference, u, SREF, LSREF).force);
  return (1.0 + problem_.plant.kappa) *
             (problem_.gains.mu1 + problem_.gains.mu2 + force_ref / (1.0 - problem_.reference.kappa)) +
         force;
}

bool TrackingStep::admissible(const Unknowns& u) const {
  if (u[SREF] == 0.0 && u[VREF] == 0.0 && mass(problem_.reference, u, SREF, LSREF).force > 0.0) return false;
  if (u[S] != 0.0 || u[V] != 0.0) return true;
  const double force = mass(problem_.plant, u, S, LS).force;
  const double pull = control(u);
  return force + pull <= held_rtol * (std::abs(force) + std::abs(pull));
}

}  // namespace sweepvi
