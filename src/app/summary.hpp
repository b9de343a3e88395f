#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "app/notes.hpp"
#include "sweepvi/step_solver.hpp"
#include "sweepvi/time_march.hpp"

namespace sweepvi::app {

/// The numbers of `--summary`, gathered while a verb works. Names and meaning: README.md, "Summary".
struct Summary {
  ExitCode exit = ExitCode::done;
  std::string status = "done";
  std::int64_t steps = 0;
  double seconds_total = 0.0, seconds_setup = 0.0, seconds_stepping = 0.0;
  double matmult_seconds = 0.0;
  std::int64_t unknowns = 0, constraints = 0, jacobian_nonzeros = 0, edge_cut = 0;
  std::string snes_type, predictor;
  double mumps_flops = 0.0;
  std::int64_t snes_iterations = 0;
  std::int64_t predictor_hits = 0, active_changes = 0;
  StepSolver::Rungs rungs{};
  std::int64_t most_parts = 1;         ///< that a step was taken in
  std::vector<Note> notes;             ///< what is not as it was asked for
  std::optional<HybridCounts> hybrid;  ///< of the scheme hybrid
  double max_residual = 0.0, max_penetration = 0.0;
  std::optional<double> error_estimate;  ///< of `solve`: of u, over its largest entry
  std::vector<std::string> unused_options;
  std::int64_t earlier_factorizations = 0, earlier_linear_solves = 0;  ///< before a restart

  /// What a later run adds its own to, see go_on_from. @note Collective.
  std::pair<std::vector<std::int64_t>, std::vector<double>> to_go_on(MPI_Comm comm) const;
  static bool fits(const std::vector<std::int64_t>& counts, const std::vector<double>& measures);
  /// Counts, times and worst cases of an earlier run, before this one has any.
  void go_on_from(const std::vector<std::int64_t>& counts, const std::vector<double>& measures);

  /// Time of one MatMult with the step's Jacobian: the median of several, each the slowest rank's. @note
  /// Collective.
  void time_matmult(Mat jacobian);
  void count_jacobian(Mat jacobian);
  /// Which solver there is, before the first step. @note Collective.
  void describe(StepSolver& solver);
  /// Adds what only the process knows (peak memory, factorizations, linear solves) and writes the file on
  /// rank 0.
  /// @throws Error (output) on every rank.  @note Collective.
  void write(MPI_Comm comm, const std::optional<std::string>& path) const;
  std::string text(MPI_Comm comm) const;  ///< the JSON; collective
};

/// Linear systems solved by this process so far. @note Not collective.
std::int64_t linear_solves();

/// Matrices factored by this process so far. @note Not collective.
std::int64_t factorizations();

/// Largest peak of resident memory of any rank [B]. @note Collective.
std::int64_t peak_rss_bytes(MPI_Comm comm);

/// Puts rank 0's text into the file `path`, see write_output().
/// @throws Error (output) on every rank.  @note Collective.
void write_text(MPI_Comm comm, const std::string& path, const std::string& text);

/// @throws Error (output) on every rank if `path` exists and may not be replaced, or its folder cannot be
/// written.
/// @note Collective.
void check_writable(MPI_Comm comm, const std::string& path, bool overwrite);

/// Where an HDF5 file of this name goes: what links lead to, so that they stay.
/// @throws Error (output) on every rank if that is no regular file.  @note Collective.
std::string table_path(MPI_Comm comm, const std::string& path);

}  // namespace sweepvi::app
