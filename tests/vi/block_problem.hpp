#pragma once

#include <gtest/gtest.h>

#include <random>

#include "petsc/affine_rows.hpp"
#include "petsc/sparse.hpp"
#include "vi/certificate.hpp"
#include "vi/natural_residual.hpp"

namespace sweepvi::test {

inline constexpr PetscInt blocks_per_rank = 40;

/// Blocks of `size` unknowns on each rank, with P-matrices on the diagonal, off whose diagonals entries are
/// up to `own` over the size; some rows read other blocks, also those of the next rank, `coupling` times as
/// much.
struct BlockProblem {
  BlockProblem(int size, double coupling, unsigned seed, bool equal_blocks = false, double own = 1.0) {
    int rank = 0;
    int ranks = 1;
    MPI_Comm_rank(PETSC_COMM_WORLD, &rank);
    MPI_Comm_size(PETSC_COMM_WORLD, &ranks);
    std::mt19937 generator(seed + 100U * static_cast<unsigned>(rank));
    std::uniform_real_distribution<double> number(-1.0, 1.0);
    const PetscInt local = size * blocks_per_rank;
    const PetscInt first = rank * local;
    const PetscInt all = ranks * local;
    std::vector<double> block_matrix;
    RowBuilder rows;
    for (PetscInt e = 0; e < blocks_per_rank; ++e) {
      if (e == 0 || !equal_blocks) {
        block_matrix.clear();
        for (int i = 0; i < size; ++i)
          for (int j = 0; j < size; ++j)  // diagonally dominant, hence a P-matrix
            block_matrix.push_back(i == j ? 1.5 + 0.4 * number(generator) : own * number(generator) / size);
      }
      for (int i = 0; i < size; ++i) {
        const PetscInt row = first + e * size + i;
        for (int j = 0; j < size; ++j)
          rows.add(first + e * size + j, block_matrix[static_cast<std::size_t>(i * size + j)]);
        if (i % 2 == 0) {
          rows.add((row + size) % all, coupling * number(generator));
          rows.add((row - size + all) % all, coupling * number(generator));
        }
        rows.end_row();
        blocks.push_back(first / size + e);
      }
    }
    K = rows.finish(PETSC_COMM_WORLD, local);
    for (Vector* vector : {&b, &lower, &upper, &u, &f, &terms})
      *vector = make_vector(PETSC_COMM_WORLD, local);
    const WriteArray right(b.get());
    const WriteArray l(lower.get());
    const WriteArray h(upper.get());
    const WriteArray guess(u.get());
    for (PetscInt i = 0; i < local; ++i) {
      right[i] = number(generator);
      guess[i] = number(generator);
      const double kind = number(generator);
      l[i] = kind < 0.3 ? 0.1 * number(generator) - 0.2 : PETSC_NINFINITY;
      h[i] = kind > -0.3 && kind < 0.6 ? 0.1 * number(generator) + 0.2 : PETSC_INFINITY;
    }
  }

  /// Worst natural residual over the terms of its row at u.
  double ratio() const {
    const AffineRows rows(K.get());
    const Vector sizes = duplicate(b.get());
    check(VecCopy(b.get(), sizes.get()));
    check(VecAbs(sizes.get()));
    rows.evaluate(u.get(), b.get(), sizes.get(), f.get(), terms.get());
    // By PETSc, for AffineRows itself.
    const Vector plain = duplicate(b.get());
    check(MatMult(K.get(), u.get(), plain.get()));
    check(VecAXPY(plain.get(), -1.0, b.get()));
    double worst = 0.0;
    const ReadArray x(u.get());
    const ReadArray value(f.get());
    const ReadArray other(plain.get());
    const ReadArray l(lower.get());
    const ReadArray h(upper.get());
    const ReadArray size(terms.get());
    for (PetscInt i = 0; i < x.size(); ++i) {
      EXPECT_LE(std::abs(value[i] - other[i]), 1e-15 * size[i]);
      worst = std::max(worst, std::abs(natural_residual(x[i], value[i], l[i], h[i])) / size[i]);
    }
    MPI_Allreduce(MPI_IN_PLACE, &worst, 1, MPI_DOUBLE, MPI_MAX, PETSC_COMM_WORLD);
    return worst;
  }

  Matrix K;
  std::vector<PetscInt> blocks;
  Vector b, lower, upper, u, f, terms;
};

}  // namespace sweepvi::test
