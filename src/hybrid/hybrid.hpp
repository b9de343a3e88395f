#pragma once

#include <functional>

#include "hybrid/motion.hpp"
#include "sweepvi/hybrid.hpp"

namespace sweepvi {

/// The hybrid scheme over one interval after the other: Taylor series up to the next event, the event as a
/// step of length 0, and so on. Intervals only read: the series are the same whatever they are.
///
/// The error is estimated by a second motion, whose tolerance is a thousandth, and whose state is moved by
/// some roundings of what each component was summed from at each begin of a series: its distance from the
/// first one is what errors have grown to, through all events. It is compared in the middle of each series
/// and at each row, not within a millionth of a series of an event, where one of them may already have
/// jumped.
class Hybrid {
public:
  using Observer = std::function<void(const Step&)>;

  /// Both references must outlive the object. @note Collective, like all methods.
  Hybrid(HybridProcess& process, const HybridOptions& options);

  /// From the Dvi's state at the begin of an interval to that at its end. If a jump is not certified or the
  /// motion does not go on the report says so, and the state is somewhere in between.
  /// @param part   called after each part of the interval: measures and events are that part's
  /// @param event  called at each event with the state before it, and with that after it
  StepReport advance(const Step& interval, StepSolver& solver, const Observer& part, const Observer& event);

  const HybridCounts& counts() const { return counts_; }
  /// Estimate of the largest error of a component of x now.
  double error() const { return counts_.error; }

  void visit(StateVisitor& visitor);

private:
  void judge(double t, PetscInt interval);
  struct Distance {
    double largest = 0.0, relative = 0.0;
  };
  Distance apart(double t);
  static bool near_event(const Motion& motion, double t, double window);
  StepReport failed(const Motion& motion) const;

  HybridProcess& process_;
  Motion motion_, shadow_;
  HybridCounts counts_;
  StepSolver* solver_ = nullptr;
  StepReport report_;
  bool begun_ = false, lost_ = false;
  double judged_ = 0.0;  // series of motion_ that they have been compared in last
  double reached_ = 0.0;
  std::vector<double>
      size_;  // of each component: the largest that it, or what its derivative was summed from, has been
  Vector here_, there_;
};

}  // namespace sweepvi
