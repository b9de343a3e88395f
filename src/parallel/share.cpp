#include "parallel/share.hpp"

#include <numeric>
#include <utility>

#include "parallel/cut.hpp"
#include "parallel/gather.hpp"
#include "parallel/numbering.hpp"

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

}  // namespace

Share share_out(MPI_Comm comm, ElementGraph elements) {
  int rank = 0;
  int ranks = 1;
  MPI_Comm_rank(comm, &rank);
  MPI_Comm_size(comm, &ranks);
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

}  // namespace sweepvi
