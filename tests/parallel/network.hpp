#pragma once

#include <algorithm>
#include <numeric>
#include <random>
#include <vector>

#include "parallel/element_graph.hpp"
#include "petsc/sparse.hpp"
#include "sweepvi/linear_system.hpp"

namespace sweepvi::test {

/// Sites and which of them are neighbours.
struct Network {
  PetscInt sites = 0;
  std::vector<Edge> edges;

  Graph graph() const { return make_graph(sites, edges); }
};

inline Network chain_network(PetscInt sites) {
  Network network{sites, {}};
  for (PetscInt i = 1; i < sites; ++i)
    network.edges.push_back({i - 1, i});
  return network;
}

/// side x side sites, each with up to four neighbours.
inline Network lattice_network(PetscInt side) {
  Network network{side * side, {}};
  for (PetscInt site = 0; site < network.sites; ++site) {
    if (site % side > 0) network.edges.push_back({site - 1, site});
    if (site >= side) network.edges.push_back({site - side, site});
  }
  return network;
}

inline std::vector<PetscInt> in_order(PetscInt count) {
  std::vector<PetscInt> number(static_cast<std::size_t>(count));
  std::iota(number.begin(), number.end(), 0);
  return number;
}

/// The same permutation on every rank and machine.
inline std::vector<PetscInt> shuffled(PetscInt count) {
  std::vector<PetscInt> number = in_order(count);
  std::mt19937 random(1);
  for (std::size_t i = number.size(); i > 1; --i)
    std::swap(number[i - 1], number[random() % i]);
  return number;
}

/// A mass at each site, above a floor of its own and tied to its neighbours by springs; site s is element
/// number[s], and all that sets sites apart follows s:
///
///     q' = v,  v' = -q - v / 2 + sum (q_j - q) - s / sites + lambda,  w = q + s / (2 sites) >= 0.
inline LinearSystem masses(MPI_Comm comm, const Network& network, const std::vector<PetscInt>& number) {
  std::vector<PetscInt> site_of(number.size());
  for (std::size_t site = 0; site < number.size(); ++site)
    site_of[static_cast<std::size_t>(number[site])] = static_cast<PetscInt>(site);
  const Graph graph = network.graph();
  PetscInt sites = network.sites;
  PetscInt mine = PETSC_DECIDE;
  check(PetscSplitOwnership(comm, &mine, &sites));
  PetscInt last = 0;
  MPI_Scan(&mine, &last, 1, MPIU_INT, MPI_SUM, comm);
  const PetscInt first = last - mine;

  LinearSystem system;
  RowBuilder A, B, C;
  std::vector<Signal> forces(2 * number.size());
  std::vector<double> x0, w0;
  for (PetscInt i = first; i < last; ++i) {
    const PetscInt site = site_of[static_cast<std::size_t>(i)];
    const double place = static_cast<double>(site) / static_cast<double>(sites);
    A.add(2 * i, 0.0);
    A.add(2 * i + 1, 1.0);
    A.end_row();
    A.add(2 * i, -1.0);
    A.add(2 * i + 1, -0.5);
    for (const idx_t neighbour : graph.of(static_cast<idx_t>(site))) {
      A.add(2 * i, -1.0);
      A.add(2 * number[static_cast<std::size_t>(neighbour)], 1.0);
    }
    A.end_row();
    B.end_row();
    B.add(i, 1.0);
    B.end_row();
    C.add(2 * i, 1.0);
    C.end_row();
    forces[static_cast<std::size_t>(2 * i + 1)] = {-place, 0.0, 0.0, 0.0};
    x0.insert(x0.end(), {1.0 + place, -place});
    w0.push_back(0.5 * place);
    system.block.insert(system.block.end(), {i, i});
    system.state_order.insert(system.state_order.end(), {2 * i, 2 * i + 1});
    system.constraint_order.push_back(i);
  }
  system.A = A.finish(comm, 2 * mine);
  system.B = B.finish(comm, mine);
  system.C = C.finish(comm, 2 * mine);
  system.f = Forcing::from(forces, 2 * first, 2 * last);
  system.x0 = make_vector(comm, 2 * mine);
  system.w0 = make_vector(comm, mine);
  std::copy(x0.begin(), x0.end(), WriteArray(system.x0.get()).data());
  std::copy(w0.begin(), w0.end(), WriteArray(system.w0.get()).data());
  system.block_count = sites;
  return system;
}

}  // namespace sweepvi::test
