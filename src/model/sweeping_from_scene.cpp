#include "model/sweeping_from_scene.hpp"

#include "model/dense_parts.hpp"
#include "model/from_scene.hpp"
#include "parallel/gather.hpp"

namespace sweepvi {

namespace {

/// This rank's rows of signals that rank 0 has.
Forcing scatter_signals(MPI_Comm comm, std::vector<Signal>& whole, LocalRange rows) {
  broadcast(comm, whole);
  return Forcing::from(whole, rows.first, rows.last);
}

std::optional<Forcing> scatter_bound(MPI_Comm comm, std::vector<Signal>& whole, LocalRange rows) {
  Forcing bound = scatter_signals(comm, whole, rows);
  if (whole.empty()) return std::nullopt;
  return bound;
}

}  // namespace

SweepingSystem make_sweeping_system(MPI_Comm comm, SweepingSpec& spec) {
  PetscInt sizes[2] = {static_cast<PetscInt>(spec.u0.size()),
                       spec.G ? static_cast<PetscInt>(spec.G->rows) : 0};
  MPI_Bcast(sizes, 2, MPIU_INT, 0, comm);
  const LocalRange states = share(comm, sizes[0]);
  SweepingSystem system;
  system.u0 = scatter_vector(comm, spec.u0, states.size());
  system.f = scatter_signals(comm, spec.f, states);
  if (spec.A) system.A = scatter_rows(comm, *spec.A, states.size(), states.size(), true);
  system.lower = scatter_bound(comm, spec.lower, states);
  system.upper = scatter_bound(comm, spec.upper, states);
  system.state_order = numbers(states);
  if (spec.G) {
    const LocalRange faces = share(comm, sizes[1]);
    system.G = scatter_rows(comm, *spec.G, faces.size(), states.size());
    system.g = scatter_signals(comm, spec.g, faces);
    system.face_order = numbers(faces);
  }
  spec = SweepingSpec{};
  return system;
}

}  // namespace sweepvi
