#include "parallel/element_graph.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <string>
#include <utility>

#include "parallel/gather.hpp"

namespace sweepvi {

Graph make_graph(PetscInt vertices, std::vector<Edge> edges) {
  std::erase_if(edges, [](const Edge& edge) { return edge.first == edge.second; });
  const std::size_t one_way = edges.size();
  edges.reserve(2 * one_way);
  for (std::size_t i = 0; i < one_way; ++i)
    edges.push_back({edges[i].second, edges[i].first});
  std::sort(edges.begin(), edges.end());
  edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
  if (edges.size() > static_cast<std::size_t>(std::numeric_limits<idx_t>::max()))
    throw Error(ExitCode::internal,
                std::to_string(edges.size() / 2) +
                    " couplings between elements are more than METIS counts; the scene is too large");

  Graph graph;
  graph.starts.assign(static_cast<std::size_t>(vertices) + 1, 0);
  graph.neighbours.reserve(edges.size());
  for (const Edge& edge : edges) {
    ++graph.starts[static_cast<std::size_t>(edge.first) + 1];
    graph.neighbours.push_back(static_cast<idx_t>(edge.second));
  }
  std::partial_sum(graph.starts.begin(), graph.starts.end(), graph.starts.begin());
  return graph;
}

std::vector<idx_t> ElementGraph::weights() const {
  std::vector<idx_t> weights(static_cast<std::size_t>(graph.vertices()), 0);
  for (const PetscInt b : block)
    ++weights[static_cast<std::size_t>(b)];
  return weights;
}

void Couplings::add_rows(Mat matrix, const std::vector<PetscInt>& block) {
  const LocalRange states = row_range(matrix);
  const auto block_of = [&](PetscInt state) { return block[static_cast<std::size_t>(state - states.first)]; };
  for_each_row(matrix, [&](PetscInt row, auto columns, auto values) {
    for (std::size_t k = 0; k < columns.size(); ++k) {
      const PetscInt column = columns[k];
      if (values[k] == 0.0 || column == row) continue;
      if (states.contains(column) && block_of(column) == block_of(row)) continue;
      edges.push_back({row, column});
    }
  });
}

PetscInt Couplings::add_constraint(const SparseRow& read) {
  PetscInt home = 0;
  double most = -1.0;
  for (const auto& [state, value] : read)
    if (std::abs(value) > most) {
      most = std::abs(value);
      home = state;
    }
  homes.push_back(home);
  for (const auto& [state, value] : read)
    if (state != home && value != 0.0) edges.push_back({home, state});
  return home;
}

namespace {

/// Where each owned constraint lives, and the states it must share a rank with (its outputs) or would like
/// to.
void add_constraints(const LinearSystem& system, const RelativeDegree& relative_degree,
                     Couplings& couplings) {
  const Matrix pushed = transpose(system.B.get());
  const LocalRange constraints = row_range(system.C.get());
  const LocalRange outputs = row_range(relative_degree.Z.get());
  for (PetscInt a = constraints.first; a < constraints.last; ++a) {
    const PetscInt home = couplings.add_constraint(get_row(system.C.get(), a));
    const auto local = static_cast<std::size_t>(a - constraints.first);
    // Outputs that are states, or take the place of one, stay with their constraint: box on z relies on it,
    // primal-dual saves messages.
    for (PetscInt q = relative_degree.first_level[local]; q < relative_degree.first_level[local + 1]; ++q) {
      if (relative_degree.has_pivots)
        couplings.together.push_back({home, relative_degree.pivot[static_cast<std::size_t>(q)]});
      const SparseRow output = get_row(relative_degree.Z.get(), outputs.first + q);
      if (output.size() == 1) couplings.together.push_back({home, output.front().first});
    }
    for (const auto& [state, value] : get_row(pushed.get(), a))
      if (state != home && value != 0.0) couplings.edges.push_back({home, state});
  }
}

/// Merges blocks that must stay together; returns the number of blocks left.
PetscInt merge_blocks(std::vector<PetscInt>& block, PetscInt block_count, const std::vector<Edge>& together) {
  std::vector<PetscInt> parent(static_cast<std::size_t>(block_count));
  std::iota(parent.begin(), parent.end(), 0);
  const auto root = [&](PetscInt i) {
    while (parent[static_cast<std::size_t>(i)] != i)
      i = parent[static_cast<std::size_t>(i)] =
          parent[static_cast<std::size_t>(parent[static_cast<std::size_t>(i)])];
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

}  // namespace

ElementGraph gather_element_graph(MPI_Comm comm, const Couplings& mine, const std::vector<PetscInt>& block,
                                  PetscInt block_count) {
  const std::vector<Edge> together = gather(comm, mine.together);
  std::vector<Edge> edges = gather(comm, mine.edges);
  ElementGraph elements;
  elements.block = gather(comm, block);
  elements.home = gather(comm, mine.homes);
  int rank = 0;
  MPI_Comm_rank(comm, &rank);
  if (rank != 0) return elements;

  const PetscInt blocks = merge_blocks(elements.block, block_count, together);
  const auto vertex = [&](PetscInt state) { return elements.block[static_cast<std::size_t>(state)]; };
  for (Edge& edge : edges)
    edge = {vertex(edge.first), vertex(edge.second)};
  for (PetscInt& home : elements.home)
    home = vertex(home);
  elements.graph = make_graph(blocks, std::move(edges));
  return elements;
}

ElementGraph gather_element_graph(const LinearSystem& system, const RelativeDegree& relative_degree) {
  Couplings mine;
  mine.add_rows(system.A.get(), system.block);
  add_constraints(system, relative_degree, mine);
  return gather_element_graph(system.comm(), mine, system.block, system.block_count);
}

}  // namespace sweepvi
