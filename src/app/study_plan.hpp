#pragma once

#include <mpi.h>

#include <optional>
#include <string>
#include <vector>

#include "app/command_line.hpp"

namespace sweepvi::app {

/// Scene keys and solver options to be compared with others.
struct Setting {
  std::string name;
  std::string options;               ///< as on a command line
  Overrides overrides;               ///< of the scene
  std::vector<std::string> schemes;  ///< it is run with; empty: all

  /// All of it, as on a command line.
  std::string words() const;
};

/// One of the runs of a study, or of a bench.
struct StudyRun {
  std::string scheme;               ///< empty: the scene's
  double step = 0.0;                ///< as asked for [s]; 0: the scene's
  std::optional<double> tolerance;  ///< of hybrid; none: the scene's
  Setting setting;
};

/// What is run, in order: schemes, in each of them settings, in each of them steps or tolerances.
struct StudyPlan {
  std::string scheme;   ///< the scene's own
  double finest = 0.0;  ///< of the steps [s]
  bool several_settings = false;
  std::vector<StudyRun> runs;
};

/// `line` as it would be for one of the runs alone.
CommandLine line_of(const CommandLine& line, const StudyRun& run);

/// The [[setting]] tables of a file.
/// @throws Error (bad_input) on every rank.  @note Collective.
std::vector<Setting> read_settings(MPI_Comm comm, const std::string& path);

/// Whether a setting is to be run with a scheme.
bool fits(const Setting& setting, const std::string& scheme);

/// @throws Error (bad_input) on every rank: a scene or settings that cannot be read, tolerances without
/// hybrid
/// @note Collective.
StudyPlan make_plan(MPI_Comm comm, const CommandLine& line);

}  // namespace sweepvi::app
