#include "io/level_recording.hpp"

#include <algorithm>
#include <memory>
#include <numeric>

#include "io/scene_rows.hpp"
#include "io/selection.hpp"
#include "parallel/gather.hpp"

namespace sweepvi {

namespace {

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

/// Outputs stand constraint by constraint in scene order; degrees may differ.
Quantity output_quantity(MPI_Comm comm, const SceneRows& rows, const Selection& selection) {
  std::vector<int> degrees = gather(comm, rows.degrees());
  std::vector<PetscInt> numbers = gather(comm, rows.numbers());
  broadcast(comm, degrees);
  broadcast(comm, numbers);
  std::vector<PetscInt> width(numbers.size(), 0);  // in the file
  std::vector<PetscInt> degree_of(numbers.size(), 0);
  for (std::size_t k = 0; k < numbers.size(); ++k) {
    degree_of[static_cast<std::size_t>(numbers[k])] = degrees[k];
    if (selection.element(numbers[k]) >= 0) width[static_cast<std::size_t>(numbers[k])] = degrees[k];
  }
  std::vector<PetscInt> first(width.size() + 1, 0);
  std::partial_sum(width.begin(), width.end(), first.begin() + 1);

  Quantity outputs{.name = "/z", .description = "outputs, constraint by constraint, level by level"};
  outputs.total = first.back();
  for (const PetscInt number : rows.numbers()) {
    const auto at = static_cast<std::size_t>(number);
    for (PetscInt i = first[at]; i < first[at] + degree_of[at]; ++i)
      outputs.positions.push_back(width[at] > 0 ? i : -1);
  }
  const bool uniform =
      std::all_of(degree_of.begin(), degree_of.end(), [&](PetscInt r) { return r == degree_of.front(); });
  for (std::size_t a = 0; a < (uniform ? 1 : width.size()); ++a)
    for (PetscInt i = 1; i <= (uniform ? degree_of.front() : width[a]); ++i)
      outputs.names.push_back("z" + std::to_string(i) + (uniform ? "" : " of " + std::to_string(a)));
  return outputs;
}

}  // namespace

Recording level_recording(const OutputSpec& output, const LinearSystem& system,
                          const RelativeDegree& relative_degree, const ConstrainedDvi& dvi) {
  const MPI_Comm comm = system.comm();
  const auto rows = std::make_shared<const SceneRows>(system, relative_degree, dvi);
  const auto per_block = static_cast<PetscInt>(std::max<std::size_t>(1, system.state_names.size()));
  const Selection selection(output.blocks, system.states() / per_block, per_block, system.layout);
  const std::vector<PetscInt> row_positions =
      positions(rows->numbers(), [&](PetscInt number) { return selection.element(number); });
  const PetscInt row_total = output.blocks ? selection.kept() : system.scene_constraints();

  Recording recording;
  recording.elements = output.blocks;
  recording.quantities.push_back(
      {.name = "/x",
       .description = "states in the scene's coordinates and order",
       .names = system.state_names,
       .order = system.state_names.empty() ? "" : text_of(system.layout),
       .positions = positions(system.state_order, [&](PetscInt number) { return selection.state(number); }),
       .total = per_block * selection.kept(),
       .read = [&dvi](double* to) {
         const ReadArray x(dvi.x());
         std::copy(x.data(), x.data() + x.size(), to);
       }});
  recording.quantities.push_back({.name = "/w",
                                  .description = "constraint values",
                                  .positions = row_positions,
                                  .total = row_total,
                                  .read = [rows](double* to) { rows->w(to); }});
  recording.quantities.push_back(
      {.name = "/mu",
       .description = "measures of the steps since the last row, per constraint and level",
       .extents = {static_cast<hsize_t>(dvi.mu_levels())},
       .positions = row_positions,
       .total = row_total,
       .summed = true,
       .read = [rows](double* to) { rows->mu(to); }});
  recording.quantities.push_back({.name = "/level",
                                  .description = "r*, levels that the step ending at t could act on",
                                  .type = FieldSpec::Type::integer,
                                  .positions = row_positions,
                                  .total = row_total,
                                  .read = [rows](double* to) { rows->level(to); }});
  int has_outputs = dvi.z().empty() ? 0 : 1;
  MPI_Allreduce(MPI_IN_PLACE, &has_outputs, 1, MPI_INT, MPI_LOR, comm);
  if (has_outputs != 0) {
    recording.quantities.push_back(output_quantity(comm, *rows, selection));
    recording.quantities.back().read = [rows](double* to) { rows->z(to); };
  }
  recording.events = [rows, &dvi](double t) {
    std::vector<Event> events;
    for (const StepEvent& event : dvi.events())
      events.push_back({t, rows->number_of(event), event.level,
                        event.impact ? Event::Kind::impact : Event::Kind::liftoff, rows->impulse_of(event)});
    return events;
  };
  return recording;
}

}  // namespace sweepvi
