#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "hybrid/clock.hpp"
#include "hybrid/smooth_flow.hpp"
#include "sweepvi/hybrid.hpp"
#include "sweepvi/state_visitor.hpp"

namespace sweepvi {

/// The motion of a hybrid process from one series to the next: jump, contact, series, first event. Its steps
/// do not depend on who looks on, or when.
///
/// A flight between two impacts on which a constraint has moved less than a hundredth of the tolerance, of
/// the sizes of all its outputs, ends an accumulation: its outputs are put to 0 and it is in contact.
class Motion {
public:
  /// Who is told of events: of the state before one, of each jump, of the state after it.
  struct Watch {
    std::function<void()> before, jumped, after;
  };

  /// @param tolerance  a thousandth of it is left out of series, over the longest time they may cover [s]
  /// @param terms  of a series, at most
  /// @param perturbed  by that many roundings of what each component was summed from, at each begin of a
  /// series; by other signs each time
  Motion(HybridProcess& process, double tolerance, int terms, double perturbed, double longest);

  /// From the state of the Dvi at t.
  void start(double t);

  /// Jumps where it must, finds who is in contact and the next series. @param watch  may be null: the Dvi is
  /// then left as it was
  /// @return false if it failed; `failure` says why, `report` if a jump was not certified
  bool prepare(StepSolver& solver, PetscInt interval, const Watch* watch, HybridCounts& counts);
  /// To the end of the series; it has to be prepared again.
  void finish();

  bool ready() const { return ready_; }
  /// Where t is in the series, from its begin.
  double place_of(double t) const { return clock_.until(t); }
  double time() const { return clock_.high; }
  double length() const { return length_; }
  bool ends_in_event() const { return event_; }
  double last_event() const { return last_event_; }  ///< -infinity: there was none
  const SmoothFlow& flow() const { return flow_; }
  SmoothFlow& flow() { return flow_; }
  std::int64_t series() const { return series_; }

  /// What holds at `tau` of the series, or at its begin before it is ready; mu: since it was last asked for.
  /// @note Writes it into the Dvi.
  void write(double tau);
  Vec state() const { return x_.get(); }
  /// Measures have been told.
  void forget_measures();

  const StepReport& report() const { return report_; }
  const std::string& failure() const { return failure_; }

  /// All that it goes on from. @note Collective.
  void visit(StateVisitor& visitor, const std::string& prefix);

private:
  bool jump(StepSolver& solver, PetscInt interval, const Watch* watch, HybridCounts& counts);
  bool jump_at_once(const Watch* watch, HybridCounts& counts);
  bool push_out(std::vector<double>& pushes);
  bool close_flights(HybridCounts& counts, bool all);
  void measure_flights(double tau);
  void tell_changes(const std::vector<Side>& before);
  void begin_series();
  void perturb();
  void find_known();
  std::size_t constraints() const { return flow_.constraints(); }

  HybridProcess& process_;
  SmoothFlow flow_;
  double closing_, rate_, perturbed_, longest_;
  Clock clock_;
  Vector x_, row_;
  std::vector<Side> contact_;
  std::vector<double> mu_, end_w_;
  double told_ = 0.0;  // measures of the series up to here are in mu_
  bool ready_ = false, event_ = false, resumed_ = false;
  double tried_, held_ = 0.0;  // lengths: asked for, and over which the series holds
  double length_ = 0.0, last_event_ = -PETSC_INFINITY;
  std::int64_t series_ = 0;
  int crowd_ = 0;               // of series since
  double crowded_at_ = 0.0;     // this time
  std::vector<double> flight_;  // relative excursion since the constraint left its wall
  std::vector<double> sizes_;   // of outputs, so far
  std::vector<char> known_;
  std::vector<char> met_;  // whose impact of this instant has been told
  StepReport report_;
  std::string failure_;
  StateSnapshot aside_;
};

}  // namespace sweepvi
