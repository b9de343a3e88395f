#pragma once

#include <optional>
#include <string>
#include <vector>

#include "io/file_order.hpp"
#include "io/scene.hpp"
#include "io/scene_rows.hpp"
#include "io/table_file.hpp"
#include "sweepvi/dvi.hpp"
#include "sweepvi/linear_system.hpp"
#include "sweepvi/relative_degree.hpp"
#include "sweepvi/time_march.hpp"

namespace sweepvi {

/// Writes the trajectory of a linear system: each `every`-th step, the first and the last, in scene order.
/// All calls are collective.
class Recorder {
public:
  /// Opens `path` and records the initial state.
  /// @throws Error (output) on every rank if the file cannot be made
  Recorder(const std::string& path, bool overwrite, const OutputSpec& output, const TimeSpec& time,
           const LinearSystem& system, const RelativeDegree& relative_degree, const ConstrainedDvi& dvi);

  /// Takes in a certified step, which took `seconds`; writes a row if one is due.
  void step(const Step& step, const StepReport& report, double seconds);

  TableFile& file() { return file_; }
  /// Writes the last step taken, if it is not there yet, and gives the file its name.
  void finish();

private:
  struct Layout;  // what goes where, found before the file is opened
  Recorder(Layout layout, const std::string& path, bool overwrite, const TimeSpec& time,
           const LinearSystem& system, const ConstrainedDvi& dvi);
  void write_row(double t);

  MPI_Comm comm_;
  const ConstrainedDvi& dvi_;
  SceneRows rows_;
  std::int64_t every_;
  std::int64_t last_step_;
  FileOrder states_;
  std::optional<FileOrder> outputs_;
  FileOrder constraints_;
  TableFile file_;

  std::optional<double> pending_;  // time of a step not yet written
  std::vector<double> mu_;         // sums since the last row
  double iterations_ = 0.0, seconds_ = 0.0, residual_ = 0.0;
  std::vector<double> column_, slice_;
};

}  // namespace sweepvi
