// ranks: 1 2 3
// Elements are numbered for low fill within their rank, whatever order they came in; what the system means
// stays the same.
#include <gtest/gtest.h>

#include <random>
#include <set>

#include "dvi/systems.hpp"
#include "parallel/network.hpp"
#include "parallel/numbering.hpp"
#include "sweepvi/partition.hpp"

namespace sweepvi::test {
namespace {

struct Dealt {
  LinearSystem system;
  RelativeDegree degree;
};

Dealt deal(MPI_Comm comm, const Network& network, const std::vector<PetscInt>& number) {
  Dealt dealt;
  dealt.system = masses(comm, network, number);
  dealt.degree = analyse_relative_degree(dealt.system);
  distribute(dealt.system, dealt.degree);
  return dealt;
}

/// Nonzeros of PETSc's LU factors of I - A / 10, rows in this order.
double factor_nonzeros_of(Mat A, const char* ordering = MATORDERINGNATURAL) {
  Matrix K;
  check(MatDuplicate(A, MAT_COPY_VALUES, K.put()));
  check(MatScale(K.get(), -0.1));
  check(MatShift(K.get(), 1.0));
  IndexSet rows, columns;
  check(MatGetOrdering(K.get(), ordering, rows.put(), columns.put()));
  Matrix factors;
  check(MatGetFactor(K.get(), MATSOLVERPETSC, MAT_FACTOR_LU, factors.put()));
  MatFactorInfo options;
  check(MatFactorInfoInitialize(&options));
  check(MatLUFactorSymbolic(factors.get(), K.get(), rows.get(), columns.get(), &options));
  MatInfo info;
  check(MatGetInfo(factors.get(), MAT_LOCAL, &info));
  return info.nz_used;
}

/// The same with elements in METIS's own nested dissection of the network.
double factor_nonzeros_by_metis(const Network& network) {
  Graph graph = network.graph();
  idx_t vertices = graph.vertices();
  std::vector<idx_t> order(static_cast<std::size_t>(vertices));
  std::vector<idx_t> number(order.size());
  EXPECT_EQ(METIS_NodeND(&vertices, graph.starts.data(), graph.neighbours.data(), nullptr, nullptr,
                         order.data(), number.data()),
            METIS_OK);
  const LinearSystem system =
      masses(PETSC_COMM_SELF, network, std::vector<PetscInt>(number.begin(), number.end()));
  return factor_nonzeros_of(system.A.get());
}

TEST(Numbering, AChainKeepsItsOrder) {
  const Dealt dealt = deal(PETSC_COMM_SELF, chain_network(100), in_order(100));
  EXPECT_EQ(dealt.system.state_order, in_order(200));
  EXPECT_EQ(dealt.system.constraint_order, in_order(100));
}

TEST(Numbering, AShuffledChainFillsInNoMoreThanAnOrderedOne) {
  const Network network = chain_network(1000);
  const Dealt ordered = deal(PETSC_COMM_SELF, network, in_order(1000));
  const LinearSystem disordered = masses(PETSC_COMM_SELF, network, shuffled(1000));
  const Dealt numbered = deal(PETSC_COMM_SELF, network, shuffled(1000));
  EXPECT_EQ(factor_nonzeros_of(numbered.system.A.get()), factor_nonzeros_of(ordered.system.A.get()));
  EXPECT_GT(factor_nonzeros_of(disordered.A.get()), 1.2 * factor_nonzeros_of(ordered.system.A.get()));
}

TEST(Numbering, ALatticeFillsInAsLittleAsByMetisInAnyOrder) {
  const Network network = lattice_network(100);
  const double metis = factor_nonzeros_by_metis(network);
  const Dealt ordered = deal(PETSC_COMM_SELF, network, in_order(network.sites));
  const Dealt disordered = deal(PETSC_COMM_SELF, network, shuffled(network.sites));
  EXPECT_LE(factor_nonzeros_of(ordered.system.A.get()), 1.5 * metis);
  EXPECT_LE(factor_nonzeros_of(disordered.system.A.get()), 1.5 * metis);
}

TEST(Numbering, EachRankNumbersItsOwnElements) {
  const Network network = lattice_network(60);
  const Dealt dealt = deal(PETSC_COMM_WORLD, network, shuffled(network.sites));
  Mat own = nullptr;
  check(MatGetDiagonalBlock(dealt.system.A.get(), &own));
  EXPECT_LE(factor_nonzeros_of(own), factor_nonzeros_of(own, MATORDERINGRCM));
}

/// Nonzeros below the diagonal by elimination, one vertex after the other.
std::int64_t factor_nonzeros_by_elimination(const Graph& graph, const std::vector<idx_t>& order) {
  const auto at = [](idx_t i) { return static_cast<std::size_t>(i); };
  std::vector<std::set<idx_t>> left(at(graph.vertices()));
  for (idx_t v = 0; v < graph.vertices(); ++v)
    left[at(v)].insert(graph.of(v).begin(), graph.of(v).end());
  std::int64_t count = 0;
  for (const idx_t v : order) {
    count += static_cast<std::int64_t>(left[at(v)].size());
    for (const idx_t neighbour : left[at(v)]) {
      left[at(neighbour)].insert(left[at(v)].begin(), left[at(v)].end());
      left[at(neighbour)].erase(neighbour);
      left[at(neighbour)].erase(v);
    }
  }
  return count;
}

TEST(FactorNonzeros, AreThoseOfAnElimination) {
  std::mt19937 random(3);
  for (PetscInt vertices = 0; vertices < 60; ++vertices) {
    std::vector<Edge> edges;  // sparse ones fall into pieces
    for (PetscInt k = 0; k < 3 * vertices / 2; ++k)
      edges.push_back({static_cast<PetscInt>(random() % static_cast<unsigned>(vertices)),
                       static_cast<PetscInt>(random() % static_cast<unsigned>(vertices))});
    const Graph graph = make_graph(vertices, edges);
    const std::vector<PetscInt> order = shuffled(vertices);
    const std::vector<idx_t> as_metis(order.begin(), order.end());
    EXPECT_EQ(factor_nonzeros(graph, as_metis), factor_nonzeros_by_elimination(graph, as_metis)) << vertices;
  }
}

/// States at t = 2, site by site.
std::vector<double> end_state(const Network& network, const std::vector<PetscInt>& number, Form form) {
  const Dealt dealt = deal(PETSC_COMM_WORLD, network, number);
  const TimeGrid time{0.0, 2.0, 40};
  const auto dvi = make_linear_dvi(dealt.system, dealt.degree, Scheme::homsp, form, time);
  TimeMarch march(*dvi, time);
  EXPECT_TRUE(march.run().certified);
  const std::vector<double> states = in_scene_order(dealt.system, everywhere(dvi->x()));
  std::vector<double> by_site;
  for (const PetscInt element : number) {
    const auto first = states.begin() + 2 * element;
    by_site.insert(by_site.end(), first, first + 2);
  }
  return by_site;
}

void expect_equal_runs(const Network& network, Form form) {
  const std::vector<double> ordered = end_state(network, in_order(network.sites), form);
  const std::vector<double> disordered = end_state(network, shuffled(network.sites), form);
  ASSERT_EQ(ordered.size(), disordered.size());
  for (std::size_t i = 0; i < ordered.size(); ++i)
    EXPECT_NEAR(ordered[i], disordered[i], 1e-10) << i;
}

TEST(Numbering, LeavesTheMotionAlone) {
  expect_equal_runs(chain_network(40), Form::box_on_z);
  expect_equal_runs(chain_network(40), Form::primal_dual);
  expect_equal_runs(lattice_network(8), Form::box_on_z);
}

}  // namespace
}  // namespace sweepvi::test
