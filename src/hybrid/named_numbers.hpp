#pragma once

#include <functional>
#include <map>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "sweepvi/dvi.hpp"
#include "sweepvi/state_visitor.hpp"
#include "sweepvi/step_solver.hpp"

namespace sweepvi {

/// Takes or replaces those numbers of a process's state that it has a name for, and leaves the others.
class NamedNumbers final : public StateVisitor {
public:
  using Action = std::function<void(std::span<double>)>;
  NamedNumbers(bool replaces, std::map<std::string, Action> actions)
      : replaces_(replaces), actions_(std::move(actions)) {}
  using StateVisitor::visit;
  bool replaces() const override { return replaces_; }
  void visit(const char* name, Belongs, std::span<double> values, std::size_t) override {
    const auto action = actions_.find(name);
    if (action != actions_.end()) action->second(values);
  }

private:
  bool replaces_;
  std::map<std::string, Action> actions_;
};

/// Solves a step of length 0 and takes it. Of its events only impacts by measures are told: who has come to
/// a wall without one, or left, is seen when all jumps of an instant are over.
template <class TellingDvi>
StepReport jump_of(TellingDvi& dvi, StepSolver& solver, const Step& step) {
  StepReport report = solver.solve(step);
  if (!report.certified) return report;
  dvi.accept(solver.solution(), solver.residual());
  std::vector<StepEvent> impacts = dvi.events();
  std::erase_if(impacts, [](const StepEvent& event) { return !event.impact || event.impulse == 0.0; });
  dvi.tell(std::move(impacts));
  return report;
}

}  // namespace sweepvi
