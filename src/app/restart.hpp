#pragma once

#include <map>
#include <memory>
#include <string>

#include "app/case.hpp"
#include "app/command_line.hpp"
#include "app/summary.hpp"
#include "io/recorder.hpp"

namespace sweepvi::app {

/// The earlier run that a run goes on from: a checkpoint or a stopped output file, see README.md, "Stopping
/// and going on". All methods are collective.
class Restart {
public:
  /// Reads what `--restart` names.
  /// @param scene  rank 0's: the fingerprint of the scene that goes on
  /// @throws Error (bad_input) on every rank: no checkpoint, damaged, or that of another scene
  Restart(MPI_Comm comm, const std::string& path, const std::map<std::string, std::string>& scene);

  std::int64_t steps_done() const { return steps_done_; }
  const std::string& started() const { return started_; }  ///< when the first run began
  /// Brings a freshly made process to where the run was.
  void put_state(Case& model) const;
  /// Brings what its march goes on from beside it (TimeMarch::visit_hybrid), once there is one.
  void put_state(Case& model, TimeMarch& march) const;
  /// Opens the rows of the earlier run. @throws Error (bad_input) if they are gone or too few
  void open_rows();
  /// Whether a run that writes `output` replaces nothing but what it goes on from.
  bool may_replace(const std::string& output) const;
  /// The recorder of the run that goes on, with the earlier rows.
  std::unique_ptr<Recorder> recorder(const std::string& output, bool force, const TimeSpec& time,
                                     std::int64_t every, const Dvi& dvi, Recording recording);
  /// Counts of the summary go on, too.
  void put_counts(Summary& summary) const;
  /// The earlier rows are in the new file, and a checkpoint says so: forgets the old ones if they were those
  /// of the same output.
  void release_rows(const std::string& output, Recorder& recorder);

private:
  MPI_Comm comm_;
  int rank_ = 0;
  std::string path_;
  CheckpointData data_;  // rank 0's
  bool stopped_file_ = false;
  std::int64_t steps_done_ = 0;
  std::string started_;
  std::unique_ptr<RowSource> rows_;
  bool beside_ = false;  // the new rows are not under their usual name yet
};

/// What a run leaves in order to be gone on with.
class Checkpointing {
public:
  /// @param output  the trajectory's file; its checkpoint is output + ".checkpoint"
  Checkpointing(MPI_Comm comm, const std::string& output, std::map<std::string, std::string> scene,
                std::string started);

  /// Collects what goes on from here; makes the rows durable.
  /// @throws Error (output) on every rank.  @note Collective.
  CheckpointData collect(Case& model, TimeMarch& march, Recorder& recorder, const Summary& summary) const;
  /// Takes room on the disk for a checkpoint of the size of this one, so that it can be written when the disk
  /// is full. @throws Error (output) on every rank.
  void reserve(const CheckpointData& data);
  /// @throws Error (output) on every rank.  @note Collective.
  void write(const CheckpointData& data);
  /// Removes the checkpoint of this output, if there is one. @throws Error (output) on every rank.
  void remove() const;
  const std::string& path() const { return file_.path(); }

private:
  MPI_Comm comm_;
  int rank_ = 0;
  CheckpointFile file_;  // rank 0 uses it
  std::map<std::string, std::string> scene_;
  std::string started_;
};

}  // namespace sweepvi::app
