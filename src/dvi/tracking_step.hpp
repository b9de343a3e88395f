#pragma once

#include <Eigen/Core>
#include <optional>

#include "sweepvi/tracking.hpp"

namespace sweepvi {

/// Places in the unknowns of a TrackingDvi.
enum TrackingPlace { S, V, SREF, VREF, LS, LV, LSREF, LVREF, LES, LEV, tracking_size };

/// One step of the closed loop of plant, reference and control: the formulas of TrackingDvi, on plain
/// numbers.
class TrackingStep {
public:
  using Unknowns = Eigen::Matrix<double, tracking_size, 1>;
  using Jacobian = Eigen::Matrix<double, tracking_size, tracking_size>;

  TrackingStep(const TrackingProblem& problem, const TrackingOptions& options)
      : problem_(problem), options_(options) {}

  void begin(const Step& step, const Unknowns& start);

  Unknowns residual(const Unknowns& u) const;
  /// Sum of the absolute values of the terms of each row; that of an inclusion's row is what its s or v is
  /// made of.
  Unknowns terms(const Unknowns& u) const;
  Jacobian jacobian(const Unknowns& u) const;
  double control(const Unknowns& u) const;
  double control_bound(const Unknowns& u) const;
  /// False where a mass stays on its wall, s = v = 0, although the forces and the control take it off.
  bool admissible(const Unknowns& u) const;

  struct Solution {
    Unknowns u;
    bool exact;  ///< up to rounding; otherwise forces that depend on the motion have not been found yet
  };
  /// A solution, by branches; nothing if none was found.
  std::optional<Solution> solve() const;

private:
  /// A mass in the step: the weighted quantities that the rows share.
  struct Mass {
    double sign_s, sign_v;  // lambda^
    double R, v;            // R^, v^
    double force;
  };
  Mass mass(const Bouncer& bouncer, const Unknowns& u, int s, int lambda_s) const;
  Eigen::Vector4d force_gradient(const Bouncer& bouncer, const Mass& mass, const Unknowns& u, int s,
                                 int lambda_s) const;
  double weighted_x(const Unknowns& u, int s, int lambda_s) const;
  double weighted_sign(const Unknowns& u, int lambda) const;
  double follow(const Bouncer& bouncer, const Unknowns& u, int s, int lambda_s) const;
  double brake(const Unknowns& u) const;
  bool holds(const Unknowns& u) const;
  bool solve_reference(Unknowns& u) const;
  bool solve_plant(Unknowns& u) const;

  const TrackingProblem& problem_;
  const TrackingOptions& options_;
  double h_ = 0.0, t_ = 0.0;  // t_k + theta h
  Unknowns start_ = Unknowns::Zero();
};

}  // namespace sweepvi
