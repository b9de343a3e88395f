// ranks: 1 2 3
// Connected components of distributed matrices, against those of the whole graph.
#include "parallel/components.hpp"

#include <gtest/gtest.h>

#include <numeric>
#include <random>

#include "parallel/gather.hpp"

namespace sweepvi::test {
namespace {

/// n vertices and these edges, some of them one-way; rows are dealt out in order.
Matrix graph(PetscInt n, const std::vector<std::pair<PetscInt, PetscInt>>& edges) {
  PetscInt local = PETSC_DECIDE;
  check(PetscSplitOwnership(PETSC_COMM_WORLD, &local, &n));
  PetscInt last = 0;
  MPI_Scan(&local, &last, 1, MPIU_INT, MPI_SUM, PETSC_COMM_WORLD);
  RowBuilder rows;
  for (PetscInt row = last - local; row < last; ++row) {
    rows.add(row, 0.0);
    for (const auto& [from, to] : edges)
      if (from == row) rows.add(to, 1.0);
    rows.end_row();
  }
  return rows.finish(PETSC_COMM_WORLD, local);
}

/// The smallest vertex of each vertex's component.
std::vector<PetscInt> smallest(PetscInt n, const std::vector<std::pair<PetscInt, PetscInt>>& edges) {
  std::vector<PetscInt> label(static_cast<std::size_t>(n));
  std::iota(label.begin(), label.end(), 0);
  for (PetscInt round = 0; round < n; ++round)
    for (const auto& [from, to] : edges) {
      PetscInt& a = label[static_cast<std::size_t>(from)];
      PetscInt& b = label[static_cast<std::size_t>(to)];
      a = b = std::min(a, b);
    }
  return label;
}

// The sum of 1 over a component is its size, on each rank that knows it; rows of a rank are told apart as the
// whole graph does.
void expect_components(PetscInt n, const std::vector<std::pair<PetscInt, PetscInt>>& edges) {
  const Matrix matrix = graph(n, edges);
  const LocalRange rows = row_range(matrix.get());
  const Components components(matrix.get());
  const std::vector<PetscInt> expected = smallest(n, edges);
  std::vector<double> sizes(components.count() + 1, 0.0);
  for (PetscInt row = 0; row < rows.size(); ++row) {
    ASSERT_LT(components.of(row), components.count());
    sizes[components.of(row)] += 1.0;
  }
  sizes.back() = static_cast<double>(rows.size());
  components.sum(sizes);
  EXPECT_EQ(sizes.back(), static_cast<double>(n));
  for (PetscInt row = 0; row < rows.size(); ++row) {
    const PetscInt label = expected[static_cast<std::size_t>(rows.first + row)];
    EXPECT_EQ(sizes[components.of(row)],
              static_cast<double>(std::count(expected.begin(), expected.end(), label)));
    for (PetscInt other = 0; other < row; ++other)
      EXPECT_EQ(components.of(row) == components.of(other),
                label == expected[static_cast<std::size_t>(rows.first + other)]);
  }
}

TEST(Components, ExtremesAndChains) {
  expect_components(1, {});
  expect_components(7, {});
  expect_components(5, {{4, 0}, {1, 3}});
  std::vector<std::pair<PetscInt, PetscInt>> chain;
  for (PetscInt i = 0; i + 1 < 40; ++i)
    chain.emplace_back(i + 1, i);
  expect_components(40, chain);
  expect_components(2, {{0, 1}});  // some ranks own nothing
}

TEST(Components, RandomGraphs) {
  std::mt19937 random(5);
  for (const PetscInt edges : {5, 10, 15, 20, 30, 60}) {
    std::vector<std::pair<PetscInt, PetscInt>> list;
    for (PetscInt k = 0; k < edges; ++k)
      list.emplace_back(random() % 30, random() % 30);
    expect_components(30, list);
  }
}

}  // namespace
}  // namespace sweepvi::test
