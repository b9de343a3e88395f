#include "model/dense_parts.hpp"
#include "parallel/row_move.hpp"
#include "parallel/share.hpp"
#include "sweepvi/sweeping.hpp"

namespace sweepvi {

void distribute(SweepingSystem& system) {
  const MPI_Comm comm = system.comm();
  LocalRange rows;
  check(VecGetOwnershipRange(system.u0.get(), &rows.first, &rows.last));
  const std::vector<PetscInt> block = numbers(rows);  // each component on its own
  Couplings couplings;
  if (system.A) couplings.add_rows(system.A.get(), block);
  if (system.G) {
    const LocalRange faces = row_range(system.G.get());
    for (PetscInt face = faces.first; face < faces.last; ++face)
      couplings.add_constraint(get_row(system.G.get(), face));
  }
  const Share share = share_out(comm, gather_element_graph(comm, couplings, block, system.states()));
  system.edge_cut = share.edge_cut;

  const RowMove states(comm, rows.size(), share.states);
  const RowMove faces(comm, static_cast<PetscInt>(system.face_order.size()), share.constraints);
  if (!states.moves() && !faces.moves()) return;
  system.u0 = states.moved(system.u0.get());
  if (system.A) system.A = moved(system.A.get(), states, states);
  if (system.G) system.G = moved(system.G.get(), faces, states);
  system.f = moved(comm, system.f, states);
  if (system.lower) system.lower = moved(comm, *system.lower, states);
  if (system.upper) system.upper = moved(comm, *system.upper, states);
  system.g = moved(comm, system.g, faces);
  system.state_order = states.moved(system.state_order);
  system.face_order = faces.moved(system.face_order);
}

}  // namespace sweepvi
