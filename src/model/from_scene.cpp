#include "model/from_scene.hpp"

#include <numeric>
#include <utility>

#include "model/chain.hpp"
#include "model/dense_parts.hpp"
#include "parallel/gather.hpp"
#include "petsc/sparse.hpp"

namespace sweepvi {

namespace {

std::vector<int> counts_on_root(MPI_Comm comm, PetscInt mine) {
  return gather(comm, std::vector<int>{static_cast<int>(mine)});
}

template <class T>
std::vector<T> scatter(MPI_Comm comm, const std::vector<T>& whole, const std::vector<int>& counts, int mine,
                       MPI_Datatype type) {
  std::vector<T> part(static_cast<std::size_t>(mine));
  const std::vector<int> starts = starts_of_pieces(counts);
  MPI_Scatterv(whole.data(), counts.data(), starts.data(), type, part.data(), mine, type, 0, comm);
  return part;
}

}  // namespace

Matrix scatter_rows(MPI_Comm comm, const SparseEntries& whole, PetscInt local_rows, PetscInt local_columns,
                    bool full_diagonal) {
  const std::vector<int> row_counts = counts_on_root(comm, local_rows);
  std::vector<std::int64_t> lengths;
  for (std::size_t i = 1; i < whole.row_starts.size(); ++i)
    lengths.push_back(whole.row_starts[i] - whole.row_starts[i - 1]);
  const auto my_lengths = scatter(comm, lengths, row_counts, static_cast<int>(local_rows), MPI_INT64_T);
  const int my_entries = mpi_count(std::accumulate(my_lengths.begin(), my_lengths.end(), std::int64_t{0}));
  const std::vector<int> entry_counts = counts_on_root(comm, my_entries);
  const auto columns = scatter(comm, whole.columns, entry_counts, my_entries, MPI_INT64_T);
  const auto values = scatter(comm, whole.values, entry_counts, my_entries, MPI_DOUBLE);
  PetscInt row = 0;  // of the whole matrix
  MPI_Exscan(&local_rows, &row, 1, MPIU_INT, MPI_SUM, comm);
  RowBuilder rows;
  std::size_t k = 0;
  for (const std::int64_t length : my_lengths) {
    if (full_diagonal) rows.add(row, 0.0);
    ++row;
    for (std::int64_t i = 0; i < length; ++i, ++k)
      if (values[k] != 0.0) rows.add(static_cast<PetscInt>(columns[k]), values[k]);
    rows.end_row();
  }
  return rows.finish(comm, local_columns);
}

Vector scatter_vector(MPI_Comm comm, const std::vector<double>& whole, PetscInt local_size) {
  const std::vector<int> counts = counts_on_root(comm, local_size);
  const auto mine = scatter(comm, whole, counts, static_cast<int>(local_size), MPI_DOUBLE);
  Vector vector = make_vector(comm, local_size);
  const WriteArray values(vector.get());
  std::copy(mine.begin(), mine.end(), values.data());
  return vector;
}

namespace {

LinearSystem from_spec(MPI_Comm comm, LinearSpec& spec) {
  PetscInt sizes[4] = {static_cast<PetscInt>(spec.A.rows), static_cast<PetscInt>(spec.C.rows), 0,
                       spec.wmax.empty() ? 0 : 1};
  if (spec.D)
    for (const double value : spec.D->values)
      sizes[2] = sizes[2] != 0 || value != 0.0 ? 1 : 0;
  MPI_Bcast(sizes, 4, MPIU_INT, 0, comm);
  PetscInt states = PETSC_DECIDE;
  PetscInt constraints = PETSC_DECIDE;
  check(PetscSplitOwnership(comm, &states, &sizes[0]));
  check(PetscSplitOwnership(comm, &constraints, &sizes[1]));

  LinearSystem system;
  system.A = scatter_rows(comm, spec.A, states, states);
  system.B = scatter_rows(comm, spec.B, states, constraints);
  system.C = scatter_rows(comm, spec.C, constraints, states);
  if (sizes[2] != 0)
    system.D = scatter_rows(comm, spec.D.value_or(SparseEntries{}), constraints, constraints);
  system.x0 = scatter_vector(comm, spec.x0, states);
  system.w0 = scatter_vector(comm, spec.w0, constraints);
  if (sizes[3] != 0) system.wmax = scatter_vector(comm, spec.wmax, constraints);
  const LocalRange rows = row_range(system.A.get());
  const LocalRange constraint_rows = row_range(system.C.get());
  broadcast(comm, spec.f);
  system.f = Forcing::from(spec.f, rows.first, rows.last);
  broadcast(comm, spec.relative_degree);
  system.stated_degree = spec.relative_degree;
  system.state_order.resize(static_cast<std::size_t>(states));
  std::iota(system.state_order.begin(), system.state_order.end(), rows.first);
  system.block = system.state_order;
  system.block_count = sizes[0];
  system.constraint_order.resize(static_cast<std::size_t>(constraints));
  std::iota(system.constraint_order.begin(), system.constraint_order.end(), constraint_rows.first);
  spec = LinearSpec{};
  return system;
}

LagrangianSystem from_spec(MPI_Comm comm, LagrangianSpec& spec) {
  PetscInt sizes[3] = {static_cast<PetscInt>(spec.M.rows), static_cast<PetscInt>(spec.H.rows),
                       spec.C.rows > 0 ? 1 : 0};
  MPI_Bcast(sizes, 3, MPIU_INT, 0, comm);
  const LocalRange coordinates = share(comm, sizes[0]);
  const LocalRange constraints = share(comm, sizes[1]);
  LagrangianSystem system;
  system.M = scatter_rows(comm, spec.M, coordinates.size(), coordinates.size());
  system.K = scatter_rows(comm, spec.K, coordinates.size(), coordinates.size());
  if (sizes[2] != 0) system.C = scatter_rows(comm, spec.C, coordinates.size(), coordinates.size());
  system.H = scatter_rows(comm, spec.H, constraints.size(), coordinates.size());
  system.g0 = scatter_vector(comm, spec.g0, constraints.size());
  system.e = scatter_vector(comm, spec.e, constraints.size());
  system.q0 = scatter_vector(comm, spec.q0, coordinates.size());
  system.v0 = scatter_vector(comm, spec.v0, coordinates.size());
  broadcast(comm, spec.f);
  system.f = Forcing::from(spec.f, coordinates.first, coordinates.last);
  system.coordinate_order = numbers(coordinates);
  system.constraint_order = numbers(constraints);
  system.block = system.coordinate_order;
  system.block_count = sizes[0];
  spec = LagrangianSpec{};
  return system;
}

}  // namespace

LinearSystem make_linear_system(MPI_Comm comm, Scene& scene) {
  if (auto* spec = std::get_if<LinearSpec>(&scene.model)) return from_spec(comm, *spec);
  if (auto* spec = std::get_if<LagrangianSpec>(&scene.model)) return to_linear(from_spec(comm, *spec));
  const ChainSpec spec = std::exchange(std::get<ChainSpec>(scene.model), ChainSpec{});
  return make_chain(comm, spec);
}

LagrangianSystem make_lagrangian_system(MPI_Comm comm, Scene& scene) {
  if (auto* spec = std::get_if<LagrangianSpec>(&scene.model)) return from_spec(comm, *spec);
  const ChainSpec spec = std::exchange(std::get<ChainSpec>(scene.model), ChainSpec{});
  return make_lagrangian_chain(comm, spec);
}

}  // namespace sweepvi
