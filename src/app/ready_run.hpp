#pragma once

#include <memory>
#include <optional>
#include <string>

#include "app/case.hpp"
#include "app/options.hpp"
#include "app/study_plan.hpp"
#include "io/recorded.hpp"
#include "sweepvi/time_march.hpp"

namespace sweepvi::app {

/// What one run gave.
struct RunResult {
  std::string failure;  ///< why there is nothing else; empty: it was done
  std::optional<Recorded> kept;
  double seconds = 0.0;          ///< of stepping, of the slowest rank, without what it takes to keep rows
  double matmult_seconds = 0.0;  ///< of one with the Jacobian of a step
  std::int64_t steps = 0;        ///< hybrid: Taylor series and time steps
  std::int64_t parted = 0;       ///< steps taken in parts
  std::int64_t linear_solves = 0, newton_iterations = 0;
};

/// A run of a study or a bench, ready to go. The solver options of its setting hold as long as it lives. All
/// methods are collective.
class ReadyRun {
public:
  /// @param line  of the study
  /// @throws Error (bad_input) on every rank, as the verb `run` would
  ReadyRun(MPI_Comm comm, const CommandLine& line, const StudyRun& run, OptionsRead& read);

  /// The first and the last time with the initial state: what there is to compare, before there is anything.
  Recorded outline() const;
  const TimeSpec& time() const { return scene_.time; }
  Case& model() { return *case_; }
  TimeMarch& march() { return *march_; }
  /// This rank's part of /x, and where each entry stands there.
  std::pair<std::vector<double>, std::vector<PetscInt>> states() const;

  /// Marches to the end, once.
  /// @param keep  whether the result has the trajectory
  RunResult go(bool keep);

private:
  MPI_Comm comm_;
  const CommandLine& line_;
  OptionsScope options_;
  Scene scene_;
  std::unique_ptr<Case> case_;
  std::unique_ptr<TimeMarch> march_;
};

}  // namespace sweepvi::app
