#include "io/recorder.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numeric>
#include <utility>

#include "io/rungs_field.hpp"
#include "parallel/gather.hpp"

namespace sweepvi {

namespace {

/// Fields that every run has, before those of its process.
enum Field : std::size_t { t, iterations, seconds, residual, active, rungs, first_quantity };

}  // namespace

Recorder::Column::Column(MPI_Comm comm, Quantity described)
    : quantity(std::move(described)),
      order(comm, quantity.positions, quantity.total),
      width(std::accumulate(quantity.extents.begin(), quantity.extents.end(), std::size_t{1},
                            [](std::size_t product, hsize_t extent) { return product * extent; })),
      mine(quantity.positions.size() * width, 0.0),
      slice(static_cast<std::size_t>(order.count()) * width) {}

FieldSpec Recorder::Column::field() const {
  FieldSpec spec{quantity.name,
                 quantity.type,
                 quantity.extents,
                 static_cast<hsize_t>(order.first()),
                 0,
                 quantity.units,
                 quantity.description,
                 quantity.names,
                 quantity.order};
  spec.extents.insert(spec.extents.begin(), static_cast<hsize_t>(quantity.total));
  spec.count = static_cast<hsize_t>(order.count());
  return spec;
}

std::vector<Recorder::Column> Recorder::make_columns(MPI_Comm comm, std::vector<Quantity> quantities) {
  std::vector<Column> columns;
  columns.reserve(quantities.size());
  for (Quantity& quantity : quantities)
    columns.emplace_back(comm, std::move(quantity));
  return columns;
}

std::vector<FieldSpec> Recorder::fields(MPI_Comm comm, const std::vector<Column>& columns, bool error) {
  const auto real = FieldSpec::Type::real;
  const auto integer = FieldSpec::Type::integer;
  std::vector<FieldSpec> specs = {
      {"/t", real, {}, 0, 0, "s", "time"},
      {"/solver/iterations",
       integer,
       {},
       0,
       0,
       "1",
       "Newton iterations since the last row; 2147483647: so many or more"},
      {"/solver/seconds", real, {}, 0, 0, "s", "wall time of the steps since the last row"},
      {"/solver/residual", real, {}, 0, 0, "1", "worst certificate ratio since the last row"},
      {"/solver/active", integer, {}, 0, 0, "1", "constraints in contact"},
      rungs_field(comm)};
  for (const Column& column : columns)
    specs.push_back(column.field());
  if (error)
    specs.push_back(
        {"/solver/error", real, {}, 0, 0, "1", "estimate of the largest error of a component of x"});
  return specs;
}

Recorder::Recorder(const std::string& path, bool overwrite, const TimeSpec& time, std::int64_t every,
                   const Dvi& dvi, Recording recording, const std::string& partial)
    : comm_(dvi.comm()),
      dvi_(dvi),
      recording_(std::move(recording)),
      every_(every),
      last_step_(time.steps),
      columns_(make_columns(comm_, std::move(recording_.quantities))),
      file_(comm_, path, fields(comm_, columns_, static_cast<bool>(recording_.error)),
            {.expected_rows = static_cast<hsize_t>(time.steps / every + 2),
             .overwrite = overwrite,
             .events = static_cast<bool>(recording_.events),
             .impulse_units = recording_.impulse_units,
             .partial = partial}) {
  if (recording_.elements)
    file_.list("/element", *recording_.elements, "1", "element numbers of the columns");
}

Recorder::Recorder(const std::string& path, bool overwrite, const TimeSpec& time, std::int64_t every,
                   const Dvi& dvi, Recording recording)
    : Recorder(path, overwrite, time, every, dvi, std::move(recording), std::string()) {
  write(make_row(time.start));
}

Recorder::Recorder(const std::string& path, bool overwrite, const TimeSpec& time, std::int64_t every,
                   const Dvi& dvi, Recording recording, const Resume& resume)
    : Recorder(path, overwrite, time, every, dvi, std::move(recording), resume.partial) {
  try {
    resume.rows.copy_into(file_);
    load(resume.data);
  } catch (const Error& error) {
    if (error.code() == ExitCode::bad_input) file_.discard();
    throw;
  }
}

// What has come since the last row: iterations, seconds, residual, rungs; and the time of the last step if it
// has no row.
void Recorder::save(CheckpointData& data) {
  std::vector<double>& since = data.numbers["since the last row"];
  since = {iterations_, seconds_, residual_};
  since.insert(since.end(), rungs_.begin(), rungs_.end());
  if (pending_) since.push_back(*pending_);
  for (const Column& column : columns_)
    if (column.quantity.summed)
      data.numbers["sum of " + column.quantity.name] = bring_together(
          comm_, {column.quantity.positions, column.quantity.total}, column.mine, column.width);
  data.put(file_.mark());
}

void Recorder::load(const CheckpointData& data) {
  int rank = 0;
  MPI_Comm_rank(comm_, &rank);
  const auto of = [&](const std::string& name, std::size_t least, std::size_t most) {
    std::vector<double> values;
    agreed(comm_, [&] {
      if (rank != 0) return;
      const auto at = data.numbers.find(name);
      if (at == data.numbers.end() || at->second.size() < least || at->second.size() > most)
        throw InputError("the checkpoint lacks '" + name + "'; it was written by another version");
      values = at->second;
    });
    return values;
  };
  std::vector<double> since = of("since the last row", 3 + rungs_.size(), 4 + rungs_.size());
  broadcast(comm_, since);
  iterations_ = since[0];
  seconds_ = since[1];
  residual_ = since[2];
  for (std::size_t k = 0; k < rungs_.size(); ++k)
    rungs_[k] = static_cast<std::int64_t>(since[3 + k]);
  if (since.size() > 3 + rungs_.size()) pending_ = since.back();
  for (Column& column : columns_) {
    if (!column.quantity.summed) continue;
    const std::size_t size = static_cast<std::size_t>(column.quantity.total) * column.width;
    deal_out(comm_, {column.quantity.positions, column.quantity.total},
             of("sum of " + column.quantity.name, size, size), column.width, column.mine);
  }
}

Recorder::UnderWay& Recorder::under_way() {
  if (under_way_) return *under_way_;
  UnderWay& now = under_way_.emplace(UnderWay{});  // clang 14 takes no emplace() of a nested class
  for (const Column& column : columns_)
    now.sums.push_back(column.quantity.summed ? column.mine : std::vector<double>());
  now.iterations = iterations_;
  now.seconds = seconds_;
  now.residual = residual_;
  now.rungs = rungs_;
  now.pending = pending_;
  return now;
}

void Recorder::part(const Step& part) {
  UnderWay& now = under_way();
  for (Column& column : columns_) {
    if (!column.quantity.summed) continue;
    work_.resize(column.mine.size());
    column.quantity.read(work_.data());
    std::transform(work_.begin(), work_.end(), column.mine.begin(), column.mine.begin(), std::plus<>());
  }
  if (!recording_.events) return;
  const std::vector<Event> events = recording_.events(part.t_new);
  now.events.insert(now.events.end(), events.begin(), events.end());
}

void Recorder::event(double t) {
  UnderWay& now = under_way();
  if (every_ == 1) now.rows.push_back(make_row(t));
}

void Recorder::abandon() {
  if (!under_way_) return;
  for (std::size_t k = 0; k < columns_.size(); ++k)
    if (columns_[k].quantity.summed) columns_[k].mine = under_way_->sums[k];
  iterations_ = under_way_->iterations;
  seconds_ = under_way_->seconds;
  residual_ = under_way_->residual;
  rungs_ = under_way_->rungs;
  pending_ = under_way_->pending;
  under_way_.reset();
}

void Recorder::step(const Step& step, const StepReport& report, double seconds) {
  part(step);
  for (const Row& row : under_way_->rows)
    write(row);
  for (const Event& event : under_way_->events)
    file_.add_event(event);
  under_way_.reset();
  iterations_ += report.iterations;
  seconds_ += seconds;
  residual_ = std::max(residual_, report.residual);
  ++rungs_[static_cast<std::size_t>(report.rung)];
  pending_ = step.t_new;
  if (step.number % every_ == 0 || step.number == last_step_) write(make_row(step.t_new));
}

void Recorder::collect(Column& column) {
  if (!column.quantity.summed) column.quantity.read(column.mine.data());
  column.order.bring(column.mine.data(), column.slice.data(), column.width);
  if (column.quantity.summed) std::fill(column.mine.begin(), column.mine.end(), 0.0);
}

// Takes what has come since the last row.
Recorder::Row Recorder::make_row(double t) {
  Row row;
  row.t = t;
  for (Column& column : columns_) {
    collect(column);
    row.slices.push_back(column.slice);
  }
  if (recording_.error) row.error = recording_.error();
  row.in_contact = dvi_.active();
  MPI_Allreduce(MPI_IN_PLACE, &row.in_contact, 1, MPI_INT64_T, MPI_SUM, comm_);
  row.iterations = std::exchange(iterations_, 0.0);
  row.seconds = std::exchange(seconds_, 0.0);
  row.residual = std::exchange(residual_, 0.0);
  row.rungs = std::exchange(rungs_, {});
  pending_.reset();
  return row;
}

void Recorder::write(const Row& row) {
  for (std::size_t k = 0; k < columns_.size(); ++k) {
    const std::vector<double>& slice = row.slices[k];
    const std::size_t field = Field::first_quantity + k;
    if (columns_[k].quantity.type == FieldSpec::Type::real)
      std::copy(slice.begin(), slice.end(), file_.real(field));
    else
      std::transform(slice.begin(), slice.end(), file_.integer(field),
                     [](double value) { return static_cast<std::int32_t>(std::lround(value)); });
  }
  file_.real(Field::t)[0] = row.t;
  // Rows may be far apart; the dataset has 32 bits.
  constexpr double most = std::numeric_limits<std::int32_t>::max();
  file_.integer(Field::iterations)[0] = static_cast<std::int32_t>(std::min(row.iterations, most));
  file_.real(Field::seconds)[0] = row.seconds;
  file_.real(Field::residual)[0] = row.residual;
  file_.integer(Field::active)[0] = static_cast<std::int32_t>(row.in_contact);
  for (std::size_t k = 0; k < file_.slice_size(Field::rungs); ++k)
    file_.integer(Field::rungs)[k] = static_cast<std::int32_t>(row.rungs[k]);
  if (recording_.error) file_.real(Field::first_quantity + columns_.size())[0] = row.error;
  file_.commit_row();
}

void Recorder::finish() {
  abandon();
  if (pending_) write(make_row(*pending_));
  file_.finish();
}

}  // namespace sweepvi
