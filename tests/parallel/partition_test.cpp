// ranks: 1 2 3 5
// METIS deals systems out; what they mean stays the same.
#include <gtest/gtest.h>

#include <algorithm>

#include "dvi/systems.hpp"
#include "model/chain.hpp"
#include "petsc/sparse.hpp"
#include "sweepvi/partition.hpp"

namespace sweepvi::test {
namespace {

ChainSpec chain(std::int64_t count, bool ring = false) {
  ChainSpec spec = ChainSpec::of(*find_element("jerk"), count);
  spec.topology = ring ? Topology::ring : Topology::chain;
  spec.coupling = 0.5;
  return spec;
}

int ranks() {
  int size = 1;
  MPI_Comm_size(PETSC_COMM_WORLD, &size);
  return size;
}

struct Dealt {
  LinearSystem system;
  RelativeDegree degree;
};

Dealt deal(const ChainSpec& spec) {
  Dealt dealt;
  dealt.system = make_chain(PETSC_COMM_WORLD, spec);
  dealt.degree = analyse_relative_degree(dealt.system);
  distribute(dealt.system, dealt.degree);
  return dealt;
}

std::vector<double> end_state(const Dealt& dealt) {
  const auto dvi =
      make_linear_dvi(dealt.system, dealt.degree, Scheme::homsp, Form::box_on_z, {0.0, 5.0, 100});
  TimeMarch march(*dvi, {0.0, 5.0, 100});
  EXPECT_TRUE(march.run().certified);
  return in_scene_order(dealt.system, everywhere(dvi->x()));
}

TEST(Partition, CutsAChainWhereItIsThin) {
  const Dealt line = deal(chain(60));
  const Dealt ring = deal(chain(60, true));
  // The least possible: one coupling between neighbours in a row of ranks, one more to close the ring.
  EXPECT_EQ(line.system.edge_cut, ranks() - 1);
  EXPECT_EQ(ring.system.edge_cut, ranks() > 1 ? ranks() : 0);
}

TEST(Partition, BalancesElementsAndKeepsThemWhole) {
  const Dealt dealt = deal(chain(60));
  const auto mine = static_cast<double>(dealt.system.constraint_order.size());
  EXPECT_NEAR(mine, 60.0 / ranks(), 3.0);
  EXPECT_EQ(dealt.system.state_order.size(), 5 * dealt.system.constraint_order.size());
  for (std::size_t a = 0; a < dealt.system.constraint_order.size(); ++a)
    for (PetscInt j = 0; j < 5; ++j)
      EXPECT_TRUE(std::binary_search(dealt.system.state_order.begin(), dealt.system.state_order.end(),
                                     5 * dealt.system.constraint_order[a] + j));
}

TEST(Partition, ForcingAndStartsTravelWithTheirStates) {
  ChainSpec spec = chain(7);
  std::vector<Signal>& force = spec.forces[0].values;
  force.clear();
  for (int i = 0; i < 7; ++i)
    force.push_back({0.1 * i, i % 2 == 1 ? 0.5 : 0.0, 1.0, 0.0});
  const Dealt dealt = deal(spec);
  Vector f = duplicate(dealt.system.x0.get());
  dealt.system.f.add_to(f.get(), 0.25, 0, 1.0);  // a quarter period: sin = 1
  const std::vector<double> forces = in_scene_order(dealt.system, everywhere(f.get()));
  for (std::size_t i = 0; i < 7; ++i)
    EXPECT_NEAR(forces[5 * i + 2], 0.1 * static_cast<double>(i) + (i % 2 == 1 ? 0.5 : 0.0), 1e-15) << i;
}

TEST(Partition, TheTrajectoryIsThatOfAPlainLoopOverElements) {
  // Uncoupled elements: each must end where it ends alone.
  ChainSpec spec = chain(6);
  spec.coupling = 0.0;
  const std::vector<double> together = end_state(deal(spec));
  for (std::size_t i = 0; i < 6; ++i) {
    ChainSpec alone = chain(1);
    alone.coupling = 0.0;
    alone.x0 = {0.2 + 0.8 * (0.6180339887498949 * static_cast<double>(i) -
                             std::floor(0.6180339887498949 * static_cast<double>(i))),
                0, 0, 0, 0};
    const std::vector<double> single = end_state(deal(alone));
    for (std::size_t j = 0; j < 5; ++j)
      EXPECT_NEAR(together[5 * i + j], single[j], 1e-12) << i << " " << j;
  }
}

TEST(Partition, MoreRanksThanElementsLeavesSomeEmpty) {
  const Dealt dealt = deal(chain(2));
  const std::vector<double> end = end_state(dealt);
  EXPECT_EQ(end.size(), 10U);
}

}  // namespace
}  // namespace sweepvi::test
