#pragma once

#include <memory>
#include <vector>

#include "sweepvi/lagrangian.hpp"

namespace sweepvi {

/// A nonlinear mechanical system with unilateral constraints, written by its user:
///
///     M(q) dv + F(q, v, t) dt = H(q)' dlambda,    0 <= g(q),    H = dg/dq,
///
/// and Newton's law of impact (H v)+ >= -e (H v)- where a gap is closed. F holds everything else: Coriolis
/// and centrifugal terms, -(external forces). M is symmetric positive definite. The coordinates are
/// distributed over the ranks as the user likes, and so are the constraints.
/// Source: Acary & Brogliato (AB), eq. (14)-(16).
///
/// All methods are collective unless they say otherwise. Matrices come zeroed, in the pattern given; they are
/// assembled for you after entries were set.
class NonlinearLagrangian {
public:
  virtual ~NonlinearLagrangian() = default;

  virtual Vector initial_position() const = 0;  ///< q at the start; its layout is that of all vectors
  virtual Vector initial_velocity() const = 0;  ///< v at the start
  /// e of each constraint this rank owns, 0 to 1. @note Not collective.
  virtual std::vector<double> restitution() const = 0;

  virtual Matrix mass_pattern() const = 0;                      ///< n x n (AIJ); the values do not matter
  virtual void mass(Vec q, Mat M) const = 0;                    ///< sets M(q)
  virtual void force(double t, Vec q, Vec v, Vec F) const = 0;  ///< fills F(q, v, t)

  virtual Matrix gap_pattern() const = 0;             ///< m x n (AIJ), rows laid out like `restitution`
  virtual void gaps(Vec q, Vec g) const = 0;          ///< fills g(q)
  virtual void gap_gradient(Vec q, Mat H) const = 0;  ///< sets H(q)

  /// n x n (AIJ): where dF/dq, dF/dv or d(M a)/dq have entries.
  virtual Matrix jacobian_pattern() const = 0;
  /// Adds (ADD_VALUES) by_q dF/dq + by_v dF/dv to J and returns true; or returns false to have all found by
  /// finite differences.
  virtual bool force_jacobian(double t, Vec q, Vec v, double by_q, double by_v, Mat J) const;
  /// Adds (ADD_VALUES) factor d(M(q) a)/dq, a fixed, to J and returns true; likewise. A constant M has
  /// nothing to add.
  virtual bool mass_jacobian(Vec q, Vec a, double factor, Mat J) const;

  /// This rank's part of the potential energy, for MechanicalDvi::energy. @note Not collective.
  virtual double potential(Vec q) const;
};

/// How far the system's own derivatives are from finite differences at (t, q, v): the largest difference of a
/// row's entries over its largest entry (or 1), of the momentum equation's Jacobian and, in a direction, of
/// H. About 1e-7 for right derivatives of well-scaled functions. @note Collective.
double jacobian_error(const NonlinearLagrangian& system, double t, Vec q, Vec v);

/// Discretises `system` by Moreau and Jean's scheme on `grid`: with x_theta = theta x_{k+1} + (1-theta) x_k,
///
///     M(q_theta) (v_{k+1} - v_k) + h [ theta F_{k+1} + (1-theta) F_k ] = H(q~)' mu_{k+1},
///     q_{k+1} = q_k + h v_theta,
///     g(q~) <= 0 (detected):  0 <= H(q~) v_{k+1} + e H(q~) v_k  _|_  mu_{k+1} >= 0;   else mu_{k+1} = 0,
///
/// where q~ is the position that detects (AB (22): q_k + h v_k). With theta = 1/2, M at the midpoint makes
/// free flight second order. Where g is not linear, contact drifts by O(h^2) a step. The unknowns are v and
/// an impulse for each constraint. In `energy`, F is not split up: damping, work and scheme stay 0, and
/// kinetic + potential + dissipated is kept up to the error of the scheme. `system` must outlive the result.
/// @throws Error (bad_input) on every rank: theta outside (0, 1], e outside [0, 1], sizes that disagree, no
/// positive diagonal in M at the start
/// @note Collective.
std::unique_ptr<MechanicalDvi> make_moreau_jean(const NonlinearLagrangian& system,
                                                const MoreauJeanOptions& options, const TimeGrid& grid);

}  // namespace sweepvi
