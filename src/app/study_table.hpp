#pragma once

#include <optional>
#include <string>
#include <vector>

#include "app/comparison.hpp"
#include "app/study_plan.hpp"

namespace sweepvi::app {

/// A run of a study and what came of it.
struct StudyRow {
  StudyRun run;
  double h = 0.0;                                      ///< of the run [s]
  std::optional<double> tolerance;                     ///< of hybrid
  std::string failure;                                 ///< why all below is missing; empty: it was done
  Comparison found;                                    ///< against the reference
  std::optional<double> final_order, hausdorff_order;  ///< from the row before to this one
  double seconds = 0.0, seconds_min = 0.0, seconds_max = 0.0;  ///< of stepping; median over the repeats
  double matmults_per_step = 0.0;
  bool certified = true;                       ///< its tolerance is one that certifies
  std::int64_t steps = 0, steps_in_parts = 0;  ///< in parts: their scheme is that of smaller steps
  std::int64_t linear_solves = 0, newton_iterations = 0;
};

/// Fills in the orders of rows that differ from the one before them in nothing but the step.
void find_orders(std::vector<StudyRow>& rows);

/// In aligned columns, a line for each row.
std::string table_text(const std::vector<StudyRow>& rows, bool several_settings);
/// With a line of names; numbers to all digits; absent ones are empty.
std::string csv_text(const std::vector<StudyRow>& rows);
/// A JSON array of objects.
std::string rows_json(const std::vector<StudyRow>& rows);

}  // namespace sweepvi::app
