// ranks: 1 2 3
// Rows of blocks side by side: judged as one by one, to the same bits on every processor, and swept to the
// solution of the whole box VI.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>

#include "dvi/systems.hpp"
#include "vi/block_problem.hpp"
#include "vi/block_rows.hpp"
#include "vi/row_sweeps.hpp"

namespace sweepvi::test {
namespace {

constexpr double weak = 0.05;  // rows off their diagonals: five sweeps or so

TEST(BlockRows, JudgeAsRowsDo) {
  for (const int size : {1, 2, 3, 4, 5, 7}) {
    for (const bool equal : {false, true}) {
      SCOPED_TRACE(std::to_string(size) + (equal ? " equal" : ""));
      const BlockProblem problem(size, 1e-2, 5U, equal);
      const AffineRows rows(problem.K.get());
      const BlockRows blocks(rows, problem.blocks);
      ASSERT_TRUE(blocks.small());
      const Vector b_terms = duplicate(problem.b.get());
      check(VecSet(b_terms.get(), 0.5));
      const Vector f = duplicate(problem.b.get());
      const Vector terms = duplicate(problem.b.get());
      const auto judge = [&] {
        const RowRatios one_by_one =
            rows.judge(problem.u.get(), problem.lower.get(), problem.upper.get(), problem.b.get(),
                       b_terms.get(), problem.f.get(), problem.terms.get());
        const RowRatios side_by_side = blocks.judge(problem.u.get(), problem.lower.get(), problem.upper.get(),
                                                    problem.b.get(), b_terms.get(), f.get(), terms.get());
        EXPECT_EQ(one_by_one.by_distance, side_by_side.by_distance);
        EXPECT_EQ(one_by_one.outside, side_by_side.outside);
        if (std::isfinite(one_by_one.worst))
          EXPECT_NEAR(one_by_one.worst, side_by_side.worst, 1e-15);  // other orders of the same sums
        else
          EXPECT_EQ(one_by_one.worst, side_by_side.worst);
        return side_by_side;
      };
      judge();
      {
        const ReadArray value(f.get());
        const ReadArray other(problem.f.get());
        const ReadArray sizes(terms.get());
        const ReadArray other_sizes(problem.terms.get());
        for (PetscInt i = 0; i < value.size(); ++i) {
          EXPECT_NEAR(value[i], other[i], 1e-15 * sizes[i]);
          EXPECT_NEAR(sizes[i], other_sizes[i], 1e-15 * sizes[i]);
        }
      }
      {  // inside, at a bound, close to one
        const WriteArray u(problem.u.get());
        const ReadArray l(problem.lower.get());
        const ReadArray h(problem.upper.get());
        for (PetscInt i = 0; i < u.size(); ++i)
          u[i] = i % 3 == 0 && l[i] > PETSC_NINFINITY ? l[i] : std::min(std::max(u[i], l[i]), h[i]);
      }
      EXPECT_FALSE(judge().outside);
      {  // the last block, which stands alone
        const WriteArray u(problem.u.get());
        u[u.size() - 1] = std::numeric_limits<double>::quiet_NaN();
      }
      EXPECT_FALSE(std::isfinite(judge().worst));
    }
  }
}

TEST(BlockRows, LeaveLargeBlocksAlone) {
  const BlockProblem problem(5, 0.0, 3U);
  const AffineRows rows(problem.K.get());
  EXPECT_FALSE(BlockRows(rows, std::vector<PetscInt>(problem.blocks.size(), 0)).small());
  EXPECT_FALSE(BlockRows(rows, {}).small());
}

// Sums are in one order, and nothing is fused: a result does not depend on the processor.
TEST(BlockKernels, GiveTheSameBits) {
  const BlockKernels& best = block_kernels();
  if (&best == &detail::plain_block_kernels) GTEST_SKIP() << "there are no others here";
  for (const int size : {1, 2, 3, 4, 5}) {
    const BlockProblem problem(size, 1e-2, 9U, true, weak);
    const AffineRows rows(problem.K.get());
    const BlockRows blocks(rows, problem.blocks);
    const double* others = rows.ghosts(problem.u.get());
    const ReadArray start(problem.u.get());
    const ReadArray l(problem.lower.get());
    const ReadArray h(problem.upper.get());
    const ReadArray b(problem.b.get());
    const auto count = static_cast<std::size_t>(start.size());
    struct Found {
      std::vector<double> u, f, terms;
      std::vector<unsigned char> moves;
      double worst = 0.0;
    };
    const auto run = [&](const BlockKernels& kernels) {
      Found found{{start.data(), start.data() + count},
                  std::vector<double>(count),
                  std::vector<double>(count),
                  std::vector<unsigned char>(blocks.packs(), 1)};
      for (const bool watches : {false, true}) {
        BlockSweep sweep{found.u.data(), others, b.data(), l.data(), h.data(), 2};
        if (watches) {
          sweep.moves = found.moves.data();
          sweep.still = 1e-6;
          sweep.near = 1e-12;
        }
        for (const BlockRows::Run& part : blocks.runs())
          kernels.sweep(blocks.model(), part, sweep);
      }
      BlockJudge judge{found.u.data(), others,   l.data(),       h.data(),
                       b.data(),       b.data(), found.f.data(), found.terms.data()};
      for (const BlockRows::Run& part : blocks.runs())
        kernels.judge(blocks.model(), part, judge);
      found.worst = judge.worst;
      return found;
    };
    const Found plain = run(detail::plain_block_kernels);
    const Found fast = run(best);
    EXPECT_EQ(plain.u, fast.u);
    EXPECT_EQ(plain.f, fast.f);
    EXPECT_EQ(plain.terms, fast.terms);
    EXPECT_EQ(plain.moves, fast.moves);
    EXPECT_EQ(plain.worst, fast.worst);
  }
}

TEST(RowSweeps, SolveRowsGovernedByTheirDiagonals) {
  for (const int size : {1, 2, 3, 4, 5, 7}) {
    for (const double coupling : {0.0, 1e-6, 1e-2}) {
      for (const bool equal : {false, true}) {
        SCOPED_TRACE(std::to_string(size) + " " + std::to_string(coupling));
        const BlockProblem problem(size, coupling, 7U + static_cast<unsigned>(size), equal, weak);
        const AffineRows rows(problem.K.get());
        const BlockRows blocks(rows, problem.blocks);
        RowSweeps sweeps(PETSC_COMM_WORLD, blocks, Degenerate::undecided);
        ASSERT_TRUE(sweeps.worthwhile());
        sweeps.solve(problem.u.get(), problem.b.get(), problem.lower.get(), problem.upper.get());
        EXPECT_LE(problem.ratio(), 1e-14);  // what a step is asked for; above, it would be swept again
      }
    }
  }
}

// What they find is that of the step and its guess: a run that is taken up again gives the same bits.
TEST(RowSweeps, RememberNothing) {
  const BlockProblem one(4, 1e-3, 11, true, weak);
  const BlockProblem other(4, 1e-3, 12, true, weak);
  const AffineRows rows(one.K.get());
  const BlockRows blocks(rows, one.blocks);
  RowSweeps fresh(PETSC_COMM_WORLD, blocks, Degenerate::at_bound);
  RowSweeps used(PETSC_COMM_WORLD, blocks, Degenerate::at_bound);
  const Vector guess = duplicate(one.u.get());
  check(VecCopy(one.u.get(), guess.get()));
  used.solve(other.u.get(), other.b.get(), other.lower.get(), other.upper.get());
  fresh.solve(one.u.get(), one.b.get(), one.lower.get(), one.upper.get());
  used.solve(guess.get(), one.b.get(), one.lower.get(), one.upper.get());
  EXPECT_EQ(everywhere(one.u.get()), everywhere(guess.get()));
}

// An output that is at its bound but for the rounding of its row's terms is held there.
TEST(RowSweeps, HoldWhatIsAtItsBound) {
  for (const Degenerate degenerate : {Degenerate::undecided, Degenerate::at_bound}) {
    const BlockProblem problem(2, 0.0, 21, true, weak);
    const AffineRows rows(problem.K.get());
    const BlockRows blocks(rows, problem.blocks);
    RowSweeps sweeps(PETSC_COMM_WORLD, blocks, degenerate);
    check(VecSet(problem.lower.get(), PETSC_NINFINITY));
    check(VecSet(problem.upper.get(), PETSC_INFINITY));
    double open = 0.0;  // far below what its row is known to, which reads the second unknown, 1
    {
      std::array<double, 4> block{};
      for (PetscInt i = 0; i < 2; ++i)
        for (const AffineRows::Entry& entry : rows.entries(i))
          if (i + entry.offset >= 0 && i + entry.offset < 2)
            block[static_cast<std::size_t>(2 * i + i + entry.offset)] = entry.value;
      open = 1e-14 * std::abs(block[1]);
      const WriteArray b(problem.b.get());
      const WriteArray lower(problem.lower.get());
      const WriteArray u(problem.u.get());
      for (PetscInt i = 0; i < b.size(); i += 2) {
        b[i] = block[0] * open + block[1];
        b[i + 1] = block[2] * open + block[3];
        lower[i] = 0.0;
        u[i] = u[i + 1] = 0.5;
      }
    }
    sweeps.solve(problem.u.get(), problem.b.get(), problem.lower.get(), problem.upper.get());
    const ReadArray u(problem.u.get());
    for (PetscInt i = 0; i < u.size(); i += 2) {
      if (degenerate == Degenerate::at_bound)
        EXPECT_EQ(u[i], 0.0);
      else
        EXPECT_NEAR(u[i], open, 0.1 * open);  // rounding of the row: a hundredth
      EXPECT_NEAR(u[i + 1], 1.0, 1e-14);
    }
  }
}

// Not where rows read each other as strongly as themselves, nor from the other side.
TEST(RowSweeps, KnowWhereTheyAreOfNoUse) {
  const BlockProblem strong(4, 1.0, 5);
  const AffineRows rows(strong.K.get());
  EXPECT_FALSE(
      RowSweeps(PETSC_COMM_WORLD, BlockRows(rows, strong.blocks), Degenerate::undecided).worthwhile());
  const BlockProblem negative(4, 0.0, 5, true, weak);
  check(MatScale(negative.K.get(), -1.0));
  const AffineRows opposite(negative.K.get());
  EXPECT_FALSE(
      RowSweeps(PETSC_COMM_WORLD, BlockRows(opposite, negative.blocks), Degenerate::undecided).worthwhile());
}

}  // namespace
}  // namespace sweepvi::test
