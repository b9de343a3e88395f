#pragma once

#include <metis.h>

#include <cstdint>
#include <span>
#include <vector>

#include "petsc/sparse.hpp"
#include "sweepvi/linear_system.hpp"
#include "sweepvi/relative_degree.hpp"

namespace sweepvi {

/// An undirected graph in compressed rows, in METIS's integers: no loops, each edge seen from both its ends.
struct Graph {
  std::vector<idx_t> starts{0};  ///< one more than there are vertices
  std::vector<idx_t> neighbours;

  idx_t vertices() const { return static_cast<idx_t>(starts.size()) - 1; }
  std::int64_t edges() const { return static_cast<std::int64_t>(neighbours.size()) / 2; }
  std::span<const idx_t> of(idx_t vertex) const {
    const auto v = static_cast<std::size_t>(vertex);
    return std::span(neighbours)
        .subspan(static_cast<std::size_t>(starts[v]), static_cast<std::size_t>(starts[v + 1] - starts[v]));
  }
};

/// Two numbers that belong together.
struct Edge {
  PetscInt first, second;
  bool operator==(const Edge&) const = default;
  bool operator<(const Edge& other) const {
    return first != other.first ? first < other.first : second < other.second;
  }
};

/// The graph of these edges, which may repeat, point either way and be loops.
Graph make_graph(PetscInt vertices, std::vector<Edge> edges);

/// How the elements of a system hang together. Vertices are blocks of states; those that must share a rank
/// (the output states of a constraint) are merged. A nonzero of A between two blocks, or a constraint that
/// reads or pushes both, is an edge.
struct ElementGraph {
  Graph graph;
  std::vector<PetscInt> block;  ///< of each state of the system: its vertex, in the order of first states
  std::vector<PetscInt> home;   ///< of each constraint of the system: the vertex of the state it reads most

  std::vector<idx_t> weights() const;  ///< states of each vertex
};

/// What one rank's rows say about states, in global numbers.
struct Couplings {
  std::vector<PetscInt> homes;  ///< per constraint: the state it lives with
  std::vector<Edge> together;   ///< must share a rank
  std::vector<Edge> edges;      ///< would like to

  /// State pairs in different blocks that a square matrix couples; pairs inside a block of this rank are left
  /// out early. @param block  of each state this rank owns. @note Not collective.
  void add_rows(Mat matrix, const std::vector<PetscInt>& block);
  /// A constraint lives with the state that `read` weighs most, and would like all others near.
  /// @return that state: the first of equals, state 0 for an empty row. @note Not collective.
  PetscInt add_constraint(const SparseRow& read);
};

/// The whole graph on rank 0 (empty elsewhere): METIS is serial.
/// @param block  of each state this rank owns, from 0 to block_count - 1
/// @note Collective.
ElementGraph gather_element_graph(MPI_Comm comm, const Couplings& mine, const std::vector<PetscInt>& block,
                                  PetscInt block_count);

/// The same for a system's rows. @note Collective.
ElementGraph gather_element_graph(const LinearSystem& system, const RelativeDegree& relative_degree);

}  // namespace sweepvi
