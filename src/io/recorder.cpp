#include "io/recorder.hpp"

#include <algorithm>
#include <numeric>

#include "parallel/gather.hpp"

namespace sweepvi {

namespace {

enum Field : std::size_t { t, x, w, mu, level, iterations, seconds, residual, active, z };

/// Position in the file of what is recorded of the elements, -1 elsewhere.
class Selection {
public:
  /// @param states  of one element
  Selection(const std::optional<std::vector<std::int64_t>>& blocks, PetscInt count, PetscInt states,
            StateLayout layout)
      : blocks_(blocks), count_(count), states_(states), layout_(layout) {}

  /// Elements recorded.
  PetscInt kept() const { return blocks_ ? static_cast<PetscInt>(blocks_->size()) : count_; }

  PetscInt element(PetscInt number) const {
    if (!blocks_) return number;
    const auto at = std::lower_bound(blocks_->begin(), blocks_->end(), number);
    return at == blocks_->end() || *at != number ? -1 : static_cast<PetscInt>(at - blocks_->begin());
  }

  /// @param number  of the state in the scene
  PetscInt state(PetscInt number) const {
    const bool whole = layout_ == StateLayout::element_by_element;
    const PetscInt kept_element = element(whole ? number / states_ : number % count_);
    if (kept_element < 0) return -1;
    return whole ? states_ * kept_element + number % states_ : kept() * (number / count_) + kept_element;
  }

private:
  const std::optional<std::vector<std::int64_t>>& blocks_;
  PetscInt count_, states_;
  StateLayout layout_;
};

template <class Position>
std::vector<PetscInt> positions(const std::vector<PetscInt>& scene_numbers, Position&& position) {
  std::vector<PetscInt> result;
  result.reserve(scene_numbers.size());
  for (const PetscInt number : scene_numbers)
    result.push_back(position(number));
  return result;
}

const char* text_of(StateLayout layout) {
  return layout == StateLayout::element_by_element ? "element by element" : "state by state";
}

}  // namespace

struct Recorder::Layout {
  const OutputSpec& output;
  SceneRows rows;
  FileOrder states;
  std::optional<FileOrder> outputs;
  FileOrder constraints;
  PetscInt recorded_states, recorded_outputs, recorded_constraints;
  std::vector<std::string> output_names;

  static Layout find(const OutputSpec& output, const LinearSystem& system, SceneRows rows,
                     const ConstrainedDvi& dvi) {
    const MPI_Comm comm = system.comm();
    const auto per_block = static_cast<PetscInt>(std::max<std::size_t>(1, system.state_names.size()));
    const Selection selection(output.blocks, system.states() / per_block, per_block, system.layout);
    const auto state = [&](PetscInt number) { return selection.state(number); };
    const auto element = [&](PetscInt number) { return selection.element(number); };
    const PetscInt states = per_block * selection.kept();
    const PetscInt constraints = output.blocks ? selection.kept() : system.scene_constraints();

    // Outputs stand constraint by constraint in scene order; degrees may differ.
    int has_outputs = dvi.z().empty() ? 0 : 1;
    MPI_Allreduce(MPI_IN_PLACE, &has_outputs, 1, MPI_INT, MPI_LOR, comm);
    std::vector<int> degrees = gather(comm, rows.degrees());
    std::vector<PetscInt> numbers = gather(comm, rows.numbers());
    broadcast(comm, degrees);
    broadcast(comm, numbers);
    std::vector<PetscInt> width(numbers.size(), 0);  // in the file
    std::vector<PetscInt> degree_of(numbers.size(), 0);
    for (std::size_t k = 0; k < numbers.size(); ++k) {
      degree_of[static_cast<std::size_t>(numbers[k])] = degrees[k];
      if (element(numbers[k]) >= 0) width[static_cast<std::size_t>(numbers[k])] = degrees[k];
    }
    std::vector<PetscInt> first(width.size() + 1, 0);
    std::partial_sum(width.begin(), width.end(), first.begin() + 1);
    std::vector<PetscInt> output_positions;
    for (const PetscInt number : rows.numbers()) {
      const auto at = static_cast<std::size_t>(number);
      for (PetscInt i = first[at]; i < first[at] + degree_of[at]; ++i)
        output_positions.push_back(width[at] > 0 ? i : -1);
    }

    FileOrder constraint_order(comm, positions(rows.numbers(), element), constraints);
    Layout layout{.output = output,
                  .rows = std::move(rows),
                  .states = FileOrder(comm, positions(system.state_order, state), states),
                  .outputs = std::nullopt,
                  .constraints = std::move(constraint_order),
                  .recorded_states = states,
                  .recorded_outputs = first.back(),
                  .recorded_constraints = constraints,
                  .output_names = {}};
    if (has_outputs != 0) layout.outputs.emplace(comm, output_positions, first.back());
    const bool uniform =
        std::all_of(degree_of.begin(), degree_of.end(), [&](PetscInt r) { return r == degree_of.front(); });
    for (std::size_t a = 0; a < (uniform ? 1 : width.size()); ++a)
      for (PetscInt i = 1; i <= (uniform ? degree_of.front() : width[a]); ++i)
        layout.output_names.push_back("z" + std::to_string(i) + (uniform ? "" : " of " + std::to_string(a)));
    return layout;
  }

  std::vector<FieldSpec> fields(const LinearSystem& system, int mu_levels) const {
    const auto slice = [](const FileOrder& order, PetscInt total, FieldSpec spec) {
      spec.extents.insert(spec.extents.begin(), static_cast<hsize_t>(total));
      spec.first = static_cast<hsize_t>(order.first());
      spec.count = static_cast<hsize_t>(order.count());
      return spec;
    };
    std::vector<FieldSpec> specs;
    const auto real = FieldSpec::Type::real;
    const auto integer = FieldSpec::Type::integer;
    specs.push_back({"/t", real, {}, 0, 0, "s", "time", {}});
    specs.push_back(slice(states, recorded_states,
                          {"/x",
                           real,
                           {},
                           0,
                           0,
                           "1",
                           "states in the scene's coordinates and order",
                           system.state_names,
                           system.state_names.empty() ? "" : text_of(system.layout)}));
    specs.push_back(
        slice(constraints, recorded_constraints, {"/w", real, {}, 0, 0, "1", "constraint values", {}}));
    specs.push_back(slice(constraints, recorded_constraints,
                          {"/mu",
                           real,
                           {static_cast<hsize_t>(mu_levels)},
                           0,
                           0,
                           "1",
                           "measures of the steps since the last row, per constraint and level",
                           {}}));
    specs.push_back(
        slice(constraints, recorded_constraints,
              {"/level", integer, {}, 0, 0, "1", "r*, levels that the step ending at t could act on", {}}));
    specs.push_back(
        {"/solver/iterations", integer, {}, 0, 0, "1", "Newton iterations since the last row", {}});
    specs.push_back(
        {"/solver/seconds", real, {}, 0, 0, "s", "wall time of the steps since the last row", {}});
    specs.push_back(
        {"/solver/residual", real, {}, 0, 0, "1", "worst certificate ratio since the last row", {}});
    specs.push_back({"/solver/active", integer, {}, 0, 0, "1", "constraints in contact", {}});
    if (outputs)
      specs.push_back(slice(
          *outputs, recorded_outputs,
          {"/z", real, {}, 0, 0, "1", "outputs, constraint by constraint, level by level", output_names}));
    return specs;
  }
};

Recorder::Recorder(const std::string& path, bool overwrite, const OutputSpec& output, const TimeSpec& time,
                   const LinearSystem& system, const RelativeDegree& relative_degree,
                   const ConstrainedDvi& dvi)
    : Recorder(Layout::find(output, system, SceneRows(system, relative_degree, dvi), dvi), path, overwrite,
               time, system, dvi) {}

Recorder::Recorder(Layout layout, const std::string& path, bool overwrite, const TimeSpec& time,
                   const LinearSystem& system, const ConstrainedDvi& dvi)
    : comm_(system.comm()),
      dvi_(dvi),
      rows_(std::move(layout.rows)),
      every_(layout.output.every),
      last_step_(time.steps),
      states_(std::move(layout.states)),
      outputs_(std::move(layout.outputs)),
      constraints_(std::move(layout.constraints)),
      file_(comm_, path, layout.fields(system, dvi.mu_levels()),
            {.expected_rows = static_cast<hsize_t>(time.steps / layout.output.every + 2),
             .overwrite = overwrite,
             .events = true,
             .impulse_units = "1"}) {
  if (layout.output.blocks)
    file_.list("/element", *layout.output.blocks, "1", "element numbers of the columns");
  mu_.assign(rows_.count() * static_cast<std::size_t>(dvi.mu_levels()), 0.0);
  write_row(time.start);
}

void Recorder::step(const Step& step, const StepReport& report, double seconds) {
  rows_.add_measures(mu_);
  iterations_ += report.iterations;
  seconds_ += seconds;
  residual_ = std::max(residual_, report.residual);
  for (const StepEvent& event : dvi_.events())
    file_.add_event({step.t_new, rows_.number_of(event), event.level,
                     event.impact ? Event::Kind::impact : Event::Kind::liftoff, rows_.impulse_of(event)});
  pending_ = step.t_new;
  if (step.number % every_ == 0 || step.number == last_step_) write_row(step.t_new);
}

void Recorder::write_row(double time) {
  file_.real(Field::t)[0] = time;
  {
    const ReadArray state(dvi_.x());
    states_.bring(state.data(), file_.real(Field::x));
  }
  constraints_.bring(rows_.w().data(), file_.real(Field::w));
  if (outputs_) outputs_->bring(rows_.z().data(), file_.real(Field::z));

  const auto levels = static_cast<std::size_t>(dvi_.mu_levels());
  const std::size_t local = rows_.count();
  const auto slice = static_cast<std::size_t>(constraints_.count());
  column_.resize(local);
  slice_.resize(slice);
  double* const measures = file_.real(Field::mu);
  for (std::size_t i = 0; i < levels; ++i) {
    for (std::size_t a = 0; a < local; ++a)
      column_[a] = mu_[a * levels + i];
    constraints_.bring(column_.data(), slice_.data());
    for (std::size_t a = 0; a < slice; ++a)
      measures[a * levels + i] = slice_[a];
  }
  constraints_.bring(rows_.level().data(), slice_.data());
  std::int32_t* const level_slice = file_.integer(Field::level);
  for (std::size_t a = 0; a < slice; ++a)
    level_slice[a] = static_cast<std::int32_t>(slice_[a]);

  std::int64_t in_contact = dvi_.active();
  MPI_Allreduce(MPI_IN_PLACE, &in_contact, 1, MPI_INT64_T, MPI_SUM, comm_);
  file_.integer(Field::iterations)[0] = static_cast<std::int32_t>(iterations_);
  file_.real(Field::seconds)[0] = seconds_;
  file_.real(Field::residual)[0] = residual_;
  file_.integer(Field::active)[0] = static_cast<std::int32_t>(in_contact);
  file_.commit_row();

  std::fill(mu_.begin(), mu_.end(), 0.0);
  iterations_ = seconds_ = residual_ = 0.0;
  pending_.reset();
}

void Recorder::finish() {
  if (pending_) write_row(*pending_);
  file_.finish();
}

}  // namespace sweepvi
