#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "dvi/output_forcing.hpp"
#include "hybrid/contact_forces.hpp"
#include "sweepvi/linear_system.hpp"
#include "sweepvi/relative_degree.hpp"

namespace sweepvi {

/// Outputs of a state, and what they are known to: z = Z x + g(t), w = C x + D lambda + w0.
struct Outputs {
  std::vector<double> z;      ///< like the rows of Z, exactly at its wall what stands there
  std::vector<double> noise;  ///< below this an output is zero up to rounding
  std::vector<double> terms;  ///< |Z| |x| + |g|
};

/// Where a constraint stands at the begin of a series.
enum class Stand : char {
  away,     ///< from its walls
  out,      ///< beyond one, or on its way there: the state has to jump
  leaving,  ///< at a wall and on its way from there
  touching  ///< at a wall with all outputs 0; always with relative degree 0
};

/// The motion of a linear system between events, as a Taylor series
///
///     x(t + tau) = sum_k X_k tau^k,   (k+1) X_{k+1} = A X_k + B Lambda_k + f^(k)(t)/k!,
///     on constraints in contact M Lambda_k = -a_k,   a = w^(r) where lambda = 0,   elsewhere Lambda_k = 0,
///
/// from which w = C X_k and multipliers follow as polynomials, too: events are their roots. Terms are summed
/// until what is left out is below rounding of the largest one, for each component, each w and each
/// multiplier by itself; the length of a series is such that `most_terms` do. z is always computed from x.
///
/// What touches solves 0 <= a_0 + M Lambda_0 _|_ Lambda_0 >= 0; where both vanish the same for the next
/// derivative, and so on (mirrored at upper walls). What no derivative decides stays in contact. With
/// relative degree 0 w itself is a + M Lambda, contact is lambda > 0 (< 0 at an upper wall), and an event is
/// a change from lambda to w or back.
///
/// All methods are collective.
class SmoothFlow {
public:
  /// All must outlive the flow.
  /// @param offset  w = C x + w0 + offset(t), where all degrees are equal; may be null
  /// @param equations  constraints that are in contact for good, by multipliers of any sign; empty: none
  /// @param most_terms  of a series; about 28, and terms hardly grow before they fall over its length
  SmoothFlow(const LinearSystem& system, const RelativeDegree& degree, const Forcing* offset,
             std::vector<char> equations, int most_terms);

  /// Finds where the constraints stand. @param known  outputs that are at their wall (z_1) or 0, whatever x
  /// says
  /// @return whether some constraint is `out`
  bool place(double t, Vec x, const std::vector<char>& known);
  /// Moves x to where outputs that stand at walls, or are 0 there, are exactly so.
  void pull_in(Vec x);
  /// Who of those that touch stays in contact; the series begins at x. @param guess  who does, probably
  /// @return false if it could not be found
  bool choose(Vec x, const std::vector<Side>& guess);
  /// As `choose` left it for the same t and x, from what `visit` kept.
  void begin_again(double t, Vec x);

  /// Takes terms until they have converged over `length`, or over as much of it as `most_terms` do.
  /// @param rate  what may be left out in a second, of the largest term [1/s]; not less than rounding
  /// @return the length over which the series holds; none if it is not finite, or multipliers were not found
  std::optional<double> expand(double length, double rate);

  /// The first tau <= length at which a free constraint meets a wall or one in contact lets go.
  std::optional<double> first_event(double length);
  /// Outputs that are at their wall at the event found last.
  const std::vector<char>& meeting() const { return meeting_; }

  void state(double tau, Vec x) const;
  /// The state at tau, where the next series will begin.
  void traverse(double tau, Vec x);
  /// Of each component, the largest term on the way there, and what its derivative was a sum of: rounding is
  /// relative to that.
  const std::vector<double>& traversed() const { return traversed_; }
  /// What the derivative at the begin of the series is a sum of, |A| |x| + |f| + |B| |lambda|.
  Vec summed() const { return bound_.get(); }
  /// At time t + tau in the state x(tau).
  Outputs outputs(double tau, Vec x);
  /// Puts outputs of contacts exactly to their walls in x(tau).
  void hold(double tau, Vec x);
  std::vector<double> w(double tau, const Outputs& outputs) const;
  /// Adds the integrals of the multipliers from `from` to `to`.
  void add_measures(double from, double to, std::vector<double>& mu) const;
  /// Largest distance of a constraint from the wall it has left, over [0, tau].
  double excursion(std::size_t a, double tau) const;

  /// 0 <= z_1 + M y _|_ y >= 0 (mirrored at upper walls) on all constraints with outputs; moves x by y along
  /// level 1. For processes whose jumps leave positions as they are.
  bool push_out(double t, Vec x, std::vector<double>& pushes);

  const std::vector<Side>& contact() const { return contact_; }
  const std::vector<Stand>& stand() const { return stand_; }
  const Outputs& begin() const { return at_begin_; }
  Side wall(std::size_t a) const { return wall_[a]; }
  int terms() const { return known_; }
  std::size_t constraints() const { return contact_.size(); }
  int levels(std::size_t a) const { return degree_.degree[a]; }
  std::size_t at(std::size_t a, int level) const {
    return static_cast<std::size_t>(degree_.first_level[a]) + static_cast<std::size_t>(level - 1);
  }
  double upper(std::size_t a) const { return upper_[a]; }

  /// Shows what a series is begun again from: numbers of each state, of each constraint.
  using Show = std::function<void(const char* name, std::vector<double>& numbers)>;
  void visit(const Show& states, const Show& constraints);

private:
  bool next();
  void find_rate(int k);
  void find_acceleration(int k);
  bool decide(int k);
  bool find_multipliers(int k);
  bool refine_rate(int k);
  void move_to_walls(Vec x, const std::vector<int>& leading);
  void reset_terms(Vec x);
  void count_term(int k);
  void find_coupling();
  double left_out(double length) const;
  double longest(double length) const;
  bool forcing_negligible(double length, int k) const;
  void evaluate_forcing(double t);
  void find_outputs(double t, Vec x, Outputs& to);
  std::vector<double> distance(std::size_t a, Side wall) const;
  std::optional<double> event_of(std::size_t a, double length) const;

  int most_terms_;
  const LinearSystem& system_;
  const RelativeDegree& degree_;
  const Forcing* offset_;
  std::vector<char> equation_;
  OutputForcing forcing_;
  ContactForces forces_;
  Matrix last_rows_;    // rows (a, r_a) of Z, none where r_a = 0: m x n
  Matrix direct_rows_;  // rows of C where r_a = 0; empty: there are none
  Matrix abs_A_, abs_B_, abs_Z_, abs_last_, abs_direct_;
  std::vector<double> upper_;   // walls
  std::vector<double> moving_;  // bounds of what offset_ adds to outputs
  double fastest_ = 0.0;        // of the signals in f and offset [rad/s]

  double t_ = 0.0;
  std::vector<Stand> stand_;
  std::vector<Side> wall_;
  std::vector<int>
      leading_;  // coefficients of w that are exactly 0 (up to the wall); outputs, before `choose`
  std::vector<int> pull_leading_;  // of the multiplier
  std::vector<Side> contact_;
  std::vector<char> weightless_;  // in contact, and no derivative decided
  Outputs at_begin_;

  bool any_touching_ = false, any_at_wall_ = false, any_contact_ = false,
       any_direct_ = false;  // on some rank
  bool deciding_ = false;
  std::vector<char> tied_;
  std::vector<Side> guess_;
  std::vector<double> least_;                // of multipliers: below it they are 0
  std::vector<Vector> X_;                    // X_[k]
  std::vector<std::vector<double>> w_;       // [k][constraint]; r = 0: one less
  std::vector<std::vector<double>> lambda_;  // [k][constraint]
  int known_ = 0;                            // terms of X
  std::vector<double> a_, lambda_now_, rest_, small_;
  std::vector<double> scale_, w_scale_, lambda_scale_;
  std::vector<double> traversed_;
  double length_ = 0.0, rate_of_error_ = 0.0;
  int quiet_ = 0;
  std::vector<char> meeting_;
  Vector rate_, bound_, bound_next_, work_, outputs_, g_, w_now_, w_terms_;
};

}  // namespace sweepvi
