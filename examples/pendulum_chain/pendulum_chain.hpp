#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

#include "sweepvi/zd_system.hpp"

/// A chain of pendulums on flexible joints, each before a wall at angle 0. Link q_i, motor p_i:
///
///     q_i'' = -g sin q_i + k (p_i - q_i) + c S(q)_i,     p_i'' = k_m (q_i - p_i) + torque + lambda_i,
///     w_i = q_i >= 0,                                    S(q)_i = sum over neighbours of (q_j - q_i).
///
/// Only the motor can be pushed: relative degree 4. Zero-dynamics form, z = (q, q', q'', q'''), no xi:
///
///     z4' = -g cos(z1) z3 + g sin(z1) z2^2 - (k + k_m) z3 - k_m g sin z1 + c k_m S(z1) + c S(z3) + k torque
///     + k lambda,
///
/// where p was eliminated by z3 = -g sin z1 + k (p - z1) + c S(z1). The state is z1 z2 z3 z4 element by
/// element.
class PendulumChain final : public sweepvi::ZdSystem {
public:
  struct Parameters {
    PetscInt count = 1;
    double gravity = 9.81;     ///< g, over the length [1/s^2]
    double joint = 10.0;       ///< k, over the link's inertia [1/s^2]
    double motor = 10.0;       ///< k_m, the joint's stiffness over the motor's inertia [1/s^2]
    double torque = -1.0;      ///< over the motor's inertia [1/s^2]
    double coupling = 1.0;     ///< c [1/s^2]
    double sine = 1.0;         ///< 1: a pendulum; 0: its linearisation, sin x = x
    bool own_jacobian = true;  ///< false: by finite differences
  };

  PendulumChain(MPI_Comm comm, const Parameters& parameters) : parameters_(parameters) {
    PetscInt count = parameters.count;
    sweepvi::check(PetscSplitOwnership(comm, &elements_, &count));
    sweepvi::check(MatCreateAIJ(comm, 4 * elements_, 4 * elements_, PETSC_DETERMINE, PETSC_DETERMINE, 8,
                                nullptr, 8, nullptr, linear_.put()));
    sweepvi::check(MatGetOwnershipRange(linear_.get(), &first_, nullptr));
    for (PetscInt i = first_ / 4; i < first_ / 4 + elements_; ++i)
      add_linear_row(i);
    sweepvi::check(MatAssemblyBegin(linear_.get(), MAT_FINAL_ASSEMBLY));
    sweepvi::check(MatAssemblyEnd(linear_.get(), MAT_FINAL_ASSEMBLY));
  }

  std::vector<Constraint> constraints() const override {
    std::vector<Constraint> result;
    for (PetscInt i = 0; i < elements_; ++i)
      result.push_back({.levels = {4 * i, 4 * i + 1, 4 * i + 2, 4 * i + 3}});
    return result;
  }

  /// At rest, q = p: z3 and z4 follow from the equation of the link.
  sweepvi::Vector initial_state() const override {
    sweepvi::Vector u;
    sweepvi::check(MatCreateVecs(linear_.get(), u.put(), nullptr));
    const sweepvi::WriteArray z(u.get());
    for (PetscInt i = 0; i < elements_; ++i) {
      const PetscInt element = first_ / 4 + i;
      const double q = start(element);
      double pull = 0.0;
      for (const PetscInt j : {element - 1, element + 1})
        if (j >= 0 && j < parameters_.count) pull += start(j) - q;
      z[4 * i] = q;
      z[4 * i + 1] = z[4 * i + 3] = 0.0;
      z[4 * i + 2] = -parameters_.gravity * sine(q) + parameters_.coupling * pull;
    }
    return u;
  }

  void rates(double, Vec u, Vec rates) const override {
    sweepvi::check(MatMult(linear_.get(), u, rates));
    const sweepvi::ReadArray z(u);
    const sweepvi::WriteArray rate(rates);
    const Parameters& p = parameters_;
    for (PetscInt i = 0; i < 4 * elements_; i += 4)
      rate[i + 3] += p.gravity * (-cosine(z[i]) * z[i + 2] + p.sine * std::sin(z[i]) * z[i + 1] * z[i + 1] -
                                  p.motor * sine(z[i])) +
                     p.joint * p.torque;
  }

  /// d z4' / d lambda: the push on the motor, through the joint.
  void gains(double, Vec, std::vector<double>& m) const override {
    m.assign(static_cast<std::size_t>(elements_), parameters_.joint);
  }

  sweepvi::Matrix pattern() const override {
    sweepvi::Matrix copy;
    sweepvi::check(MatDuplicate(linear_.get(), MAT_COPY_VALUES, copy.put()));
    return copy;
  }

  bool jacobian(double, Vec u, Mat jacobian) const override {
    if (!parameters_.own_jacobian) return false;
    sweepvi::check(MatCopy(linear_.get(), jacobian, SAME_NONZERO_PATTERN));
    const sweepvi::ReadArray z(u);
    const Parameters& p = parameters_;
    for (PetscInt i = 0; i < 4 * elements_; i += 4) {
      const double s = p.sine * std::sin(z[i]);
      const double c = p.sine * std::cos(z[i]);
      const std::array<double, 3> nonlinear = {
          p.gravity * (s * z[i + 2] + c * z[i + 1] * z[i + 1] - p.motor * cosine(z[i])),
          p.gravity * 2.0 * s * z[i + 1], -p.gravity * cosine(z[i])};
      const PetscInt row = first_ + i + 3;
      const std::array<PetscInt, 3> columns = {first_ + i, first_ + i + 1, first_ + i + 2};
      sweepvi::check(MatSetValues(jacobian, 1, &row, 3, columns.data(), nonlinear.data(), ADD_VALUES));
    }
    return true;
  }

private:
  double start(PetscInt element) const { return 0.5 + 0.1 * static_cast<double>(element % 3); }
  double sine(double x) const { return parameters_.sine * std::sin(x) + (1.0 - parameters_.sine) * x; }
  double cosine(double x) const { return parameters_.sine * std::cos(x) + (1.0 - parameters_.sine); }

  /// What z4' of an element reads linearly, and room for what it does not.
  void add_linear_row(PetscInt i) {
    const Parameters& p = parameters_;
    std::vector<PetscInt> columns;
    std::vector<double> values;
    double neighbours = 0.0;
    for (const PetscInt j : {i - 1, i + 1}) {
      if (j < 0 || j >= p.count || p.coupling == 0.0) continue;
      neighbours += 1.0;
      columns.insert(columns.end(), {4 * j, 4 * j + 2});
      values.insert(values.end(), {p.coupling * p.motor, p.coupling});
    }
    columns.insert(columns.end(), {4 * i, 4 * i + 1, 4 * i + 2});
    values.insert(values.end(),
                  {-neighbours * p.coupling * p.motor, 0.0, -neighbours * p.coupling - p.joint - p.motor});
    const PetscInt row = 4 * i + 3;
    sweepvi::check(MatSetValues(linear_.get(), 1, &row, static_cast<PetscInt>(columns.size()), columns.data(),
                                values.data(), INSERT_VALUES));
  }

  Parameters parameters_;
  PetscInt elements_ = PETSC_DECIDE;  // this rank's
  PetscInt first_ = 0;                // its first state
  sweepvi::Matrix linear_;
};
