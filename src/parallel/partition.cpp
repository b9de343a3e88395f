#include "sweepvi/partition.hpp"

#include <numeric>
#include <utility>

#include "parallel/cut.hpp"
#include "parallel/element_graph.hpp"
#include "parallel/gather.hpp"
#include "parallel/numbering.hpp"
#include "parallel/row_move.hpp"

namespace sweepvi {

namespace {

/// 0, 1, ... in the order of their keys, which are below `bound`; equal keys keep their order.
std::vector<PetscInt> sorted_by(const std::vector<PetscInt>& keys, std::size_t bound) {
  std::vector<PetscInt> next(bound + 1, 0);
  for (const PetscInt key : keys)
    ++next[static_cast<std::size_t>(key) + 1];
  std::partial_sum(next.begin(), next.end(), next.begin());
  std::vector<PetscInt> order(keys.size());
  for (std::size_t i = 0; i < keys.size(); ++i)
    order[static_cast<std::size_t>(next[static_cast<std::size_t>(keys[i])]++)] = static_cast<PetscInt>(i);
  return order;
}

/// values[places[k]] for each k.
std::vector<PetscInt> picked(const std::vector<PetscInt>& values, const std::vector<PetscInt>& places) {
  std::vector<PetscInt> result;
  result.reserve(places.size());
  for (const PetscInt place : places)
    result.push_back(values[static_cast<std::size_t>(place)]);
  return result;
}

std::vector<PetscInt> inverse(const std::vector<PetscInt>& order) {
  std::vector<PetscInt> number(order.size());
  for (std::size_t k = 0; k < order.size(); ++k)
    number[static_cast<std::size_t>(order[k])] = static_cast<PetscInt>(k);
  return number;
}

/// How many belong to each rank.
std::vector<int> shares(const std::vector<PetscInt>& rank_of, int ranks) {
  std::vector<int> counts(static_cast<std::size_t>(ranks), 0);
  for (const PetscInt rank : rank_of)
    ++counts[static_cast<std::size_t>(rank)];
  return counts;
}

/// Which rank owns which vertex of rank 0's graph; empty on the others.
struct Ownership {
  std::vector<PetscInt> rank_of;   // of each vertex
  std::vector<PetscInt> vertices;  // rank by rank
  std::vector<int> counts;         // of each rank

  Ownership(std::vector<PetscInt> ranks_of_vertices, int ranks)
      : rank_of(std::move(ranks_of_vertices)),
        vertices(sorted_by(rank_of, static_cast<std::size_t>(ranks))),
        counts(shares(rank_of, ranks)) {}
};

/// Deals rank 0's graph out: each rank gets its vertices, numbered from 0, and the edges among them.
Graph deal_out(MPI_Comm comm, const Graph& graph, const Ownership& ownership) {
  const std::vector<PetscInt> number = inverse(ownership.vertices);
  const std::vector<int> first = starts_of_pieces(ownership.counts);
  std::vector<idx_t> degrees;
  std::vector<idx_t> neighbours;
  std::vector<int> lengths(ownership.counts.size(), 0);
  for (const PetscInt vertex : ownership.vertices) {
    const PetscInt owner = ownership.rank_of[static_cast<std::size_t>(vertex)];
    const auto rank = static_cast<std::size_t>(owner);
    const std::size_t before = neighbours.size();
    for (const idx_t neighbour : graph.of(static_cast<idx_t>(vertex))) {
      const auto other = static_cast<std::size_t>(neighbour);
      if (ownership.rank_of[other] == owner)
        neighbours.push_back(static_cast<idx_t>(number[other] - first[rank]));
    }
    degrees.push_back(static_cast<idx_t>(neighbours.size() - before));
    lengths[rank] += static_cast<int>(degrees.back());
  }
  Graph mine;
  mine.neighbours = scatter(comm, neighbours, lengths);
  for (const idx_t degree : scatter(comm, degrees, ownership.counts))
    mine.starts.push_back(mine.starts.back() + degree);
  return mine;
}

/// The vertices of rank 0's graph, rank by rank, each rank's in an order that it chose for low fill.
std::vector<PetscInt> number_within_ranks(MPI_Comm comm, const Graph& graph, const Ownership& ownership) {
  Graph mine = deal_out(comm, graph, ownership);
  std::vector<idx_t> order;
  agreed(comm, [&] { order = low_fill_order(mine); });
  const std::vector<idx_t> chosen = gather(comm, order);
  const std::vector<int> first = starts_of_pieces(ownership.counts);
  std::vector<PetscInt> numbered;
  numbered.reserve(chosen.size());
  for (const PetscInt vertex : ownership.vertices) {
    const auto rank = static_cast<std::size_t>(ownership.rank_of[static_cast<std::size_t>(vertex)]);
    const PetscInt place = first[rank] + static_cast<PetscInt>(chosen[numbered.size()]);
    numbered.push_back(ownership.vertices[static_cast<std::size_t>(place)]);
  }
  return numbered;
}

/// What a rank owns from now on, in its order, in old numbers.
struct Share {
  std::vector<PetscInt> states, constraints;
  std::vector<PetscInt> block;  // of each of its states
  PetscInt block_count = 0, edge_cut = 0;
};

Share share_out(const LinearSystem& system, const RelativeDegree& relative_degree) {
  const MPI_Comm comm = system.comm();
  int rank = 0;
  int ranks = 1;
  MPI_Comm_rank(comm, &rank);
  MPI_Comm_size(comm, &ranks);
  ElementGraph elements = gather_element_graph(system, relative_degree);
  Cut cut;
  agreed(comm, [&] {
    if (rank == 0) cut = cut_graph(elements.graph, elements.weights(), ranks);
  });
  const Ownership ownership(std::move(cut.part), ranks);
  const std::vector<PetscInt> numbered = number_within_ranks(comm, elements.graph, ownership);

  // States and constraints follow their block.
  const std::vector<PetscInt> number = inverse(numbered);
  const auto rows = [&](const std::vector<PetscInt>& block_of) {
    return sorted_by(picked(number, block_of), number.size());
  };
  const auto counts = [&](const std::vector<PetscInt>& block_of) {
    return shares(picked(ownership.rank_of, block_of), ranks);
  };
  const std::vector<PetscInt> states = rows(elements.block);
  const std::vector<int> state_counts = counts(elements.block);
  Share share;
  share.states = scatter(comm, states, state_counts);
  share.block = scatter(comm, picked(elements.block, states), state_counts);
  share.constraints = scatter(comm, rows(elements.home), counts(elements.home));
  PetscInt sizes[2] = {static_cast<PetscInt>(numbered.size()), cut.edges};
  MPI_Bcast(sizes, 2, MPIU_INT, 0, comm);
  share.block_count = sizes[0];
  share.edge_cut = sizes[1];
  return share;
}

/// The outputs of these constraints, in old numbers; levels and degrees are the constraints' new ones.
std::vector<PetscInt> outputs_of(const RelativeDegree& relative_degree, const RowMove& constraints) {
  const PetscInt first = row_range(relative_degree.Z.get()).first;
  std::vector<PetscInt> first_output;
  for (std::size_t a = 0; a < relative_degree.degree.size(); ++a)
    first_output.push_back(first + relative_degree.first_level[a]);
  first_output = constraints.moved(first_output);
  const std::vector<int> degree = constraints.moved(relative_degree.degree);
  std::vector<PetscInt> outputs;
  for (std::size_t a = 0; a < degree.size(); ++a)
    for (PetscInt i = 0; i < degree[a]; ++i)
      outputs.push_back(first_output[a] + i);
  return outputs;
}

/// Opposite rows follow the constraint they were merged into.
std::vector<OppositeRow> moved(const std::vector<OppositeRow>& opposite, std::size_t constraints,
                               const RowMove& move) {
  std::vector<OppositeRow> of_constraint(constraints, OppositeRow{-1, -1, 1.0, 1.0});
  for (const OppositeRow& row : opposite)
    of_constraint[static_cast<std::size_t>(row.constraint)] = row;
  of_constraint = move.moved(of_constraint);
  for (std::size_t a = 0; a < of_constraint.size(); ++a)
    if (of_constraint[a].constraint >= 0) of_constraint[a].constraint = static_cast<PetscInt>(a);
  std::erase_if(of_constraint, [](const OppositeRow& row) { return row.constraint < 0; });
  return of_constraint;
}

void move_rows(LinearSystem& system, const RowMove& states, const RowMove& constraints) {
  const MPI_Comm comm = system.comm();
  system.A = moved(system.A.get(), states, states);
  system.B = moved(system.B.get(), states, constraints);
  system.C = moved(system.C.get(), constraints, states);
  if (system.D) system.D = moved(system.D.get(), constraints, constraints);
  system.w0 = constraints.moved(system.w0.get());
  if (system.wmax) system.wmax = constraints.moved(system.wmax.get());
  system.opposite = moved(system.opposite, system.constraint_order.size(), constraints);
  system.x0 = states.moved(system.x0.get());
  system.f = moved(comm, system.f, states);
  system.state_order = states.moved(system.state_order);
  system.constraint_order = constraints.moved(system.constraint_order);
}

void move_rows(MPI_Comm comm, PetscInt old_states, RelativeDegree& relative_degree, const RowMove& states,
               const RowMove& constraints, const RowMove& outputs) {
  relative_degree.degree = constraints.moved(relative_degree.degree);
  relative_degree.markov_diagonal = constraints.moved(relative_degree.markov_diagonal);
  relative_degree.first_level.assign(1, 0);
  for (const int degree : relative_degree.degree)
    relative_degree.first_level.push_back(relative_degree.first_level.back() + degree);
  if (relative_degree.has_pivots) {
    const std::vector<PetscInt> pivots = outputs.moved(relative_degree.pivot);
    relative_degree.pivot = RowMove(comm, old_states, pivots).moved(states.new_numbers());
  }
  relative_degree.Z = moved(relative_degree.Z.get(), outputs, states);
  relative_degree.directions = moved(relative_degree.directions.get(), outputs, states);
  relative_degree.markov = moved(relative_degree.markov.get(), constraints, constraints);
}

}  // namespace

void distribute(LinearSystem& system, RelativeDegree& relative_degree) {
  const MPI_Comm comm = system.comm();
  Share share = share_out(system, relative_degree);
  system.edge_cut = share.edge_cut;
  system.block_count = share.block_count;
  system.block = std::move(share.block);

  const PetscInt old_states = row_range(system.A.get()).size();
  const RowMove states(comm, old_states, share.states);
  const RowMove constraints(comm, row_range(system.C.get()).size(), share.constraints);
  if (!states.moves() && !constraints.moves()) return;
  const RowMove outputs(comm, row_range(relative_degree.Z.get()).size(),
                        outputs_of(relative_degree, constraints));
  move_rows(system, states, constraints);
  move_rows(comm, old_states, relative_degree, states, constraints, outputs);
}

}  // namespace sweepvi
