#pragma once

#include <array>
#include <functional>
#include <memory>

#include "sweepvi/dvi.hpp"
#include "sweepvi/regulator.hpp"
#include "sweepvi/signal.hpp"

namespace sweepvi {

/// A force per unit mass [m/s^2], of time or of time and motion: f(t, x, x').
class ForceLaw {
public:
  using Function = std::function<double(double t, double x, double velocity)>;

  ForceLaw(const Signal& signal)
      : function_([signal](double t, double, double) { return signal.value(t); }), of_time_(true) {}
  ForceLaw(Function function) : function_(std::move(function)), of_time_(false) {}

  double operator()(double t, double x, double velocity) const { return function_(t, x, velocity); }
  bool of_time() const { return of_time_; }

private:
  Function function_;
  bool of_time_;
};

/// A mass above a wall x = 0 that returns (1 - kappa)/(1 + kappa) of the velocity, HO (1).
struct Bouncer {
  double kappa = 0.0;      ///< in (0, 1)
  double x0 = 0.0;         ///< >= 0 [m]
  double velocity0 = 0.0;  ///< [m/s]
  ForceLaw force = Signal{};
};

/// A plant that is to move as a reference does, HO (4)-(8): twisting control of the errors in the coordinates
/// (s, v) of Zhuravlev and Ivanov, where impacts are no jumps.
struct TrackingProblem {
  Bouncer plant, reference;
  Regulator gains;  ///< of the errors
};

struct TrackingOptions {
  double theta = 1.0;     ///< (0, 1], weight of t_{k+1} in the states
  double gamma = 1.0;     ///< (0, 1], weight of t_{k+1} in the signs
  bool resample = false;  ///< before each step to (x, x') and back, as a controller that reads a plant does
};

/// Whether the gains make the errors vanish in finite time where both stay off the wall: HO's condition with
/// the bound 0, because the control takes the forces out.
inline bool tracking_gains_suffice(const Regulator& gains) {
  return gains_suffice(gains, 0.0);
}

/// Where plant and reference are, and what the controller did in the last step.
struct TrackingState {
  double s = 0.0, s_ref = 0.0;  ///< [m]
  double v = 0.0, v_ref = 0.0;  ///< [m/s]
  double x = 0.0, x_ref = 0.0;  ///< |s| [m]
  /// R v sgn(s) [m/s]; on the wall the velocity after the impact, (1 - kappa)|v|
  double velocity = 0.0, velocity_ref = 0.0;
  /// Signs of s, v, s_ref, v_ref, s - s_ref, v - v_ref in the last step; at the start those of the data
  std::array<double, 6> lambda{};
  double control = 0.0;        ///< u of the last step [m/s^2]; 0 at the start
  double control_bound = 0.0;  ///< no |u| of that step could be larger
};

/// The tracking problem as a Dvi. Its 10 unknowns are u = (s, v, s_ref, v_ref, then the signs lambda of s, v,
/// s_ref, v_ref, e_s = s - s_ref, e_v = v - v_ref), all on rank 0. With R = 1 - kappa lambda_s lambda_v and
/// g = R_ref^{-1} lambda_sref F_ref:
///
///     s - s_k - h R v                                                                                    = 0
///     v - v_k - h [lambda_s^2 (-mu1 lambda_es - mu2 lambda_ev + g) + R^{-1} lambda_s (1 - lambda_s^2) F] = 0
///     s_ref - s_ref,k - h R_ref v_ref = 0,       v_ref - v_ref,k - h g                                   = 0
///     -s, -v, -s_ref, -v_ref, -e_s, -e_v     with their lambda in [-1, 1]
///
/// and the control u = R lambda_s [-mu1 lambda_es - mu2 lambda_ev + g] - lambda_s^2 F, which this inserts
/// into v' = R^{-1} lambda_s (u + F). Products and R take lambda^ = gamma lambda + (1 - gamma) lambda_k, the
/// right sides v^ = theta v + (1 - theta) v_k; forces stand at t_k + theta h, x^ = theta lambda_s s + (1 -
/// theta) |s_k|, x'^ = R v^ lambda_s^; the inclusions at t_{k+1}. Source: HO (14)-(20), (24)-(29), whose
/// (15), (17), (20), (25), (26) are misprinted.
///
/// A step may have many solutions: families of them when s = s_ref = 0 at its end (only lambda_s, lambda_sref
/// and the errors' signs have to fit together), and spurious ones, a mass that sticks to the wall against the
/// forces. Taken is
/// - for the reference, which knows nothing of the plant: the first that exists of sgn(s_ref) as it was, the
/// other
///   sign, s_ref = 0; likewise for v_ref; from rest the first is +1;
/// - for the plant: the smallest errors, that is e_s = 0 and e_v = 0 if possible, then e_s = 0, then e_v = 0;
/// then
///   the sign of s (v) as it was or, from 0, the reference's;
/// - of a family the member near the reference's signs and lambda_es = lambda_ev = 0: at rest beside the
///   reference u = 0, and the wall carries the plant;
/// - never s = v = 0 under a positive acceleration, F + u > 0 or F_ref > 0.
///
/// (x, x') does not say which of (s, v) and (-s, -v) is meant. `resample` takes s >= 0 for the plant, as HO
/// IV does, and turns the reference and all signs over with it: the whole closed loop is invariant under that
/// (HO Remark 1), while turning over the plant alone would change the errors, and with them the control,
/// whenever one of the two has bounced once more than the other. Hence both modes give the same motion.
class TrackingDvi : public Dvi {
public:
  /// After the last accepted step. On rank 0; elsewhere zeros. @note Not collective.
  virtual const TrackingState& tracked() const = 0;
  /// Impacts of the last step, on rank 0: constraint 0 is the plant's, 1 the reference's wall, impulse the
  /// jump of x', level 2. @note Not collective.
  virtual const std::vector<StepEvent>& events() const = 0;
};

/// @throws Error (bad_input) on every rank if kappa, theta, gamma, gains or the start make no sense
/// @note Collective on `comm`. Every rank gives the same problem; forces are asked for on rank 0 only.
std::unique_ptr<TrackingDvi> make_tracking_dvi(MPI_Comm comm, const TrackingProblem& problem,
                                               const TrackingOptions& options = {});

}  // namespace sweepvi
