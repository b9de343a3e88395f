// The step of a TrackingStep by branches: first the reference, which is on its own, then the plant.

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "dvi/sign_inclusion.hpp"
#include "dvi/tracking_step.hpp"

namespace sweepvi {

namespace {

using Values = SignInclusion::Values;
using Block = SignInclusion::Block;

int sign(double value) {
  return value > 0.0 ? 1 : value < 0.0 ? -1 : 0;
}

// The first that is not 0.
int first_of(int a, int b) {
  return a != 0 ? a : b;
}

// A sign as it was, the other one, none; where it had none, none and then upwards.
std::array<int, 3> keep(int sign) {
  if (sign == 0) return {0, 1, -1};
  return {sign, -sign, 0};
}

Values make(std::initializer_list<double> values) {
  Values vector(static_cast<Eigen::Index>(values.size()));
  std::copy(values.begin(), values.end(), vector.begin());
  return vector;
}

}  // namespace

// The forces of the last round make the next one: each gains a factor h times their derivatives.
std::optional<TrackingStep::Solution> TrackingStep::solve() const {
  constexpr int most_rounds = 40;
  const bool of_time = problem_.plant.force.of_time() && problem_.reference.force.of_time();
  Solution solution{start_, false};
  for (int round = 0; round < most_rounds && !solution.exact; ++round) {
    if (!solve_reference(solution.u) || !solve_plant(solution.u)) return std::nullopt;
    solution.exact = of_time || holds(solution.u);
  }
  return solution;
}

// The equations at u, with the forces at u. The signs fit by construction.
bool TrackingStep::holds(const Unknowns& u) const {
  constexpr double rounded = 32 * std::numeric_limits<double>::epsilon();
  return (residual(u).head<4>().cwiseAbs().array() <= rounded * terms(u).head<4>().array()).all();
}

// s_k + h R v with the v of u.
double TrackingStep::follow(const Bouncer& bouncer, const Unknowns& u, int s, int lambda_s) const {
  const Mass moved = mass(bouncer, u, s, lambda_s);
  return start_[s] + h_ * moved.R * moved.v;
}

// With the force at u: lambda_s in sgn(s), lambda_v in sgn(v), where
//   v = v_k + h g,   s = s_k + h R (v_k + theta h g),   g = sign_s F / R.
bool TrackingStep::solve_reference(Unknowns& u) const {
  const double kappa = problem_.reference.kappa;
  const double force = mass(problem_.reference, u, SREF, LSREF).force;
  const double s = start_[SREF];
  const double v = start_[VREF];
  const double lambda_s = start_[LSREF];
  const double lambda_v = start_[LVREF];
  const double gamma = options_.gamma;
  const double theta = options_.theta;

  SignInclusion inclusion;
  inclusion.outputs = [&](const Values& lambda) {
    SignInclusion::Outputs at{Values(2), Block(2, 2), Values(2)};
    const double sign_s = gamma * lambda[0] + (1.0 - gamma) * lambda_s;
    const double sign_v = gamma * lambda[1] + (1.0 - gamma) * lambda_v;
    const double R = 1.0 - kappa * sign_s * sign_v;
    const double g = sign_s * force / R;
    const double mean_v = v + theta * h_ * g;
    at.y[0] = s + h_ * R * mean_v;
    at.y[1] = v + h_ * g;
    const Eigen::RowVector2d R_by(-kappa * sign_v, -kappa * sign_s);
    const Eigen::RowVector2d g_by = Eigen::RowVector2d(force / R, 0.0) - g / R * R_by;
    at.derivative.row(0) = gamma * h_ * (mean_v * R_by + R * theta * h_ * g_by);
    at.derivative.row(1) = gamma * h_ * g_by;
    Unknowns there = u;
    there.segment<2>(SREF) = at.y;
    there.segment<2>(LSREF) = lambda;
    at.terms = terms(there).segment<2>(SREF);
    return at;
  };
  const double kick = h_ * std::abs(force) / (1.0 - kappa);
  const double path = h_ * (1.0 + kappa) * (std::abs(v) + kick);
  inclusion.low = make({s - path, v - kick});
  inclusion.high = make({s + path, v + kick});
  const int upwards = 1;
  const int side = first_of(first_of(sign(s), sign(v)), upwards);
  inclusion.wanted = {keep(side), keep(first_of(sign(v), upwards))};
  inclusion.starts = {make({lambda_s, lambda_v}), make({0.0, lambda_v}), make({0.5 * side, 0.5 * side})};
  inclusion.admissible = [&](const Values&, const SignInclusion::Branch& branch) {
    return branch[0] != 0 || branch[1] != 0 || force <= 0.0;
  };
  const auto solution = inclusion.solve();
  if (!solution) return false;
  u.segment<2>(LSREF) = solution->lambda;
  u[VREF] = solution->branch[1] == 0 ? 0.0 : inclusion.outputs(solution->lambda).y[1];
  u[SREF] = solution->branch[0] == 0 ? 0.0 : follow(problem_.reference, u, SREF, LSREF);
  return true;
}

// With the forces and the reference's step at u: the signs of e_s, e_v, s, v, where
//   v = v_k + h a,   s = s_k + h R (v_k + theta h a),   a = sign_s^2 (g - c) + sign_s (1 - sign_s^2) F / R,
// c = mu1 lambda_es + mu2 lambda_ev, g the reference's acceleration.
bool TrackingStep::solve_plant(Unknowns& u) const {
  const Mass ref = mass(problem_.reference, u, SREF, LSREF);
  const double g = ref.sign_s * ref.force / ref.R;
  const double force = mass(problem_.plant, u, S, LS).force;
  const double kappa = problem_.plant.kappa;
  const double s = start_[S];
  const double v = start_[V];
  const double gamma = options_.gamma;
  const double theta = options_.theta;
  const std::array<int, 4> places = {LES, LEV, LS, LV};

  SignInclusion inclusion;
  inclusion.outputs = [&](const Values& lambda) {
    SignInclusion::Outputs at{Values(4), Block(4, 4), Values(4)};
    std::array<double, 4> mean{};
    for (std::size_t i = 0; i < 4; ++i)
      mean[i] = gamma * lambda[static_cast<Eigen::Index>(i)] + (1.0 - gamma) * start_[places[i]];
    const auto [sign_es, sign_ev, sign_s, sign_v] = mean;
    const double square = sign_s * sign_s;
    const double R = 1.0 - kappa * sign_s * sign_v;
    const double pull = g - problem_.gains.mu1 * sign_es - problem_.gains.mu2 * sign_ev;
    const double K = sign_s * (1.0 - square) / R;
    const double a = square * pull + K * force;
    const double mean_v = v + theta * h_ * a;
    at.y = make({s + h_ * R * mean_v - u[SREF], v + h_ * a - u[VREF], s + h_ * R * mean_v, v + h_ * a});
    const Eigen::RowVector4d R_by(0.0, 0.0, -kappa * sign_v, -kappa * sign_s);
    Eigen::RowVector4d a_by = -K * force / R * R_by;
    a_by += Eigen::RowVector4d(-square * problem_.gains.mu1, -square * problem_.gains.mu2,
                               2.0 * sign_s * pull + (1.0 - 3.0 * square) / R * force, 0.0);
    for (const Eigen::Index row : {0, 2}) {  // errors change as s and v do
      at.derivative.row(row) = gamma * h_ * (mean_v * R_by + R * theta * h_ * a_by);
      at.derivative.row(row + 1) = gamma * h_ * a_by;
    }
    Unknowns there = u;
    there.segment<2>(S) = at.y.tail(2);
    for (std::size_t i = 0; i < 4; ++i)
      there[places[i]] = lambda[static_cast<Eigen::Index>(i)];
    const Unknowns size = terms(there);
    for (std::size_t i = 0; i < 4; ++i)
      at.terms[static_cast<Eigen::Index>(i)] = size[places[i]];
    return at;
  };
  const double largest_K = 0.385 / (1.0 - kappa);  // sign_s (1 - sign_s^2) is at most 2 / 3^1.5
  const double kick =
      h_ * (problem_.gains.mu1 + problem_.gains.mu2 + std::abs(g) + largest_K * std::abs(force));
  const double path = h_ * (1.0 + kappa) * (std::abs(v) + kick);
  inclusion.low = make({s - path - u[SREF], v - kick - u[VREF], s - path, v - kick});
  inclusion.high = make({s + path - u[SREF], v + kick - u[VREF], s + path, v + kick});
  const int ref_s = sign(u[SREF]);
  const int ref_v = sign(u[VREF]);
  const int upwards = 1;
  const auto vanish = [&](double error) {
    const int was = first_of(sign(error), upwards);
    return std::array<int, 3>{0, was, -was};
  };
  inclusion.wanted = {vanish(s - start_[SREF]), vanish(v - start_[VREF]),
                      keep(first_of(first_of(sign(s), sign(v)), ref_s)), keep(first_of(sign(v), ref_v))};
  const double half = 0.5 * first_of(sign(s), upwards);
  inclusion.starts = {make({0.0, 0.0, u[LSREF], u[LVREF]}), make({0.0, 0.0, start_[LS], start_[LV]}),
                      make({0.0, 0.0, half, u[LVREF]}), make({0.0, 0.0, -half, u[LVREF]})};
  const auto placed = [&](const Values& lambda, const SignInclusion::Branch& branch) {
    Unknowns result = u;
    for (std::size_t i = 0; i < 4; ++i)
      result[places[i]] = lambda[static_cast<Eigen::Index>(i)];
    result[V] = branch[3] == 0 ? 0.0 : branch[1] == 0 ? u[VREF] : inclusion.outputs(lambda).y[3];
    result[S] = branch[2] == 0 ? 0.0 : branch[0] == 0 ? u[SREF] : follow(problem_.plant, result, S, LS);
    return result;
  };
  inclusion.admissible = [&](const Values& lambda, const SignInclusion::Branch& branch) {
    const Unknowns result = placed(lambda, branch);
    const bool resting = result[S] == 0.0 && result[V] == 0.0;
    return !resting || admissible(result);
  };
  const auto solution = inclusion.solve();
  if (!solution) return false;
  u = placed(solution->lambda, solution->branch);
  return true;
}

}  // namespace sweepvi
