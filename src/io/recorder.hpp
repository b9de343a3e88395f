#pragma once

#include <optional>
#include <string>
#include <vector>

#include "io/checkpoint.hpp"
#include "io/dealt.hpp"
#include "io/file_order.hpp"
#include "io/recording.hpp"
#include "io/row_source.hpp"
#include "io/scene.hpp"
#include "sweepvi/dvi.hpp"
#include "sweepvi/step_solver.hpp"

namespace sweepvi {

/// Writes a trajectory: each `every`-th step, the first and the last. All calls are collective.
class Recorder {
public:
  /// Opens `path` and records the initial state.
  /// @throws Error (output) on every rank if the file cannot be made
  Recorder(const std::string& path, bool overwrite, const TimeSpec& time, std::int64_t every, const Dvi& dvi,
           Recording recording);

  /// Goes on in a new file: first the rows of an earlier one, then those of the steps to come.
  /// @param partial  as TableOptions::partial
  /// @param data     rank 0's counts
  /// @throws Error (output), as above; Error (bad_input) if the earlier rows are not what was marked
  struct Resume {
    RowSource& rows;
    const CheckpointData& data;
    std::string partial;
  };
  Recorder(const std::string& path, bool overwrite, const TimeSpec& time, std::int64_t every, const Dvi& dvi,
           Recording recording, const Resume& resume);

  /// Puts what is not in the file yet into a checkpoint, and where the rows are that are.
  void save(CheckpointData& data);

  /// Takes in a certified step, which took `seconds`; writes a row if one is due.
  void step(const Step& step, const StepReport& report, double seconds);

  /// Takes in a part of a step, but the last: what is summed, and events. It counts once the step is taken
  /// in.
  void part(const Step& part);

  /// Takes a row for a moment within a step, unless rows are left out (`every`); likewise.
  void event(double t);

  /// Forgets parts and rows since the last step: it will not be taken.
  void abandon();

  TableFile& file() { return file_; }
  /// Writes the last step taken, if it is not there yet, and gives the file its name.
  void finish();

private:
  /// A quantity on its way into the file.
  struct Column {
    Quantity quantity;
    FileOrder order;
    std::size_t width;          // numbers in an entry
    std::vector<double> mine;   // this rank's entries; sums of them, where they are summed
    std::vector<double> slice;  // this rank's part of a row in the file
    Column(MPI_Comm comm, Quantity described);
    FieldSpec field() const;
  };
  Recorder(const std::string& path, bool overwrite, const TimeSpec& time, std::int64_t every, const Dvi& dvi,
           Recording recording, const std::string& partial);
  /// A row, before it is in the file: what each quantity is, on this rank.
  struct Row {
    double t = 0.0;
    std::vector<std::vector<double>> slices;
    double iterations = 0.0, seconds = 0.0, residual = 0.0, error = 0.0;
    std::int64_t in_contact = 0;
    StepSolver::Rungs rungs{};
  };
  /// What a step that is under way has added so far, and what there was before it.
  struct UnderWay {
    std::vector<Row> rows;
    std::vector<Event> events;
    std::vector<std::vector<double>> sums;
    double iterations = 0.0, seconds = 0.0, residual = 0.0;
    StepSolver::Rungs rungs{};
    std::optional<double> pending;
  };

  void load(const CheckpointData& data);
  UnderWay& under_way();
  static std::vector<Column> make_columns(MPI_Comm comm, std::vector<Quantity> quantities);
  static std::vector<FieldSpec> fields(MPI_Comm comm, const std::vector<Column>& columns, bool error);
  Row make_row(double t);
  void collect(Column& column);
  void write(const Row& row);

  MPI_Comm comm_;
  const Dvi& dvi_;
  Recording recording_;  // its quantities are in columns_
  std::int64_t every_;
  std::int64_t last_step_;
  std::vector<Column> columns_;
  TableFile file_;

  std::optional<UnderWay> under_way_;
  std::optional<double> pending_;  // time of a step not yet written
  double iterations_ = 0.0, seconds_ = 0.0, residual_ = 0.0;
  StepSolver::Rungs rungs_{};
  std::vector<double> work_;
};

}  // namespace sweepvi
