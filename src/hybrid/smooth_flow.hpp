#pragma once

#include <optional>
#include <vector>

#include "dvi/output_forcing.hpp"
#include "sweepvi/linear_system.hpp"
#include "sweepvi/relative_degree.hpp"

namespace sweepvi {

/// The motion of a linear system between events, as a Taylor series
///
///     x(t + tau) = sum_k X_k tau^k,   (k+1) X_{k+1} = A X_k + B Lambda_k + f^(k)(t)/k!,
///     on constraints in contact M Lambda_k = -a_k,   a = z_r' where lambda = 0,   elsewhere Lambda_k = 0,
///
/// from which outputs and multipliers follow as polynomials, too: events are their roots. Exponentials of A
/// truncated where they have converged, but for forcing and contact, too, and with dense output.
///
/// Which constraints that touch (all outputs 0) stay in contact is the solution of
/// 0 <= a_0 + M Lambda_0 _|_ Lambda_0 >= 0; where both vanish, of the same for the next derivative, and so on
/// (mirrored at upper walls). What no derivative decides stays in contact.
///
/// All methods are collective.
class SmoothFlow {
public:
  /// All must outlive the flow. @pre degrees >= 1
  /// @param offset  w = C x + w0 + offset(t), where all degrees are equal; may be null
  SmoothFlow(const LinearSystem& system, const RelativeDegree& degree, const Forcing* offset);

  /// Begins a series at t. @return false if it could not be found which constraints stay in contact.
  /// @param continues  the state is where the last series led, without an event: contact is as it was
  bool start(double t, Vec x, const std::vector<double>& z, bool continues);

  /// Takes terms until they have converged over `length`, or over as much of it as there are terms for: those
  /// of x, and those of multipliers and bounds, which may move while x does not.
  /// @param rate  error that is allowed in a second, relative to the size of x [1/s]
  /// @return the length over which the series holds; none if it could not be found
  std::optional<double> expand(double length, double rate);

  /// The first tau <= length at which a free constraint meets a wall or one in contact lets go; remembers
  /// which.
  std::optional<double> first_event(double length);

  /// x and z at tau; outputs in contact are 0, those that meet their wall at tau exactly on it. mu: integral
  /// of lambda up to tau.
  void evaluate(double tau, bool at_event, Vec x, std::vector<double>& z, std::vector<double>& mu);

  /// Moves x, at time t, to where the outputs of these contacts are 0.
  void put_in_contact(const std::vector<Side>& contact, double t, Vec x);

  const std::vector<Side>& contact() const { return contact_; }
  /// Whether a free constraint was at a wall when the series began.
  bool leaves(std::size_t a) const { return leading_[a] > 0; }
  int terms() const { return known_; }
  double size() const { return norms_[0]; }             ///< |x|
  double curvature() const { return 2.0 * norms_[2]; }  ///< |x''|

private:
  bool next();
  bool has_converged(double length, double rate) const;
  double negligible(const std::vector<double>& terms, double length, double rate) const;
  double convergent_length(const std::vector<double>& terms, std::size_t k, double length, double rate) const;
  void find_acceleration(int k);
  void find_terms(int k);
  bool decide(int k);
  bool solve_contact_problem();
  Matrix masked_markov(bool with_tied) const;
  bool find_multipliers();
  void project(Vec x, double t, bool at_event);
  void add_offset(double t);
  std::size_t constraints() const { return contact_.size(); }
  int levels(std::size_t a) const { return degree_.degree[a]; }
  std::size_t at(std::size_t a, int level) const {
    return static_cast<std::size_t>(degree_.first_level[a]) + static_cast<std::size_t>(level - 1);
  }
  Side wall_of(std::size_t a) const { return z_[at(a, 1)] == upper_[a] ? Side::upper : Side::lower; }
  std::vector<double> guard(std::size_t a, Side wall) const;
  std::optional<double> event_of(std::size_t a, double length) const;

  const LinearSystem& system_;
  const RelativeDegree& degree_;
  const Forcing* offset_;
  OutputForcing forcing_;
  Matrix last_rows_;  // rows (a, r_a) of Z: m x n
  Matrix abs_A_, abs_last_;
  Matrix contact_matrix_;     // M of those in contact, where it is coupled
  bool coupled_ = false;      // M is not diagonal
  bool any_contact_ = false;  // on some rank, or some constraint may be
  bool undecided_ = false;    // on some rank
  LinearSolver contact_solver_;
  std::vector<Side> factored_;
  std::vector<double> upper_;  // walls

  double t_ = 0.0;
  std::vector<Vector> X_;                    // X_[k]
  std::vector<std::vector<double>> w_;       // [k][constraint]
  std::vector<std::vector<double>> lambda_;  // [k][constraint]
  std::vector<double> norms_;                // |X_k|
  std::vector<double> pushes_;               // |B Lambda_{k-1}|/k: what contacts have in X_k
  std::vector<double> shifts_;               // |offset^(k)|/k!: what moving bounds have in w_k
  int known_ = 0;                            // terms of X
  std::vector<double> z_;                    // at t
  std::vector<Side> contact_;
  std::vector<char> tied_;       // touching, and no derivative has decided yet
  std::vector<double> leaving_;  // a + M Lambda
  std::vector<int> leading_;     // coefficients of w that are exactly 0 (up to the wall)
  std::vector<char> meets_;      // of the last event
  Vector rate_, a_, lambda_now_, terms_, outputs_, g_, work_, w_now_;
};

}  // namespace sweepvi
