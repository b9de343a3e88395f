#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "io/scene.hpp"

namespace sweepvi::app {

enum class Verb { run, check, solve, compare, study, bench, info, help };

/// The command line, split: ours on one side, PETSc's words on the other.
struct CommandLine {
  Verb verb = Verb::help;
  std::optional<Verb> help_topic;  ///< `help run`, or `run --help`
  bool help_requested = false;     ///< -h, --help, -help (with a scene: also the options of its objects)
  std::string scene;               ///< SCENE or PROBLEM, A.h5 of compare
  std::string other;               ///< B.h5 of compare
  std::vector<std::int64_t> components;  ///< --components, ascending; empty: all
  std::optional<double> tolerance;       ///< --tolerance [t, x]
  std::optional<std::string> output;     ///< -o
  std::optional<std::string> summary;    ///< --summary
  std::optional<std::string> restart;    ///< --restart
  std::optional<double> wall_limit;      ///< --wall-limit [s]
  std::optional<std::string> progress;   ///< --progress
  std::optional<std::string> confine;    ///< --confine
  bool force = false;                    ///< --force
  std::vector<double> steps;             ///< --steps [s], of study
  std::vector<double> tolerances;        ///< --tolerances, of hybrid
  std::vector<std::string> schemes;      ///< --schemes
  std::optional<std::string> settings;   ///< --settings
  std::optional<std::string> reference;  ///< --reference: a file, or a number
  std::optional<std::string> csv;        ///< --csv
  std::optional<int> repeats;            ///< --repeats
  std::optional<int> warmup, count;      ///< --warmup, --count, of bench
  Overrides overrides;                   ///< --set, in order; -ts_dt, -ts_max_time, -ts_theta_theta folded in
  std::vector<std::string> petsc_words;  ///< everything else, in order, program name excluded
};

/// Pure text work: no file is opened, MPI and PETSc need not be initialised.
/// @throws Error (bad_input): unknown verb or word (with the nearest known), missing or contradicting values,
/// a foreign -ts_type.
CommandLine parse_command_line(const std::vector<std::string>& words);

/// The text of `sweepvi help [VERB]`.
std::string help_text(std::optional<Verb> topic);

}  // namespace sweepvi::app
