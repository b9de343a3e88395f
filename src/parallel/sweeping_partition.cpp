#include <cmath>
#include <utility>

#include "parallel/gather.hpp"
#include "parallel/row_move.hpp"
#include "parallel/share.hpp"
#include "sweepvi/sweeping.hpp"

namespace sweepvi {

namespace {

/// Components are vertices; nonzeros of A and faces join them. A face is at home with the component it reads
/// most, the first of equals.
ElementGraph gather_components(const SweepingSystem& system) {
  const MPI_Comm comm = system.comm();
  std::vector<PetscInt> homes;
  std::vector<Edge> edges;
  if (system.A)
    for_each_row(system.A.get(), [&](PetscInt row, auto columns, auto values) {
      for (std::size_t k = 0; k < columns.size(); ++k)
        if (values[k] != 0.0) edges.push_back({row, columns[k]});
    });
  if (system.G)
    for_each_row(system.G.get(), [&](PetscInt, auto columns, auto values) {
      PetscInt home = 0;
      double most = -1.0;
      for (std::size_t k = 0; k < columns.size(); ++k)
        if (std::abs(values[k]) > most) {
          most = std::abs(values[k]);
          home = columns[k];
        }
      homes.push_back(home);
      for (const PetscInt column : columns)
        edges.push_back({home, column});
    });
  edges = gather(comm, edges);
  ElementGraph components;
  components.home = gather(comm, homes);
  int rank = 0;
  MPI_Comm_rank(comm, &rank);
  const PetscInt count = system.states();
  if (rank != 0) return components;
  for (PetscInt i = 0; i < count; ++i)
    components.block.push_back(i);
  components.graph = make_graph(count, std::move(edges));
  return components;
}

}  // namespace

void distribute(SweepingSystem& system) {
  const MPI_Comm comm = system.comm();
  const Share share = share_out(comm, gather_components(system));
  system.edge_cut = share.edge_cut;
  const RowMove states(comm, static_cast<PetscInt>(system.state_order.size()), share.states);
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
