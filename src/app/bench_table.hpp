#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "app/study_plan.hpp"
#include "sweepvi/step_solver.hpp"

namespace sweepvi::app {

/// A setting of a bench and what its steps took. Times are of all rounds; counts are of the timed steps of
/// the first, as all rounds take the same steps.
struct BenchRow {
  Setting setting;
  std::string failure;    ///< why there is nothing else; empty: its steps were certified
  bool stopped = false;   ///< by --wall-limit
  bool certified = true;  ///< its tolerance is one that certifies
  std::string form, snes_type, predictor;
  std::int64_t unknowns = 0, constraints = 0, jacobian_nonzeros = 0, edge_cut = 0;
  double h = 0.0;                              ///< [s]
  std::vector<double> seconds;                 ///< of each timed step, of the slowest rank
  std::vector<double> setup, warmup, matmult;  ///< of each round [s]
  std::vector<std::int64_t> changes;           ///< per step: constraints that opened or closed
  std::int64_t linear_solves = 0, factorizations = 0, newton_iterations = 0, predictor_hits = 0;
  double mumps_flops = 0.0;  ///< of the last factorization
  double contacts = 0.0;     ///< closed constraints, mean over the steps
  StepSolver::Rungs rungs{};
  double worst_ratio = 0.0, penetration = 0.0;
  std::int64_t peak_rss_bytes = 0;   ///< largest of the ranks
  double bytes_per_unknown = 0.0;    ///< of all ranks, without what the program had before the scene
  std::optional<double> difference;  ///< of the last states from those of the first setting, over the largest

  std::size_t steps() const { return changes.size(); }
  bool done() const { return failure.empty() && !seconds.empty(); }
};

/// A quantity per line, a setting per column.
std::string table_text(const std::vector<BenchRow>& rows);
/// One JSON object.
std::string row_json(const BenchRow& row);

}  // namespace sweepvi::app
