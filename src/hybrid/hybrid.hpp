#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "hybrid/smooth_flow.hpp"
#include "sweepvi/hybrid.hpp"

namespace sweepvi {

/// The hybrid scheme over one interval after the other: Taylor series up to the next event, the event as a
/// step of length 0, and so on. Where events accumulate, or there are too many of them, it takes steps of the
/// Dvi's own scheme until the contacts are at rest.
class Hybrid {
public:
  using Observer = std::function<void(const Step&)>;

  /// @param h  for which the Dvi is made
  /// Both references must outlive the object. @note Collective, like all methods.
  Hybrid(HybridProcess& process, const HybridOptions& options, double h);

  /// From the Dvi's state at the begin of an interval to that at its end. If a step is not certified the
  /// report is that step's, and the state is the one before it.
  /// @param part   called after each part of the interval: measures and events are that part's
  /// @param event  called at each event with the state before it, and with that after it
  StepReport advance(const Step& interval, StepSolver& solver, const Observer& part, const Observer& event);

  const HybridCounts& counts() const { return counts_; }

private:
  bool heads_out() const;
  bool end_flights();
  bool add(const StepReport& report);
  bool jump(const Step& now);
  void tell_changes(const Step& now, const std::vector<Side>& before, bool jumped);
  double accumulating() const;
  bool move(const Step& interval);
  bool time_step(const Step& interval, double h, bool until_rest);
  bool take(const Step& step, bool last);
  void rest(const std::vector<Side>& contact);
  void put();
  std::size_t constraints() const { return upper_.size(); }
  std::size_t at(std::size_t a, int level) const {
    return static_cast<std::size_t>(process_.degree().first_level[a]) + static_cast<std::size_t>(level - 1);
  }
  Side wall_at(std::size_t a) const;

  HybridProcess& process_;
  HybridOptions options_;
  HybridCounts counts_;
  std::optional<SmoothFlow> flow_;  // none where a degree is 0
  double h_;                        // of the Dvi
  std::vector<double> upper_;

  // Of the interval under way.
  StepSolver* solver_ = nullptr;
  const Observer* part_ = nullptr;
  const Observer* event_ = nullptr;
  StepReport report_;
  double t_ = 0.0;
  Vector x_;
  std::vector<double> z_, mu_;
  std::vector<Side> contact_;
  bool continues_ = false;                    // nothing has happened since the last series
  double reached_ = 0.0;                      // where the last interval ended
  std::vector<std::vector<double>> impacts_;  // of each constraint: when
  std::int64_t events_ = 0;
  int unseen_ = 0;  // events since the clock last moved
};

}  // namespace sweepvi
