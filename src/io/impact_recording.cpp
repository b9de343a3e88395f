#include "io/impact_recording.hpp"

#include <algorithm>
#include <array>

#include "io/selection.hpp"
#include "io/step_events.hpp"

namespace sweepvi {

namespace {

void copy(Vec from, double* to) {
  const ReadArray values(from);
  std::copy(values.data(), values.data() + values.size(), to);
}

/// Two values of each oscillator, one after the other.
void interleave(Vec first, Vec second, double* to) {
  const ReadArray a(first);
  const ReadArray b(second);
  for (PetscInt i = 0; i < a.size(); ++i) {
    *to++ = a[i];
    *to++ = b[i];
  }
}

/// Kinetic, potential, dissipated: of all ranks, where it is stored.
void find_energy(MPI_Comm comm, const ImpactOscillators& oscillators, const ImpactDvi& dvi, double* to) {
  const std::array<double, 3> mine = {dvi.kinetic(), oscillators.potential(dvi.x()).value_or(0.0),
                                      dvi.dissipated()};
  std::array<double, 3> sums{};
  MPI_Reduce(mine.data(), sums.data(), 3, MPI_DOUBLE, MPI_SUM, 0, comm);
  int rank = 0;
  MPI_Comm_rank(comm, &rank);
  if (rank == 0) std::copy(sums.begin(), sums.end(), to);
}

}  // namespace

Recording impact_recording(const OutputSpec& output, const LinearSystem& system,
                           const ImpactOscillators& oscillators, const ImpactDvi& dvi) {
  const MPI_Comm comm = system.comm();
  const Selection selection(output.blocks, system.constraints(), 2, system.layout);
  std::vector<PetscInt> states;  // x, x' of one oscillator after the other, or s, v
  for (const PetscInt number : system.state_order)
    states.push_back(selection.state(number));
  std::vector<PetscInt> elements;
  for (const PetscInt number : system.constraint_order)
    elements.push_back(selection.element(number));

  Recording recording;
  recording.elements = output.blocks;
  recording.impulse_units = "N s";
  recording.quantities.push_back(
      {.name = "/x",
       .description = "all positions [m], then all velocities [m/s], in the scene's order",
       .names = system.state_names,
       .order = "state by state",
       .positions = states,
       .total = 2 * selection.kept(),
       .read = [&dvi](double* to) { interleave(dvi.x(), dvi.velocity(), to); }});
  recording.quantities.push_back(
      {.name = "/z",
       .description = "all s [m], then all v [m/s]: x = |s|, x' = (1 - kappa sgn(s) sgn(v)) v sgn(s)",
       .names = {"s", "v"},
       .order = "state by state",
       .positions = states,
       .total = 2 * selection.kept(),
       .read = [&dvi](double* to) { interleave(dvi.s(), dvi.v(), to); }});
  recording.quantities.push_back({.name = "/w",
                                  .description = "constraint values: positions",
                                  .units = "m",
                                  .positions = elements,
                                  .total = selection.kept(),
                                  .read = [&dvi](double* to) { copy(dvi.x(), to); }});
  recording.quantities.push_back(
      {.name = "/lambda",
       .description =
           "signs of s and v in the step ending at t, lambda_s and lambda_v; at t_0 those of the data",
       .extents = {2},
       .positions = elements,
       .total = selection.kept(),
       .read = [&dvi](double* to) { interleave(dvi.lambda_s(), dvi.lambda_v(), to); }});
  int rank = 0;
  MPI_Comm_rank(comm, &rank);
  recording.quantities.push_back(
      {.name = "/energy",
       .description =
           "kinetic, potential (springs and constant forces), dissipated at impacts so far; unit masses",
       .units = "J",
       .names = {"kinetic", "potential", "dissipated"},
       .positions = rank == 0 ? std::vector<PetscInt>{0, 1, 2} : std::vector<PetscInt>{},
       .total = 3,
       .read = [comm, &oscillators, &dvi](double* to) { find_energy(comm, oscillators, dvi, to); }});
  recording.events = [&system, &dvi](double t) {
    return events_of(dvi.events(), system.constraint_order, t);
  };
  return recording;
}

}  // namespace sweepvi
