#include "parallel/row_move.hpp"
#include "parallel/share.hpp"
#include "sweepvi/lagrangian.hpp"

namespace sweepvi {

void distribute(LagrangianSystem& system) {
  const MPI_Comm comm = system.comm();
  Couplings couplings;
  for (Mat matrix : {system.M.get(), system.K.get(), system.C.get()})
    if (matrix != nullptr) couplings.add_rows(matrix, system.block);
  for (PetscInt a = row_range(system.H.get()).first; a < row_range(system.H.get()).last; ++a)
    couplings.add_constraint(get_row(system.H.get(), a));
  Share share = share_out(comm, gather_element_graph(comm, couplings, system.block, system.block_count));
  system.edge_cut = share.edge_cut;
  system.block_count = share.block_count;
  system.block = std::move(share.block);

  const RowMove coordinates(comm, row_range(system.M.get()).size(), share.states);
  const RowMove constraints(comm, row_range(system.H.get()).size(), share.constraints);
  if (!coordinates.moves() && !constraints.moves()) return;
  for (Matrix* matrix : {&system.M, &system.K, &system.C})
    if (*matrix) *matrix = moved(matrix->get(), coordinates, coordinates);
  system.H = moved(system.H.get(), constraints, coordinates);
  system.f = moved(comm, system.f, coordinates);
  for (Vector* vector : {&system.q0, &system.v0})
    *vector = coordinates.moved(vector->get());
  for (Vector* vector : {&system.g0, &system.e})
    *vector = constraints.moved(vector->get());
  system.coordinate_order = coordinates.moved(system.coordinate_order);
  system.constraint_order = constraints.moved(system.constraint_order);
}

}  // namespace sweepvi
