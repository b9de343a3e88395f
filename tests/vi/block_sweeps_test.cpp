// ranks: 1 2 3
// Sweeps over weakly coupled blocks: they end at the solution of the whole box VI, whatever the blocks' sets,
// and remember nothing from one step to the next.
#include <gtest/gtest.h>

#include "dvi/systems.hpp"
#include "vi/block_problem.hpp"
#include "vi/block_sweeps.hpp"

namespace sweepvi::test {
namespace {

TEST(BlockSweeps, SolveWeaklyCoupledBlocks) {
  for (const int size : {1, 2, 3, 4, 5, 7}) {
    for (const double coupling : {0.0, 1e-6, 1e-2}) {
      for (const bool equal : {false, true}) {
        SCOPED_TRACE(std::to_string(size) + " " + std::to_string(coupling));
        const BlockProblem problem(size, coupling, 7U + static_cast<unsigned>(size), equal);
        const AffineRows rows(problem.K.get());
        const BlockRows blocks(rows, problem.blocks);
        BlockSweeps sweeps(PETSC_COMM_WORLD, blocks, Degenerate::undecided);
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
  const BlockProblem problem(5, 1e-6, 3);
  const AffineRows rows(problem.K.get());
  const BlockRows blocks(rows, problem.blocks);
  BlockSweeps sweeps(PETSC_COMM_WORLD, blocks, Degenerate::undecided);
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
  const BlockProblem one(4, 1e-3, 11);
  const BlockProblem other(4, 1e-3, 12);
  const AffineRows rows(one.K.get());
  const BlockRows blocks(rows, one.blocks);
  BlockSweeps fresh(PETSC_COMM_WORLD, blocks, Degenerate::at_bound);
  BlockSweeps used(PETSC_COMM_WORLD, blocks, Degenerate::at_bound);
  const Vector guess = duplicate(one.u.get());
  check(VecCopy(one.u.get(), guess.get()));
  used.solve(other.u.get(), other.u.get(), other.b.get(), other.lower.get(), other.upper.get());
  ASSERT_TRUE(fresh.solve(one.u.get(), one.u.get(), one.b.get(), one.lower.get(), one.upper.get()));
  ASSERT_TRUE(used.solve(guess.get(), guess.get(), one.b.get(), one.lower.get(), one.upper.get()));
  EXPECT_EQ(everywhere(one.u.get()), everywhere(guess.get()));
}

// Not where blocks read each other as strongly as themselves, nor where a block is singular or large.
TEST(BlockSweeps, KnowWhereTheyAreOfNoUse) {
  const auto worthwhile = [](const BlockProblem& problem, const std::vector<PetscInt>& block) {
    const AffineRows rows(problem.K.get());
    return BlockSweeps(PETSC_COMM_WORLD, BlockRows(rows, block), Degenerate::undecided).worthwhile();
  };
  const BlockProblem strong(3, 2.0, 5);
  EXPECT_FALSE(worthwhile(strong, strong.blocks));
  const BlockProblem weak(3, 1e-3, 5);
  EXPECT_TRUE(worthwhile(weak, weak.blocks));
  EXPECT_FALSE(worthwhile(weak, std::vector<PetscInt>(weak.blocks.size(), 0)));
  const BlockProblem singular(2, 1e-3, 5);
  int rank = 0;
  MPI_Comm_rank(PETSC_COMM_WORLD, &rank);
  const PetscInt row = row_range(singular.K.get()).first;
  if (rank == 0)
    for (PetscInt column = row; column < row + 2; ++column)
      check(MatSetValue(singular.K.get(), row, column, 0.0, INSERT_VALUES));
  check(MatAssemblyBegin(singular.K.get(), MAT_FINAL_ASSEMBLY));
  check(MatAssemblyEnd(singular.K.get(), MAT_FINAL_ASSEMBLY));
  EXPECT_FALSE(worthwhile(singular, singular.blocks));
}

}  // namespace
}  // namespace sweepvi::test
