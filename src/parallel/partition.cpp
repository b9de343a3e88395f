#include "sweepvi/partition.hpp"

#include <metis.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "parallel/gather.hpp"

namespace sweepvi {

namespace {

struct Edge {
  PetscInt first, second;
  bool operator==(const Edge&) const = default;
  bool operator<(const Edge& other) const {
    return first != other.first ? first < other.first : second < other.second;
  }
};
using Owners = std::vector<int>;

/// State pairs in different blocks that A couples; pairs inside a block of this rank are left out early.
std::vector<Edge> state_edges(const LinearSystem& system) {
  const LocalRange states = row_range(system.A.get());
  std::vector<Edge> edges;
  for_each_row(system.A.get(), [&](PetscInt row, auto columns, auto values) {
    for (std::size_t k = 0; k < columns.size(); ++k) {
      const PetscInt column = columns[k];
      if (values[k] == 0.0 || column == row) continue;
      const auto block_of = [&](PetscInt state) {
        return system.block[static_cast<std::size_t>(state - states.first)];
      };
      if (states.contains(column) && block_of(column) == block_of(row)) continue;
      edges.push_back({row, column});
    }
  });
  return edges;
}

/// Where each owned constraint lives, and the states it must share a rank with (its outputs) or would like
/// to.
void constraint_edges(const LinearSystem& system, const RelativeDegree& relative_degree,
                      std::vector<PetscInt>& homes, std::vector<Edge>& together, std::vector<Edge>& edges) {
  const Matrix pushed = transpose(system.B.get());
  const LocalRange constraints = row_range(system.C.get());
  const LocalRange outputs = row_range(relative_degree.Z.get());
  for (PetscInt a = constraints.first; a < constraints.last; ++a) {
    const SparseRow read = get_row(system.C.get(), a);
    PetscInt home = 0;
    double most = -1.0;
    for (const auto& [state, value] : read)
      if (std::abs(value) > most) {
        most = std::abs(value);
        home = state;
      }
    const auto local = static_cast<std::size_t>(a - constraints.first);
    // Outputs that are states, or take the place of one, stay with their constraint: box on z relies on it,
    // primal-dual saves messages.
    for (PetscInt q = relative_degree.first_level[local]; q < relative_degree.first_level[local + 1]; ++q) {
      if (relative_degree.has_pivots)
        together.push_back({home, relative_degree.pivot[static_cast<std::size_t>(q)]});
      const SparseRow output = get_row(relative_degree.Z.get(), outputs.first + q);
      if (output.size() == 1) together.push_back({home, output.front().first});
    }
    homes.push_back(home);
    for (const SparseRow& row : {read, get_row(pushed.get(), a)})
      for (const auto& [state, value] : row)
        if (state != home && value != 0.0) edges.push_back({home, state});
  }
}

/// Merges blocks that must stay together; returns the number of blocks left.
PetscInt merge_blocks(std::vector<PetscInt>& block, PetscInt block_count, const std::vector<Edge>& together) {
  std::vector<PetscInt> parent(static_cast<std::size_t>(block_count));
  std::iota(parent.begin(), parent.end(), 0);
  const auto root = [&](PetscInt i) {
    while (parent[static_cast<std::size_t>(i)] != i)
      i = parent[static_cast<std::size_t>(i)];
    return i;
  };
  for (const auto& [a, b] : together) {
    const PetscInt first = root(block[static_cast<std::size_t>(a)]);
    const PetscInt second = root(block[static_cast<std::size_t>(b)]);
    parent[static_cast<std::size_t>(std::max(first, second))] = std::min(first, second);
  }
  std::vector<PetscInt> number(static_cast<std::size_t>(block_count), -1);
  PetscInt count = 0;
  for (PetscInt i = 0; i < block_count; ++i)
    if (root(i) == i) number[static_cast<std::size_t>(i)] = count++;
  for (PetscInt& b : block)
    b = number[static_cast<std::size_t>(root(b))];
  return count;
}

struct Cut {
  std::vector<int> rank_of_block;
  PetscInt edges = 0;
};

Cut cut_graph(PetscInt blocks, const std::vector<PetscInt>& block, std::vector<Edge> edges, int ranks) {
  for (Edge& edge : edges)
    edge = {block[static_cast<std::size_t>(edge.first)], block[static_cast<std::size_t>(edge.second)]};
  std::erase_if(edges, [](const Edge& edge) { return edge.first == edge.second; });
  const std::size_t one_way = edges.size();
  for (std::size_t i = 0; i < one_way; ++i)
    edges.push_back({edges[i].second, edges[i].first});
  std::sort(edges.begin(), edges.end());
  edges.erase(std::unique(edges.begin(), edges.end()), edges.end());

  Cut cut;
  if (blocks <= ranks) {  // a block each; the other ranks stay empty
    cut.rank_of_block.resize(static_cast<std::size_t>(blocks));
    std::iota(cut.rank_of_block.begin(), cut.rank_of_block.end(), 0);
    cut.edges = static_cast<PetscInt>(edges.size() / 2);
    return cut;
  }
  std::vector<idx_t> starts(static_cast<std::size_t>(blocks) + 1, 0);
  std::vector<idx_t> neighbours;
  std::vector<idx_t> weights(static_cast<std::size_t>(blocks), 0);
  neighbours.reserve(edges.size());
  for (const Edge& edge : edges) {
    ++starts[static_cast<std::size_t>(edge.first) + 1];
    neighbours.push_back(edge.second);
  }
  std::partial_sum(starts.begin(), starts.end(), starts.begin());
  for (const PetscInt b : block)
    ++weights[static_cast<std::size_t>(b)];
  idx_t vertices = blocks;
  idx_t balances = 1;
  idx_t parts = ranks;
  idx_t cut_edges = 0;
  std::vector<idx_t> part(static_cast<std::size_t>(blocks), 0);
  idx_t options[METIS_NOPTIONS];
  METIS_SetDefaultOptions(options);
  options[METIS_OPTION_SEED] = 1;  // the same cut every time
  // Recursive bisection cuts better for few parts; k-way is the one that scales in their number.
  const auto partition = ranks <= 8 ? METIS_PartGraphRecursive : METIS_PartGraphKway;
  const int status = partition(&vertices, &balances, starts.data(), neighbours.data(), weights.data(),
                               nullptr, nullptr, &parts, nullptr, nullptr, options, &cut_edges, part.data());
  if (status != METIS_OK)
    throw Error(ExitCode::internal, "METIS failed with status " + std::to_string(status));
  cut.rank_of_block.assign(part.begin(), part.end());
  cut.edges = static_cast<PetscInt>(cut_edges);
  return cut;
}

IndexSet owned_by(MPI_Comm comm, const Owners& owners, int rank) {
  std::vector<PetscInt> mine;
  for (std::size_t i = 0; i < owners.size(); ++i)
    if (owners[i] == rank) mine.push_back(static_cast<PetscInt>(i));
  IndexSet set;
  check(ISCreateGeneral(comm, static_cast<PetscInt>(mine.size()), mine.data(), PETSC_COPY_VALUES, set.put()));
  return set;
}

std::vector<PetscInt> indices(const IndexSet& set) {
  PetscInt size = 0;
  const PetscInt* values = nullptr;
  check(ISGetLocalSize(set.get(), &size));
  check(ISGetIndices(set.get(), &values));
  std::vector<PetscInt> copy(values, values + size);
  check(ISRestoreIndices(set.get(), &values));
  return copy;
}

Matrix permuted(Mat matrix, const IndexSet& rows, const IndexSet& columns) {
  Matrix result;
  check(MatCreateSubMatrix(matrix, rows.get(), columns.get(), MAT_INITIAL_MATRIX, result.put()));
  return result;
}

Vector permuted(Vec vector, const IndexSet& rows) {
  PetscInt local = 0;
  check(ISGetLocalSize(rows.get(), &local));
  Vector result = make_vector(PetscObjectComm(reinterpret_cast<PetscObject>(vector)), local);
  Scatter scatter;
  check(VecScatterCreate(vector, rows.get(), result.get(), nullptr, scatter.put()));
  check(VecScatterBegin(scatter.get(), vector, result.get(), INSERT_VALUES, SCATTER_FORWARD));
  check(VecScatterEnd(scatter.get(), vector, result.get(), INSERT_VALUES, SCATTER_FORWARD));
  return result;
}

/// Sends each (global row, payload) to the row's new owner; returns (new local row, payload).
std::vector<Forcing::Entry> moved(MPI_Comm comm, const std::vector<Forcing::Entry>& entries, PetscInt first,
                                  const Owners& owners, const std::vector<PetscInt>& new_rows) {
  int size = 1;
  MPI_Comm_size(comm, &size);
  std::vector<std::vector<Forcing::Entry>> to(static_cast<std::size_t>(size));
  for (const Forcing::Entry& entry : entries) {
    const PetscInt row = first + entry.local;
    to[static_cast<std::size_t>(owners[static_cast<std::size_t>(row)])].push_back({row, entry.signal});
  }
  std::vector<int> send_counts, receive_counts(static_cast<std::size_t>(size)), send_starts, receive_starts;
  std::vector<Forcing::Entry> send;
  for (const auto& part : to) {
    send_starts.push_back(static_cast<int>(send.size()));
    send_counts.push_back(static_cast<int>(part.size()));
    send.insert(send.end(), part.begin(), part.end());
  }
  MPI_Alltoall(send_counts.data(), 1, MPI_INT, receive_counts.data(), 1, MPI_INT, comm);
  int total = 0;
  for (const int count : receive_counts) {
    receive_starts.push_back(total);
    total += count;
  }
  std::vector<Forcing::Entry> received(static_cast<std::size_t>(total));
  MPI_Datatype type = MPI_DATATYPE_NULL;
  MPI_Type_contiguous(static_cast<int>(sizeof(Forcing::Entry)), MPI_BYTE, &type);
  MPI_Type_commit(&type);
  MPI_Alltoallv(send.data(), send_counts.data(), send_starts.data(), type, received.data(),
                receive_counts.data(), receive_starts.data(), type, comm);
  MPI_Type_free(&type);
  for (Forcing::Entry& entry : received)
    entry.local = static_cast<PetscInt>(std::lower_bound(new_rows.begin(), new_rows.end(), entry.local) -
                                        new_rows.begin());
  return received;
}

}  // namespace

void distribute(LinearSystem& system, RelativeDegree& relative_degree) {
  const MPI_Comm comm = system.comm();
  int rank = 0;
  int ranks = 1;
  MPI_Comm_rank(comm, &rank);
  MPI_Comm_size(comm, &ranks);
  if (ranks == 1) return;

  // Rank 0 sees the whole graph, without what lies inside one rank's block.
  std::vector<PetscInt> homes;
  std::vector<Edge> together;
  std::vector<Edge> edges = state_edges(system);
  constraint_edges(system, relative_degree, homes, together, edges);
  std::vector<PetscInt> block = gather(comm, system.block);
  edges = gather(comm, edges);
  together = gather(comm, together);
  homes = gather(comm, homes);

  Owners state_owner;
  Owners constraint_owner;
  agreed(comm, [&] {
    if (rank != 0) return;
    const PetscInt blocks = merge_blocks(block, system.block_count, together);
    const Cut cut = cut_graph(blocks, block, std::move(edges), ranks);
    system.edge_cut = cut.edges;
    for (const PetscInt b : block)
      state_owner.push_back(cut.rank_of_block[static_cast<std::size_t>(b)]);
    for (const PetscInt home : homes)
      constraint_owner.push_back(state_owner[static_cast<std::size_t>(home)]);
  });
  MPI_Bcast(&system.edge_cut, 1, MPIU_INT, 0, comm);
  broadcast(comm, state_owner);
  broadcast(comm, constraint_owner);

  const LocalRange old_states = row_range(system.A.get());
  const IndexSet states = owned_by(comm, state_owner, rank);
  const IndexSet constraints = owned_by(comm, constraint_owner, rank);
  const std::vector<PetscInt> new_states = indices(states);
  const std::vector<PetscInt> new_constraints = indices(constraints);

  // Outputs travel with their constraint, so the degrees must be known everywhere for a moment.
  std::vector<int> degrees = gather(comm, relative_degree.degree);
  broadcast(comm, degrees);
  std::vector<double> diagonals = gather(comm, relative_degree.markov_diagonal);
  broadcast(comm, diagonals);
  std::vector<PetscInt> pivots = gather(comm, relative_degree.pivot);
  broadcast(comm, pivots);
  std::vector<PetscInt> scene_numbers = gather(comm, system.constraint_order);
  broadcast(comm, scene_numbers);
  std::vector<OppositeRow> opposite = system.opposite;
  for (OppositeRow& row : opposite)
    row.constraint += row_range(system.C.get()).first;
  opposite = gather(comm, opposite);
  broadcast(comm, opposite);
  system.opposite.clear();
  std::vector<PetscInt> first_output(degrees.size() + 1, 0);
  for (std::size_t a = 0; a < degrees.size(); ++a)
    first_output[a + 1] = first_output[a] + degrees[a];
  std::vector<PetscInt> new_outputs;
  relative_degree.degree.clear();
  relative_degree.markov_diagonal.clear();
  relative_degree.pivot.clear();
  relative_degree.first_level.assign(1, 0);
  std::vector<PetscInt> constraint_order;
  for (const PetscInt a : new_constraints) {
    const auto at = static_cast<std::size_t>(a);
    relative_degree.degree.push_back(degrees[at]);
    relative_degree.markov_diagonal.push_back(diagonals[at]);
    relative_degree.first_level.push_back(relative_degree.first_level.back() + degrees[at]);
    for (PetscInt q = first_output[at]; q < first_output[at + 1]; ++q)
      new_outputs.push_back(q);
    const auto row =
        std::lower_bound(opposite.begin(), opposite.end(), a,
                         [](const OppositeRow& o, PetscInt number) { return o.constraint < number; });
    if (row != opposite.end() && row->constraint == a) {
      system.opposite.push_back(*row);
      system.opposite.back().constraint = static_cast<PetscInt>(constraint_order.size());
    }
    constraint_order.push_back(scene_numbers[at]);
  }
  IndexSet outputs;
  check(ISCreateGeneral(comm, static_cast<PetscInt>(new_outputs.size()), new_outputs.data(),
                        PETSC_COPY_VALUES, outputs.put()));

  system.A = permuted(system.A.get(), states, states);
  system.B = permuted(system.B.get(), states, constraints);
  system.C = permuted(system.C.get(), constraints, states);
  if (system.D) system.D = permuted(system.D.get(), constraints, constraints);
  system.w0 = permuted(system.w0.get(), constraints);
  if (system.wmax) system.wmax = permuted(system.wmax.get(), constraints);
  system.x0 = permuted(system.x0.get(), states);
  relative_degree.Z = permuted(relative_degree.Z.get(), outputs, states);
  relative_degree.directions = permuted(relative_degree.directions.get(), outputs, states);
  relative_degree.markov = permuted(relative_degree.markov.get(), constraints, constraints);
  system.f.constant = moved(comm, system.f.constant, old_states.first, state_owner, new_states);
  system.f.varying = moved(comm, system.f.varying, old_states.first, state_owner, new_states);

  std::vector<PetscInt> state_numbers = gather(comm, system.state_order);
  broadcast(comm, state_numbers);
  system.state_order.clear();
  for (const PetscInt state : new_states)
    system.state_order.push_back(state_numbers[static_cast<std::size_t>(state)]);
  system.constraint_order = constraint_order;
  if (relative_degree.has_pivots) {
    const PetscInt first = row_range(system.A.get()).first;
    for (const PetscInt q : new_outputs) {
      const auto at =
          std::lower_bound(new_states.begin(), new_states.end(), pivots[static_cast<std::size_t>(q)]);
      relative_degree.pivot.push_back(first + static_cast<PetscInt>(at - new_states.begin()));
    }
  }
  broadcast(comm, block);
  system.block.clear();
  for (const PetscInt state : new_states)
    system.block.push_back(block[static_cast<std::size_t>(state)]);
}

}  // namespace sweepvi
