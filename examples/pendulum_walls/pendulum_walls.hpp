#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

#include "sweepvi/nonlinear_lagrangian.hpp"

/// A row of carts on springs, each with a pendulum whose bob swings between two walls. Cart at x_i, angle
/// phi_i from the vertical, bob at b_i = x_i + l sin phi_i:
///
///     M_i = | cart + bob          bob l cos phi |      F_i = | -bob l phi'^2 sin phi - S(x)_i |
///           | bob l cos phi       bob l^2       |            |  bob g l sin phi               |
///
///     wall - b_i >= 0,   wall + b_i >= 0,      S(x)_i = k sum over neighbours of (x_j - x_i),
///
/// where the carts at the ends are tied to x = 0. M depends on q, F on v, and the gaps are nonlinear. The
/// coordinates stand cart by cart, x phi; the gaps, too: right wall, left wall.
class PendulumWalls final : public sweepvi::NonlinearLagrangian {
public:
  struct Parameters {
    PetscInt count = 1;
    double cart = 2.0;         ///< mass [kg]
    double bob = 1.0;          ///< mass [kg]
    double length = 1.0;       ///< l [m]
    double gravity = 9.81;     ///< g [m/s^2]
    double stiffness = 20.0;   ///< k [N/m]
    double wall = 0.3;         ///< from the middle [m]
    double e = 0.8;            ///< restitution
    bool own_jacobian = true;  ///< false: by finite differences
  };

  PendulumWalls(MPI_Comm comm, const Parameters& parameters) : comm_(comm), p_(parameters) {
    PetscInt count = p_.count;
    sweepvi::check(PetscSplitOwnership(comm, &mine_, &count));
    PetscInt last = 0;
    MPI_Scan(&mine_, &last, 1, MPIU_INT, MPI_SUM, comm);
    first_ = last - mine_;
  }

  /// Carts at rest, pendulums aside, by turns to the right and left, and swinging.
  sweepvi::Vector initial_position() const override { return pairs(0.25, -0.2); }
  sweepvi::Vector initial_velocity() const override { return pairs(2.0, -0.5); }
  std::vector<double> restitution() const override {
    return std::vector<double>(static_cast<std::size_t>(2 * mine_), p_.e);
  }

  sweepvi::Matrix mass_pattern() const override { return matrix(2, 0); }
  void mass(Vec q, Mat M) const override {
    const sweepvi::ReadArray at(q);
    for (PetscInt i = 0; i < mine_; ++i) {
      const double mixed = p_.bob * p_.length * std::cos(at[2 * i + 1]);
      set(M, i, i, {p_.cart + p_.bob, mixed, mixed, p_.bob * p_.length * p_.length}, INSERT_VALUES);
    }
  }

  void force(double, Vec q, Vec v, Vec F) const override {
    const Neighbours x(*this, q);
    const sweepvi::ReadArray at(q);
    const sweepvi::ReadArray speed(v);
    const sweepvi::WriteArray force(F);
    for (PetscInt i = 0; i < mine_; ++i) {
      const double phi = at[2 * i + 1];
      const double turn = speed[2 * i + 1];
      const double pull = p_.stiffness * (x.left(i) + x.right(i) - 2.0 * at[2 * i]);
      force[2 * i] = -p_.bob * p_.length * turn * turn * std::sin(phi) - pull;
      force[2 * i + 1] = p_.bob * p_.gravity * p_.length * std::sin(phi);
    }
  }

  sweepvi::Matrix gap_pattern() const override { return matrix(2, 0); }
  void gaps(Vec q, Vec g) const override {
    const sweepvi::ReadArray at(q);
    const sweepvi::WriteArray gap(g);
    for (PetscInt i = 0; i < mine_; ++i) {
      const double b = at[2 * i] + p_.length * std::sin(at[2 * i + 1]);
      gap[2 * i] = p_.wall - b;
      gap[2 * i + 1] = p_.wall + b;
    }
  }
  void gap_gradient(Vec q, Mat H) const override {
    const sweepvi::ReadArray at(q);
    for (PetscInt i = 0; i < mine_; ++i) {
      const double slope = p_.length * std::cos(at[2 * i + 1]);
      set(H, i, i, {-1.0, -slope, 1.0, slope}, INSERT_VALUES);
    }
  }

  sweepvi::Matrix jacobian_pattern() const override { return matrix(4, 2); }
  bool force_jacobian(double, Vec q, Vec v, double by_q, double by_v, Mat J) const override {
    if (!p_.own_jacobian) return false;
    const sweepvi::ReadArray at(q);
    const sweepvi::ReadArray speed(v);
    for (PetscInt i = 0; i < mine_; ++i) {
      const double s = std::sin(at[2 * i + 1]);
      const double c = std::cos(at[2 * i + 1]);
      const double turn = speed[2 * i + 1];
      set(J, i, i,
          {by_q * 2.0 * p_.stiffness,
           -p_.bob * p_.length * turn * (by_q * turn * c + by_v * 2.0 * s),  //
           0.0, by_q * p_.bob * p_.gravity * p_.length * c},
          ADD_VALUES);
      for (const PetscInt j : {i - 1, i + 1})
        if (exists(j)) set(J, i, j, {-by_q * p_.stiffness, 0.0, 0.0, 0.0}, ADD_VALUES);
    }
    return true;
  }
  bool mass_jacobian(Vec q, Vec a, double factor, Mat J) const override {
    if (!p_.own_jacobian) return false;
    const sweepvi::ReadArray at(q);
    const sweepvi::ReadArray by(a);
    for (PetscInt i = 0; i < mine_; ++i) {
      const double slope = -factor * p_.bob * p_.length * std::sin(at[2 * i + 1]);
      set(J, i, i, {0.0, slope * by[2 * i + 1], 0.0, slope * by[2 * i]}, ADD_VALUES);
    }
    return true;
  }

  double potential(Vec q) const override {
    const Neighbours x(*this, q);
    const sweepvi::ReadArray at(q);
    double sum = 0.0;
    for (PetscInt i = 0; i < mine_; ++i) {
      const double before = at[2 * i] - x.left(i);
      sum += 0.5 * p_.stiffness * before * before;
      if (first_ + i + 1 == p_.count) sum += 0.5 * p_.stiffness * at[2 * i] * at[2 * i];
      sum += p_.bob * p_.gravity * p_.length * (1.0 - std::cos(at[2 * i + 1]));
    }
    return sum;
  }

private:
  /// Positions of the carts beside those of this rank: two numbers from the neighbouring ranks' ends.
  class Neighbours {
  public:
    Neighbours(const PendulumWalls& carts, Vec q) : at_(q), mine_(carts.mine_) {
      const std::array<double, 2> ends = {mine_ > 0 ? at_[0] : 0.0, mine_ > 0 ? at_[2 * mine_ - 2] : 0.0};
      int rank = 0;
      int size = 1;
      MPI_Comm_rank(carts.comm_, &rank);
      MPI_Comm_size(carts.comm_, &size);
      const int before = rank > 0 ? rank - 1 : MPI_PROC_NULL;
      const int after = rank + 1 < size ? rank + 1 : MPI_PROC_NULL;
      MPI_Sendrecv(&ends[1], 1, MPI_DOUBLE, after, 0, &left_, 1, MPI_DOUBLE, before, 0, carts.comm_,
                   MPI_STATUS_IGNORE);
      MPI_Sendrecv(&ends[0], 1, MPI_DOUBLE, before, 1, &right_, 1, MPI_DOUBLE, after, 1, carts.comm_,
                   MPI_STATUS_IGNORE);
    }
    double left(PetscInt i) const { return i > 0 ? at_[2 * (i - 1)] : left_; }
    double right(PetscInt i) const { return i + 1 < mine_ ? at_[2 * (i + 1)] : right_; }

  private:
    sweepvi::ReadArray at_;
    PetscInt mine_;
    double left_ = 0.0, right_ = 0.0;  // 0: tied to the ground
  };

  /// (0, value + change (i modulo 3)) for each element.
  sweepvi::Vector pairs(double value, double change) const {
    sweepvi::Vector vector;
    sweepvi::check(VecCreateMPI(comm_, 2 * mine_, PETSC_DETERMINE, vector.put()));
    const sweepvi::WriteArray values(vector.get());
    for (PetscInt i = 0; i < mine_; ++i) {
      values[2 * i] = 0.0;
      values[2 * i + 1] = value + change * static_cast<double>((first_ + i) % 3);
    }
    return vector;
  }

  bool exists(PetscInt i) const { return first_ + i >= 0 && first_ + i < p_.count; }

  /// Sets the 2 x 2 block of elements i and j of this rank's numbers.
  void set(Mat matrix, PetscInt i, PetscInt j, const std::array<double, 4>& values, InsertMode mode) const {
    const std::array<PetscInt, 2> rows = {2 * (first_ + i), 2 * (first_ + i) + 1};
    const std::array<PetscInt, 2> columns = {2 * (first_ + j), 2 * (first_ + j) + 1};
    sweepvi::check(MatSetValues(matrix, 2, rows.data(), 2, columns.data(), values.data(), mode));
  }

  /// An empty matrix with 2 x 2 blocks: of each element with itself, and with its neighbours if `beside` > 0.
  sweepvi::Matrix matrix(PetscInt width, PetscInt beside) const {
    sweepvi::Matrix result;
    sweepvi::check(MatCreateAIJ(comm_, 2 * mine_, 2 * mine_, PETSC_DETERMINE, PETSC_DETERMINE, width + beside,
                                nullptr, beside == 0 ? 0 : 4, nullptr, result.put()));
    for (PetscInt i = 0; i < mine_; ++i) {
      set(result.get(), i, i, {}, INSERT_VALUES);
      if (beside == 0) continue;
      for (const PetscInt j : {i - 1, i + 1})
        if (exists(j)) set(result.get(), i, j, {}, INSERT_VALUES);
    }
    sweepvi::check(MatAssemblyBegin(result.get(), MAT_FINAL_ASSEMBLY));
    sweepvi::check(MatAssemblyEnd(result.get(), MAT_FINAL_ASSEMBLY));
    return result;
  }

  MPI_Comm comm_;
  Parameters p_;
  PetscInt mine_ = PETSC_DECIDE;  // this rank's elements
  PetscInt first_ = 0;            // number of the first one
};
