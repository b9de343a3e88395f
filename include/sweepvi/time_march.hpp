#pragma once

#include <functional>
#include <memory>

#include "sweepvi/dvi.hpp"
#include "sweepvi/hybrid.hpp"
#include "sweepvi/step_solver.hpp"
#include "sweepvi/time_grid.hpp"

namespace sweepvi {

/// Marches a Dvi along a time grid.
///
/// The march is PETSc's TS of the type "sweepvi", registered here: monitors, views and logging work as for
/// any TS
/// (-ts_monitor, -ts_view, -snes_vi_monitor, -log_view, ...). One step: box rule, SNESVI, settle,
/// certificate, accept. TSTHETA would average multipliers and complementarity rows over the step; here they
/// stand at t_{k+1}.
///
/// A step that no attempt solves is taken in 2, 4, ... equal parts, where the scheme allows (Dvi::set_step)
/// and unless it is proved to have no solution; the steps after it are as long as before.
class TimeMarch {
public:
  /// Called after each accepted step, on every rank.
  using Observer = std::function<void(const Step&, const StepReport&)>;

  /// @param done  steps that `problem` has already taken, in an earlier run say (Dvi::visit)
  /// @throws Error (bad_input) if the options database asks for another TS type or a SNES that solves no box
  /// VI
  /// @note Collective on the problem's communicator. `problem` must outlive the march.
  TimeMarch(Dvi& problem, const TimeGrid& grid, PetscInt done = 0);
  /// By the hybrid scheme: a step of the march is an interval of the grid, at whose end the state is known.
  TimeMarch(HybridProcess& process, const HybridOptions& options, const TimeGrid& grid, PetscInt done = 0);
  ~TimeMarch();
  TimeMarch(const TimeMarch&) = delete;
  TimeMarch& operator=(const TimeMarch&) = delete;

  void observe(Observer observer);
  /// Called after each part but the last of a step that is taken in parts (Rung::smaller_step): for what is
  /// summed over a step. Its `Step` is the part, with the number of the whole step.
  void observe_parts(Observer observer);

  /// Called at each event of the hybrid scheme, with the state before it and then with that after it.
  void observe_events(Observer observer);
  /// What the hybrid scheme did; zeros in other marches.
  HybridCounts hybrid_counts() const;
  /// Its estimate of the error of x at the time reached (HybridCounts::error).
  double hybrid_error() const;
  /// Shows what the hybrid scheme goes on from, beside the Dvi; nothing in other marches. @note Collective.
  void visit_hybrid(StateVisitor& visitor);

  /// Takes one step. If it is not certified, the state stays that of t_k. @note Collective.
  StepReport step();

  /// Takes all remaining steps, or until one is not certified (then the last report is that step's) or until
  /// the observer calls `stop`. @note Collective.
  StepReport run();

  /// Makes `run` end after the present step. @note Every rank calls it in the same step.
  void stop();

  PetscInt steps_taken() const;
  const TimeGrid& grid() const;
  double time() const;  ///< time reached [s]
  StepSolver& solver() const;

  /// The VI of a step that was not certified. @note Collective.
  StepProblem problem();

private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace sweepvi
