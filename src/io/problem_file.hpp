#pragma once

#include <string>

#include "sweepvi/step_solver.hpp"

namespace sweepvi {

/// Where the problem of a step goes that an output file ends before: "run.h5" -> "run.problem.toml", which
/// says what the numbers mean, and "run.problem.h5", which has them.
struct ProblemPaths {
  explicit ProblemPaths(const std::string& output);
  std::string toml, numbers;
};

/// Writes a step's VI for `sweepvi solve`, replacing what is there. The files appear only complete. M is in
/// compressed rows; unknowns stand in the solver's order, which depends on the number of ranks.
/// @param head  for the top of the file: which step this is
/// @return empty, or why there are no files: a step that failed is not worth a second failure. Valid on rank
/// 0.
/// @note Collective. Rank 0 holds the whole problem meanwhile.
std::string write_problem(MPI_Comm comm, const ProblemPaths& paths, const StepProblem& problem,
                          const std::string& head);

}  // namespace sweepvi
