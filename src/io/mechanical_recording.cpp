#include "io/mechanical_recording.hpp"

#include <algorithm>
#include <memory>
#include <utility>

#include "io/selection.hpp"
#include "io/step_events.hpp"

namespace sweepvi {

namespace {

void copy(const std::vector<double>& from, double* to) {
  std::copy(from.begin(), from.end(), to);
}

}  // namespace

Recording mechanical_recording(const OutputSpec& output, const LagrangianSystem& system, MechanicalDvi& dvi,
                               std::vector<std::string> names) {
  const PetscInt n = system.coordinates();
  const Selection selection(output.blocks, n, 2, StateLayout::state_by_state);
  std::vector<PetscInt> states;
  for (const PetscInt shift : {PetscInt{0}, n})
    for (const PetscInt number : system.coordinate_order)
      states.push_back(selection.state(shift + number));
  std::vector<PetscInt> constraints;
  for (const PetscInt number : system.constraint_order)
    constraints.push_back(selection.element(number));
  const PetscInt total = output.blocks ? selection.kept() : system.constraints();

  Recording recording;
  recording.elements = output.blocks;
  recording.impulse_units = "N s";
  const std::string order = names.empty() ? "" : "state by state";
  recording.quantities.push_back({.name = "/x",
                                  .description = "all coordinates, then all velocities, in the scene's order",
                                  .names = std::move(names),
                                  .order = order,
                                  .positions = std::move(states),
                                  .total = 2 * selection.kept(),
                                  .read = [&dvi](double* to) {
                                    const ReadArray x(dvi.x());
                                    std::copy(x.data(), x.data() + x.size(), to);
                                  }});
  recording.quantities.push_back({.name = "/w",
                                  .description = "gaps",
                                  .units = "m",
                                  .positions = constraints,
                                  .total = total,
                                  .read = [&dvi](double* to) { copy(dvi.w(), to); }});
  recording.quantities.push_back(
      {.name = "/mu",
       .description = "impulses of the steps since the last row, per constraint, on level 2",
       .units = "N s",
       .extents = {2},
       .positions = constraints,
       .total = total,
       .summed = true,
       .read = [&dvi](double* to) { copy(dvi.mu(), to); }});
  recording.quantities.push_back(
      {.name = "/level",
       .description = "2 where the constraint was detected in the step ending at t, else 1",
       .type = FieldSpec::Type::integer,
       .positions = constraints,
       .total = total,
       .read = [&dvi](double* to) { std::copy(dvi.level().begin(), dvi.level().end(), to); }});

  // Sums over the whole system: rank 0 has them to store.
  int rank = 0;
  MPI_Comm_rank(system.comm(), &rank);
  const std::vector<PetscInt> places = rank == 0 ? std::vector<PetscInt>{0, 1, 2} : std::vector<PetscInt>{};
  const auto energy = std::make_shared<Energy>();  // of the row, found when /energy is read
  const auto write = [rank](double* to, double first, double second, double third) {
    if (rank != 0) return;
    to[0] = first;
    to[1] = second;
    to[2] = third;
  };
  recording.quantities.push_back(
      {.name = "/energy",
       .description = "kinetic, potential (with constant forces), dissipated at impacts so far",
       .units = "J",
       .names = {"kinetic", "potential", "dissipated"},
       .positions = places,
       .total = 3,
       .read = [energy, write, &dvi](double* to) {
         *energy = dvi.energy();
         write(to, energy->kinetic, energy->potential, energy->dissipated);
       }});
  recording.quantities.push_back(
      {.name = "/work",
       .description = "so far: lost to damping, done by forces without a potential, lost to theta > 1/2. "
                      "kinetic + potential + dissipated + damping - forces + scheme keeps its first value",
       .units = "J",
       .names = {"damping", "forces", "scheme"},
       .positions = places,
       .total = 3,
       .read = [energy, write](double* to) { write(to, energy->damping, energy->work, energy->scheme); }});

  recording.events = [&system, &dvi](double t) {
    return events_of(dvi.events(), system.constraint_order, t);
  };
  return recording;
}

}  // namespace sweepvi
