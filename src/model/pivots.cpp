#include "model/pivots.hpp"

#include <cmath>

#include "petsc/sparse.hpp"

namespace sweepvi {

namespace {

constexpr double smallest_pivot = 1e-4;  // relative to its row: a smaller one would amplify rounding

bool markov_is_diagonal(const RelativeDegree& relative_degree) {
  int diagonal = 1;
  for_each_row(relative_degree.markov.get(), [&](PetscInt row, auto columns, auto) {
    for (const PetscInt column : columns)
      if (column != row) diagonal = 0;
  });
  MPI_Allreduce(MPI_IN_PLACE, &diagonal, 1, MPI_INT, MPI_LAND,
                PetscObjectComm(reinterpret_cast<PetscObject>(relative_degree.markov.get())));
  return diagonal != 0;
}

/// What an output reads: 1 for each state that can be its pivot, `too_small` for the others.
Matrix reads_of(const RelativeDegree& relative_degree, PetscInt local_states, double too_small) {
  RowBuilder rows;
  for_each_row(relative_degree.Z.get(), [&](PetscInt, auto columns, auto values) {
    double largest = 0.0;
    for (const double value : values)
      largest = std::max(largest, std::abs(value));
    for (std::size_t k = 0; k < columns.size(); ++k)
      if (values[k] != 0.0)
        rows.add(columns[k], std::abs(values[k]) >= smallest_pivot * largest ? 1.0 : too_small);
    rows.end_row();
  });
  return rows.finish(PetscObjectComm(reinterpret_cast<PetscObject>(relative_degree.Z.get())), local_states);
}

}  // namespace

void find_pivots(const LinearSystem& system, RelativeDegree& relative_degree) {
  relative_degree.pivot.clear();
  relative_degree.has_pivots = false;
  if (relative_degree.lowest < 1 || !markov_is_diagonal(relative_degree)) return;

  const LocalRange states = row_range(system.A.get());
  const Matrix reads = reads_of(relative_degree, states.size(), 2.0);
  Vector unknown;        // 1 for each state not yet known
  Vector unknown_index;  // its number
  Vector count;
  Vector index_sum;  // the number of the only unknown state, where count is 1
  check(MatCreateVecs(reads.get(), unknown.put(), count.put()));
  unknown_index = duplicate(unknown.get());
  index_sum = duplicate(count.get());
  Vector claims = duplicate(unknown.get());
  check(VecSet(unknown.get(), 1.0));

  std::vector<PetscInt> pivot(static_cast<std::size_t>(row_range(reads.get()).size()), -1);
  PetscInt open = relative_degree.outputs;
  for (int round = 0; round < relative_degree.highest && open > 0; ++round) {
    {
      const ReadArray is_unknown(unknown.get());
      const WriteArray index(unknown_index.get());
      for (PetscInt i = 0; i < index.size(); ++i)
        index[i] = is_unknown[i] * static_cast<double>(states.first + i);
    }
    check(MatMult(reads.get(), unknown.get(), count.get()));
    check(MatMult(reads.get(), unknown_index.get(), index_sum.get()));
    check(VecSet(claims.get(), 0.0));
    {
      const ReadArray counts(count.get());
      const ReadArray sums(index_sum.get());
      for (std::size_t q = 0; q < pivot.size(); ++q) {
        const auto local = static_cast<PetscInt>(q);
        if (pivot[q] >= 0 || counts[local] != 1.0) continue;
        pivot[q] = static_cast<PetscInt>(sums[local]);
        check(VecSetValue(claims.get(), pivot[q], 1.0, ADD_VALUES));
      }
    }
    check(VecAssemblyBegin(claims.get()));
    check(VecAssemblyEnd(claims.get()));
    double most = 0.0;
    double found = 0.0;
    check(VecNorm(claims.get(), NORM_INFINITY, &most));
    check(VecSum(claims.get(), &found));
    if (found == 0.0 || most > 1.0) return;  // all outputs mix several states, or two are the same
    check(VecAXPY(unknown.get(), -1.0, claims.get()));
    open -= static_cast<PetscInt>(found);
  }
  if (open > 0) return;
  relative_degree.pivot = std::move(pivot);
  relative_degree.has_pivots = true;
}

}  // namespace sweepvi
