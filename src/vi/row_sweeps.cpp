#include "vi/row_sweeps.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "petsc/sparse.hpp"

namespace sweepvi {

namespace {

constexpr int most_sweeps = 16;
constexpr int most_rounds = 3;
constexpr double solved = 1e-15;  // of a row's residual, over its terms

}  // namespace

RowSweeps::RowSweeps(MPI_Comm comm, const BlockRows& rows, Degenerate degenerate)
    : comm_(comm), rows_(rows), near_(degenerate == Degenerate::at_bound ? held_rtol : 0.0) {
  int fit = rows.small() && rows.smallest_diagonal() > 0.0 ? 1 : 0;
  MPI_Allreduce(MPI_IN_PLACE, &fit, 1, MPI_INT, MPI_LAND, comm);
  if (fit == 0 || !(contraction() < 0.5)) return;
  // What a sweep costs besides its rounds is about three of them.
  int best = most_sweeps * most_rounds;
  for (int rounds = 1; rounds <= most_rounds; ++rounds) {
    const Trial trial = try_out(rounds);
    const int cost = trial.sweeps * (3 + rounds);
    if (trial.sweeps == 0 || cost >= best) continue;
    best = cost;
    rounds_ = rounds;
    still_ = trial.last_move;
    sweeps_ = trial.sweeps;
  }
}

// Of the model, with all packs.
void RowSweeps::sweep_all(const BlockModel& model, int rounds, Vec u, Vec b, Vec lower, Vec upper) {
  const double* others = rows_.rows().ghosts(u);
  const WriteArray x(u);
  const ReadArray right(b);
  const ReadArray l(lower);
  const ReadArray h(upper);
  BlockSweep sweep{x.data(), others, right.data(), l.data(), h.data(), rounds};
  for (const BlockRows::Run& run : rows_.runs())
    block_kernels().sweep(model, run, sweep);
}

// How much the largest entry shrinks in a sweep over absolute values, which bounds cannot make any larger.
double RowSweeps::contraction() {
  constexpr int sweeps = 10;
  BlockModel model = rows_.model();
  std::vector<BlockModel::Entry> entries = rows_.entries();
  for (BlockModel::Entry& entry : entries)
    entry.value = -std::abs(entry.value);
  std::vector<BlockModel::FarEntry> far = rows_.far();
  for (BlockModel::FarEntry& entry : far)
    entry.value = -std::abs(entry.value);
  model.entries = entries.data();
  model.far = far.data();
  const Vector u = make_vector(comm_, rows_.rows().size());
  const Vector b = duplicate(u.get());
  const Vector lower = duplicate(u.get());
  const Vector upper = duplicate(u.get());
  check(VecSet(u.get(), 1.0));
  check(VecSet(b.get(), 0.0));
  check(VecSet(lower.get(), PETSC_NINFINITY));
  check(VecSet(upper.get(), PETSC_INFINITY));
  for (int number = 0; number < sweeps; ++number)
    sweep_all(model, 1, u.get(), b.get(), lower.get(), upper.get());
  double largest = 0.0;
  check(VecNorm(u.get(), NORM_INFINITY, &largest));
  return std::isfinite(largest) ? std::pow(largest, 1.0 / sweeps) : HUGE_VAL;
}

// A step without bounds from numbers of any sign, and of the same size everywhere: how many sweeps it takes,
// and by how much the last of them still moves an unknown, over the terms of its row.
RowSweeps::Trial RowSweeps::try_out(int rounds) {
  const Vector u = make_vector(comm_, rows_.rows().size());
  const Vector b = duplicate(u.get());
  const Vector b_terms = duplicate(u.get());
  const Vector before = duplicate(u.get());
  const Vector f = duplicate(u.get());
  const Vector terms = duplicate(u.get());
  const Vector lower = duplicate(u.get());
  const Vector upper = duplicate(u.get());
  check(VecSet(lower.get(), PETSC_NINFINITY));
  check(VecSet(upper.get(), PETSC_INFINITY));
  check(VecSet(b_terms.get(), 1.0));
  {
    const WriteArray x(u.get());
    std::uint32_t bits = 1;  // of a linear congruential generator
    for (PetscInt i = 0; i < x.size(); ++i) {
      bits = 1664525U * bits + 1013904223U;
      x[i] = bits >> 31 != 0 ? -1.0 : 1.0;
    }
  }
  check(VecCopy(u.get(), b.get()));
  for (int number = 1; number <= most_sweeps; ++number) {
    check(VecCopy(u.get(), before.get()));
    sweep_all(rows_.model(), rounds, u.get(), b.get(), lower.get(), upper.get());
    rows_.rows().evaluate(u.get(), b.get(), b_terms.get(), f.get(), terms.get());
    double left = 0.0;
    double moved = 0.0;
    check(VecPointwiseDivide(f.get(), f.get(), terms.get()));
    check(VecNorm(f.get(), NORM_INFINITY, &left));
    check(VecAXPY(before.get(), -1.0, u.get()));
    check(VecPointwiseDivide(before.get(), before.get(), terms.get()));
    check(VecNorm(before.get(), NORM_INFINITY, &moved));
    if (left <= solved) return {number, moved};
  }
  return {};
}

void RowSweeps::solve(Vec u, Vec b, Vec lower, Vec upper) {
  const ReadArray right(b);
  const ReadArray l(lower);
  const ReadArray h(upper);
  const BlockKernels& kernels = block_kernels();
  const BlockModel model = rows_.model();
  for (int number = 1; number <= most_sweeps; ++number) {
    const double* others = rows_.rows().ghosts(u);
    const WriteArray x(u);
    BlockSweep sweep{x.data(), others, right.data(), l.data(), h.data(), rounds_};
    if (number == sweeps_) moves_.assign(rows_.packs(), 1);
    if (number >= sweeps_) {
      sweep.moves = moves_.data();
      sweep.still = still_;
      sweep.near = near_;
    }
    for (const BlockRows::Run& run : rows_.runs())
      kernels.sweep(model, run, sweep);
    if (number < sweeps_) continue;
    int moved = sweep.moved;
    MPI_Allreduce(MPI_IN_PLACE, &moved, 1, MPI_INT, MPI_LOR, comm_);
    if (moved == 0) break;
  }
}

}  // namespace sweepvi
