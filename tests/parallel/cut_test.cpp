// ranks: 2 3 5
// A lattice in random order is cut as well as METIS cuts it, and far better than at random.
#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "parallel/network.hpp"
#include "sweepvi/partition.hpp"

namespace sweepvi::test {
namespace {

constexpr PetscInt side = 300;

int ranks() {
  int size = 1;
  MPI_Comm_size(PETSC_COMM_WORLD, &size);
  return size;
}

/// Edges of a graph whose ends are in different parts.
template <class Part>
PetscInt cut_edges(const Network& network, const std::vector<Part>& part) {
  return static_cast<PetscInt>(
      std::count_if(network.edges.begin(), network.edges.end(), [&](const Edge& edge) {
        return part[static_cast<std::size_t>(edge.first)] != part[static_cast<std::size_t>(edge.second)];
      }));
}

PetscInt cut_at_random(const Network& network) {
  std::mt19937 random(2);
  std::vector<unsigned> part(static_cast<std::size_t>(network.sites));
  for (unsigned& p : part)
    p = static_cast<unsigned>(random()) % static_cast<unsigned>(ranks());
  return cut_edges(network, part);
}

/// METIS as it comes, on the lattice in its natural order.
PetscInt cut_by_metis(const Network& network, decltype(&METIS_PartGraphKway) partition) {
  Graph graph = network.graph();
  idx_t vertices = graph.vertices();
  idx_t balances = 1;
  idx_t parts = ranks();
  idx_t cut = 0;
  std::vector<idx_t> part(static_cast<std::size_t>(vertices));
  EXPECT_EQ(partition(&vertices, &balances, graph.starts.data(), graph.neighbours.data(), nullptr, nullptr,
                      nullptr, &parts, nullptr, nullptr, nullptr, &cut, part.data()),
            METIS_OK);
  EXPECT_EQ(cut, cut_edges(network, part));
  return static_cast<PetscInt>(cut);
}

TEST(Cut, OfAShuffledLatticeIsAsGoodAsMetis) {
  const Network network = lattice_network(side);
  LinearSystem system = masses(PETSC_COMM_WORLD, network, shuffled(network.sites));
  RelativeDegree degree = analyse_relative_degree(system);
  distribute(system, degree);

  const PetscInt by_chance = cut_at_random(network);
  const PetscInt recursive = cut_by_metis(network, METIS_PartGraphRecursive);
  const PetscInt k_way = cut_by_metis(network, METIS_PartGraphKway);
  EXPECT_LE(20 * system.edge_cut, by_chance);
  EXPECT_LE(10 * system.edge_cut, 11 * recursive);
  EXPECT_LE(10 * system.edge_cut, 11 * k_way);
  // METIS allows parts 3 % above the mean.
  const double mean = static_cast<double>(network.sites) / ranks();
  EXPECT_LE(static_cast<double>(system.constraint_order.size()), 1.03 * mean + 1.0);
}

// What is reported is what the matrix shows: pairs of elements on different ranks that A couples.
TEST(Cut, CountsTheElementPairsThatAreApart) {
  const Network network = lattice_network(20);
  LinearSystem system = masses(PETSC_COMM_WORLD, network, shuffled(network.sites));
  RelativeDegree degree = analyse_relative_degree(system);
  distribute(system, degree);
  const LocalRange states = row_range(system.A.get());
  PetscInt seen = 0;
  for_each_row(system.A.get(), [&](PetscInt, auto columns, auto) {
    for (const PetscInt column : columns)
      if (!states.contains(column)) ++seen;
  });
  MPI_Allreduce(MPI_IN_PLACE, &seen, 1, MPIU_INT, MPI_SUM, PETSC_COMM_WORLD);
  EXPECT_EQ(seen, 2 * system.edge_cut);  // each pair from both sides
}

}  // namespace
}  // namespace sweepvi::test
