// Sweeps over weakly coupled blocks: they end at the solution of the whole box VI, whatever the blocks' sets,
// and remember nothing from one step to the next.
#include <gtest/gtest.h>

#include <random>

#include "dvi/systems.hpp"
#include "petsc/sparse.hpp"
#include "vi/block_sweeps.hpp"
#include "vi/certificate.hpp"

namespace sweepvi::test {
namespace {

constexpr PetscInt blocks_per_rank = 40;

/// Blocks of `size` unknowns on each rank, with P-matrices on the diagonal; some rows read other blocks, also
/// those of the next rank, `coupling` times as much.
struct Problem {
  Problem(int size, double coupling, unsigned seed, bool equal_blocks = false) {
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
            block_matrix.push_back(i == j ? 1.5 + 0.4 * number(generator) : number(generator) / size);
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

TEST(BlockSweeps, SolveWeaklyCoupledBlocks) {
  for (const int size : {1, 2, 3, 4, 5, 7}) {
    for (const double coupling : {0.0, 1e-6, 1e-2}) {
      for (const bool equal : {false, true}) {
        SCOPED_TRACE(std::to_string(size) + " " + std::to_string(coupling));
        const Problem problem(size, coupling, 7U + static_cast<unsigned>(size), equal);
        const AffineRows rows(problem.K.get());
        BlockSweeps sweeps(PETSC_COMM_WORLD, rows, problem.blocks, Degenerate::undecided);
        ASSERT_TRUE(sweeps.worthwhile());
        ASSERT_TRUE(sweeps.solve(problem.u.get(), problem.u.get(), problem.b.get(), problem.lower.get(),
                                 problem.upper.get()));
        // In the first sweep neighbours are off by the coupling. With 1e-2 some rows switch once they have
        // moved: one solve has to find those.
        EXPECT_LE(problem.ratio(), 2e-13);  // rounding through inverses of condition below 1000
      }
    }
  }
}

TEST(BlockSweeps, RefiningTakesOffWhatIsLeft) {
  const Problem problem(5, 1e-6, 3);
  const AffineRows rows(problem.K.get());
  BlockSweeps sweeps(PETSC_COMM_WORLD, rows, problem.blocks, Degenerate::undecided);
  ASSERT_TRUE(sweeps.solve(problem.u.get(), problem.u.get(), problem.b.get(), problem.lower.get(),
                           problem.upper.get()));
  {
    const WriteArray u(problem.u.get());
    const ReadArray l(problem.lower.get());
    const ReadArray h(problem.upper.get());
    for (PetscInt i = 0; i < u.size(); ++i)
      if (u[i] > l[i] && u[i] < h[i]) u[i] += 1e-9;
  }
  EXPECT_GT(problem.ratio(), 1e-10);
  sweeps.refine(problem.u.get(), problem.f.get());
  EXPECT_LE(problem.ratio(), 1e-14);
}

// What they find is that of the step and its guess: a run that is taken up again gives the same bits.
TEST(BlockSweeps, RememberNothing) {
  const Problem one(4, 1e-3, 11);
  const Problem other(4, 1e-3, 12);
  const AffineRows rows(one.K.get());
  BlockSweeps fresh(PETSC_COMM_WORLD, rows, one.blocks, Degenerate::at_bound);
  BlockSweeps used(PETSC_COMM_WORLD, rows, one.blocks, Degenerate::at_bound);
  const Vector guess = duplicate(one.u.get());
  check(VecCopy(one.u.get(), guess.get()));
  used.solve(other.u.get(), other.u.get(), other.b.get(), other.lower.get(), other.upper.get());
  ASSERT_TRUE(fresh.solve(one.u.get(), one.u.get(), one.b.get(), one.lower.get(), one.upper.get()));
  ASSERT_TRUE(used.solve(guess.get(), guess.get(), one.b.get(), one.lower.get(), one.upper.get()));
  EXPECT_EQ(everywhere(one.u.get()), everywhere(guess.get()));
}

// Not where blocks read each other as strongly as themselves, nor where a block is singular or large.
TEST(BlockSweeps, KnowWhereTheyAreOfNoUse) {
  const Problem strong(3, 2.0, 5);
  EXPECT_FALSE(BlockSweeps(PETSC_COMM_WORLD, AffineRows(strong.K.get()), strong.blocks, Degenerate::undecided)
                   .worthwhile());
  const Problem weak(3, 1e-3, 5);
  const std::vector<PetscInt> one_block(weak.blocks.size(), 0);
  EXPECT_FALSE(
      BlockSweeps(PETSC_COMM_WORLD, AffineRows(weak.K.get()), one_block, Degenerate::undecided).worthwhile());
  const Problem singular(2, 1e-3, 5);
  int rank = 0;
  MPI_Comm_rank(PETSC_COMM_WORLD, &rank);
  const PetscInt row = row_range(singular.K.get()).first;
  if (rank == 0)
    for (PetscInt column = row; column < row + 2; ++column)
      check(MatSetValue(singular.K.get(), row, column, 0.0, INSERT_VALUES));
  check(MatAssemblyBegin(singular.K.get(), MAT_FINAL_ASSEMBLY));
  check(MatAssemblyEnd(singular.K.get(), MAT_FINAL_ASSEMBLY));
  EXPECT_FALSE(
      BlockSweeps(PETSC_COMM_WORLD, AffineRows(singular.K.get()), singular.blocks, Degenerate::undecided)
          .worthwhile());
}

}  // namespace
}  // namespace sweepvi::test
