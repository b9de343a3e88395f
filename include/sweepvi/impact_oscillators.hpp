#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "sweepvi/dvi.hpp"
#include "sweepvi/linear_system.hpp"
#include "sweepvi/petsc.hpp"
#include "sweepvi/regulator.hpp"
#include "sweepvi/time_grid.hpp"

namespace sweepvi {

class FiniteDifferences;

/// Oscillators of unit mass, each above a wall x_i = 0 that returns e_i = (1 - kappa_i)/(1 + kappa_i) of the
/// velocity, written by their user:
///
///     x_i'' = a_i(t, x, x'),      x_i >= 0,      x_i'+ = -e_i x_i'-  at x_i = 0.
///
/// Distributed over the ranks as the user likes; all vectors hold one entry for each oscillator. Source:
/// Huber & Oza (HO), eq. (1), for any number of oscillators.
class ImpactOscillators {
public:
  virtual ~ImpactOscillators() = default;

  /// kappa_i of this rank's oscillators, 0 < kappa_i < 1. Their number is that of all vectors. @note Not
  /// collective.
  virtual std::vector<double> kappa() const = 0;
  /// Positions x >= 0 [m] and velocities [m/s] at the start. @note Collective.
  virtual void start(Vec x, Vec velocity) const = 0;
  /// a_i(t, x, x') [m/s^2]. @note Collective.
  virtual void acceleration(double t, Vec x, Vec velocity, Vec a) const = 0;
  /// A matrix (AIJ) with the sparsity pattern of da/dx and da/dx'; its values do not matter. @note
  /// Collective.
  virtual Matrix pattern() const = 0;
  /// Fills da/dx and da/dx' (which come as 0), within the pattern, and returns true; or returns false to have
  /// them found by finite differences. @note Collective.
  virtual bool jacobian(double t, Vec x, Vec velocity, Mat by_x, Mat by_velocity) const;
  /// Whether a is linear in x and x' with coefficients that do not change: then `jacobian` is asked once.
  virtual bool linear() const { return false; }
  /// Whether a reads velocities at all: otherwise da/dx' is not asked for.
  virtual bool reads_velocities() const { return true; }
  /// Potential energy of this rank's part [J], where the acceleration has one: summed over the ranks it is
  /// the whole. @note Collective.
  virtual std::optional<double> potential(Vec x) const;
};

/// da/dx and da/dx' of ImpactOscillators: their own, or finite differences along the colours of the pattern
/// (-mat_coloring_type, -mat_fd_*). All members are collective.
class ImpactJacobian {
public:
  explicit ImpactJacobian(const ImpactOscillators& oscillators);
  ~ImpactJacobian();
  ImpactJacobian(const ImpactJacobian&) = delete;
  ImpactJacobian& operator=(const ImpactJacobian&) = delete;

  void evaluate(double t, Vec x, Vec velocity);
  void finite_differences(double t, Vec x, Vec velocity);  ///< likewise, whatever the oscillators offer
  // Of the last call, valid until the next.
  Mat by_x() const { return by_x_.get(); }
  Mat by_velocity() const { return by_velocity_.get(); }  ///< null if a does not read velocities

private:
  const ImpactOscillators& oscillators_;
  Matrix by_x_, by_velocity_;
  std::unique_ptr<FiniteDifferences> differences_by_x_, differences_by_velocity_;
  double t_ = 0.0;
  Vec x_ = nullptr, velocity_ = nullptr;  // where differences are taken
};

/// The oscillators of a chain with the element "zhuravlev-ivanov": states x, x' one after the other, w = x,
/// a = rows of x'.
/// @param kappa  of each oscillator this rank owns
/// @throws Error (bad_input) on every rank if the system is no such chain. `system` must outlive the result.
/// @note Collective on the system's communicator.
std::unique_ptr<ImpactOscillators> make_impact_oscillators(const LinearSystem& system,
                                                           std::vector<double> kappa);

// The transformation, HO section II -------------------------------------------------------------------

/// Where an oscillator is: x and x', or s and v.
struct Physical {
  double x = 0.0;         ///< [m], >= 0
  double velocity = 0.0;  ///< [m/s]
};
struct Transformed {
  double s = 0.0;  ///< [m]
  double v = 0.0;  ///< [m/s]
};

/// x = |s|, x' = (1 - kappa sgn(s) sgn(v)) v sgn(s). At s = 0 the side is that to which v leads: the velocity
/// after the impact, x' = (1 - kappa)|v|.
Physical to_physical(Transformed transformed, double kappa);
/// The one of its two inverses with sgn(s) = 1: s = x, v = x' / (1 - kappa sgn(x')), sgn(0) = 0.
Transformed to_transformed(Physical physical, double kappa);

// The process -----------------------------------------------------------------------------------------

struct ImpactOptions {
  double theta = 1.0;  ///< (0, 1], weight of t_{k+1} in the states
  double gamma = 1.0;  ///< (0, 1], weight of t_{k+1} in the signs
  std::optional<Regulator> regulator = {};
  bool resample = false;  ///< before each step from (x, x') anew, as a controller that reads a plant: HO IV
};

/// ImpactOscillators as a Dvi. The unknowns are s, v, lambda_s, lambda_v of one oscillator after the other:
///
///     s - s_k - h (R v)^                                                                       = 0
///     v - v_k - h R^^{-1} [ lambda_s^ a(t^, x^, x'^) - mu1 lambda_s^ - mu2 lambda_v^ ]         = 0
///     -s  with lambda_s in [-1, 1]  (lambda_s in sgn(s)),    -v  with lambda_v in [-1, 1]
///
/// where lambda^ = gamma lambda + (1 - gamma) lambda_k, R^ = 1 - kappa lambda_s^ lambda_v^, s and v are
/// weighted by theta: (R v)^ = R^ v^, x^ = theta lambda_s s + (1 - theta)|s_k|, x'^ = R^ v^ lambda_s^, and
/// t^ = t_k + theta h. Source: HO (12), (13), (23), corrected: `s_k + h`, `v_k + h` are missing there.
///
/// Where the acceleration drives an oscillator off its wall, a step has up to 5 solutions near s = 0, some of
/// them spurious. Taken is the first that exists of: sgn(s) as at t_k, the other sign, s = 0; likewise for v.
/// At rest, s_k = v_k = 0, the first is lambda_s = 1: nothing rests where the acceleration points away.
class ImpactDvi : public Dvi {
public:
  virtual Vec x() const = 0;         ///< positions [m]
  virtual Vec velocity() const = 0;  ///< [m/s]; right limits, as to_physical()
  virtual Vec s() const = 0;         ///< [m]
  virtual Vec v() const = 0;         ///< [m/s]
  virtual Vec lambda_s() const = 0;  ///< of the last step; at the start the signs of s and v
  virtual Vec lambda_v() const = 0;
  /// Impacts of the last step, impulse = the jump 2|v| of x' at the wall, and lift-offs from rest; level 2.
  virtual const std::vector<StepEvent>& events() const = 0;
  /// Replaces them, by who moves the process otherwise than in steps (hybrid.hpp).
  virtual void tell(std::vector<StepEvent> events) = 0;
  virtual double kinetic() const = 0;     ///< of this rank's oscillators [J]
  virtual double dissipated() const = 0;  ///< at their impacts so far [J]

  /// Goes on from (x, x') as if they were the start, as after reading a plant. @note Collective.
  virtual void set_physical(Vec x, Vec velocity) = 0;
};

/// @throws Error (bad_input) on every rank if kappa, theta, gamma or the start make no sense
/// @note Collective. `oscillators` must outlive the result.
std::unique_ptr<ImpactDvi> make_impact_dvi(const ImpactOscillators& oscillators, const TimeGrid& grid,
                                           const ImpactOptions& options = {});

}  // namespace sweepvi
