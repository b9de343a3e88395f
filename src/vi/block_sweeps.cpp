#include "vi/block_sweeps.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <span>
#include <utility>

#include "petsc/sparse.hpp"

namespace sweepvi {

namespace {

constexpr int most_sweeps = 12;
constexpr double settled = 2e-16;  // change of what a row reads, over the terms of the row

}  // namespace

BlockSweeps::BlockSweeps(MPI_Comm comm, const BlockRows& rows, Degenerate degenerate)
    : comm_(comm),
      rows_(rows.rows()),
      blocks_(rows),
      slack_(degenerate == Degenerate::at_bound    ? held_rtol
             : degenerate == Degenerate::off_bound ? -held_rtol
                                                   : 0.0),
      count_(rows.rows().size()) {
  int small = rows.small() ? 1 : 0;
  MPI_Allreduce(MPI_IN_PLACE, &small, 1, MPI_INT, MPI_LAND, comm);
  if (small != 0) make_boxes();
  rate_ = small != 0 ? contraction() : HUGE_VAL;
  MPI_Allreduce(MPI_IN_PLACE, &rate_, 1, MPI_DOUBLE, MPI_MAX, comm);
  if (!worthwhile()) forget_blocks();
}

void BlockSweeps::make_boxes() {
  for (std::size_t k = 0; k < blocks_.kinds().size(); ++k)
    boxes_.emplace_back(blocks_.kinds()[k].size, blocks_.matrices()[k]);
  std::size_t blocks = 0;
  std::size_t readers = 0;
  for (const BlockRows::Run& run : blocks_.runs()) {
    const BlockRows::Kind& kind = blocks_.kinds()[static_cast<std::size_t>(run.kind)];
    blocks += static_cast<std::size_t>(run.count);
    readers +=
        static_cast<std::size_t>(run.count) * static_cast<std::size_t>(kind.readers_end - kind.readers);
  }
  read_.resize(readers);
  inverses_.resize(blocks);
  active_.assign(blocks, 0);
  bounded_.assign(blocks, 0);
}

void BlockSweeps::forget_blocks() {
  boxes_ = {};
  read_ = {};
  inverses_ = {};
  active_ = {};
  bounded_ = {};
}

// Calls visit(number of the block, its box, its first unknown, its first reading row of all).
template <class Visit>
void BlockSweeps::each_block(Visit&& visit) {
  std::size_t row = 0;
  for (const BlockRows::Run& run : blocks_.runs()) {
    const BlockRows::Kind& kind = blocks_.kinds()[static_cast<std::size_t>(run.kind)];
    SmallBox& box = boxes_[static_cast<std::size_t>(run.kind)];
    auto first = static_cast<PetscInt>(run.first);
    for (std::int32_t e = 0; e < run.count; ++e, first += kind.size) {
      visit(Block{static_cast<std::size_t>(run.block + e), &kind}, box, first, row);
      row += static_cast<std::size_t>(kind.readers_end - kind.readers);
    }
  }
}

// Calls visit(row in the block, its entries).
template <class Visit>
void BlockSweeps::each_reading_row(const Block& block, Visit&& visit) const {
  const BlockModel model = blocks_.model();
  const BlockModel::Reading& reading = model.readings[model.reading[block.number]];
  const BlockModel::FarEntry* begin = model.far + reading.entries;
  const std::int32_t* ends = model.ends + reading.ends;
  for (auto j = block.kind->readers; j < block.kind->readers_end; ++j, ++ends) {
    const BlockModel::FarEntry* const end = model.far + *ends;
    visit(model.readers[j], std::span(begin, end));
    begin = end;
  }
}

// About the spectral radius of |inverse| |what blocks read| without active sets: how a vector that is 1 at
// first grows over ten products.
double BlockSweeps::contraction() {
  constexpr int products = 10;
  const Vector vector = make_vector(comm_, count_);
  check(VecSet(vector.get(), 1.0));
  double largest = 1.0;  // of the last product
  std::array<double, SmallBox::largest> left{};
  for (int product = 0; product < products; ++product) {
    const double* others = rows_.ghosts(vector.get());
    const WriteArray x(vector.get());
    largest = 0.0;
    each_block([&](const Block& block, SmallBox& box, PetscInt first, std::size_t) {
      const double* inverse = box.inverse_of(0);
      if (inverse == nullptr) {  // singular
        largest = HUGE_VAL;
        return;
      }
      left.fill(0.0);
      each_reading_row(block, [&](int row, std::span<const BlockModel::FarEntry> entries) {
        double sum = 0.0;
        for (const BlockModel::FarEntry& entry : entries) {
          const PetscInt column = first + static_cast<PetscInt>(entry.offset);
          sum += std::abs(entry.value) * (column < count_ ? x[column] : others[column - count_]);
        }
        const double* column = inverse + static_cast<std::ptrdiff_t>(row) * box.stride();
        for (int i = 0; i < box.size(); ++i)
          left[static_cast<std::size_t>(i)] += std::abs(column[i]) * sum;
      });
      for (int i = 0; i < box.size(); ++i)
        largest = std::max(largest, left[static_cast<std::size_t>(i)]);
      std::copy_n(left.begin(), box.size(), x.data() + first);
    });
  }
  return std::pow(largest, 1.0 / products);
}

bool BlockSweeps::first_sweep(const double* guess, double* u, const double* b, const double* lower,
                              const double* upper, const double* others) {
  std::array<double, SmallBox::largest> right;  // NOLINT: filled as far as it is read
  bool found = true;
  each_block([&](const Block& block, SmallBox& box, PetscInt first, std::size_t reading_row) {
    const std::size_t e = block.number;
    if (!found) return;
    const int size = box.size();
    SmallBox::Mask active = 0, bounded = 0;
    for (int i = 0; i < size; ++i) {
      right[static_cast<std::size_t>(i)] = b[first + i];
      if (lower[first + i] > PETSC_NINFINITY || upper[first + i] < PETSC_INFINITY) bounded |= 1U << i;
      if (guess[first + i] <= lower[first + i] || guess[first + i] >= upper[first + i]) active |= 1U << i;
    }
    double* read = read_.data() + reading_row;
    each_reading_row(block, [&](int row, std::span<const BlockModel::FarEntry> entries) {
      double sum = 0.0;
      for (const BlockModel::FarEntry& entry : entries) {
        const PetscInt column = first + static_cast<PetscInt>(entry.offset);
        sum += entry.value * (column < first    ? u[column]
                              : column < count_ ? guess[column]
                                                : others[column - count_]);
      }
      *read++ = sum;
      right[static_cast<std::size_t>(row)] -= sum;
    });
    inverses_[e] =
        box.solve(right.data(), lower + first, upper + first, slack_, guess + first, u + first, active);
    active_[e] = active;
    bounded_[e] = bounded;
    found = inverses_[e] != nullptr;
  });
  return found;
}

// With the sets there are: u changes by the inverse times the change of what is read. Calls after(block, box,
// first unknown, what its reading rows read) where there was one. Returns the largest over the terms of its
// row.
template <class After>
double BlockSweeps::carry_on(double* u, const double* b, const double* others, After&& after) {
  double change = 0.0;
  each_block([&](const Block& block, SmallBox& box, PetscInt first, std::size_t reading_row) {
    const std::size_t e = block.number;
    double* read = read_.data() + reading_row;
    bool changed = false;
    each_reading_row(block, [&](int row, std::span<const BlockModel::FarEntry> entries) {
      double sum = 0.0;
      double terms = std::abs(b[first + row]);
      for (const BlockModel::FarEntry& entry : entries) {
        const PetscInt column = first + static_cast<PetscInt>(entry.offset);
        const double term = entry.value * (column < count_ ? u[column] : others[column - count_]);
        sum += term;
        terms += std::abs(term);
      }
      const double by = sum - *read;
      *read++ = sum;
      if (by == 0.0) return;
      changed = true;
      if ((active_[e] >> row & 1U) != 0) return;
      if (std::abs(by) > change * terms) change = std::abs(by) / terms;
      add_column(box.size(), inverses_[e] + static_cast<std::ptrdiff_t>(row) * box.stride(), -by, u + first);
    });
    if (changed) after(block, box, first, read_.data() + reading_row);
  });
  return change;
}

double BlockSweeps::next_sweep(double* u, const double* b, const double* others) {
  return carry_on(u, b, others, [](const Block&, const SmallBox&, PetscInt, const double*) {});
}

// What is left of b for a block by what it reads.
void BlockSweeps::find_right(const Block& block, const SmallBox& box, const double* b, const double* read,
                             double* right) const {
  std::copy_n(b, box.size(), right);
  each_reading_row(block, [&](int row, std::span<const BlockModel::FarEntry>) { right[row] -= *read++; });
}

// Whether the set of a block still is that of a solution, but for rounding.
bool BlockSweeps::set_holds(const SmallBox& box, std::size_t block, const double* right, const double* lower,
                            const double* upper, const double* u) const {
  for (SmallBox::Mask rest = bounded_[block]; rest != 0; rest &= rest - 1) {
    const int i = std::countr_zero(rest);
    if ((active_[block] >> i & 1U) == 0) {
      if (u[i] < lower[i] || u[i] > upper[i]) return false;
      continue;
    }
    if (lower[i] == upper[i]) continue;
    const double* row = box.matrix().data() + static_cast<std::ptrdiff_t>(i) * box.size();
    double f = -right[i], terms = std::abs(right[i]);
    for (int j = 0; j < box.size(); ++j) {
      f += row[j] * u[j];
      terms += std::abs(row[j] * u[j]);
    }
    if ((u[i] == lower[i] ? -f : f) > held_rtol * terms) return false;
  }
  return true;
}

// The same, and blocks whose set does not fit any more are solved again: neighbours were not yet where they
// are now.
double BlockSweeps::sweep_and_check(double* u, const double* b, const double* lower, const double* upper,
                                    const double* others) {
  std::array<double, SmallBox::largest> right;  // NOLINT: filled as far as it is read
  bool switched = false;
  const double change =
      carry_on(u, b, others, [&](const Block& block, SmallBox& box, PetscInt first, const double* read) {
        const std::size_t e = block.number;
        if (bounded_[e] == 0) return;
        find_right(block, box, b + first, read, right.data());
        if (set_holds(box, e, right.data(), lower + first, upper + first, u + first)) return;
        SmallBox::Mask active = active_[e];
        const double* inverse =
            box.solve(right.data(), lower + first, upper + first, slack_, u + first, u + first, active);
        if (inverse == nullptr) return;  // the certificate will tell
        inverses_[e] = inverse;
        active_[e] = active;
        switched = true;
      });
  return switched ? std::max(change, 1.0) : change;  // others read what switched
}

void BlockSweeps::refine(Vec u, Vec f) {
  const WriteArray x(u);
  const ReadArray off(f);
  each_block([&](const Block& block, SmallBox& box, PetscInt first, std::size_t) {
    const std::size_t e = block.number;
    for (int j = 0; j < box.size(); ++j)
      if ((active_[e] >> j & 1U) == 0)
        add_column(box.size(), inverses_[e] + static_cast<std::ptrdiff_t>(j) * box.stride(), -off[first + j],
                   x.data() + first);
  });
}

bool BlockSweeps::solve(Vec guess, Vec u, Vec b, Vec lower, Vec upper) {
  const ReadArray right(b);
  {
    const double* others = rows_.ghosts(guess);
    const WriteArray x(u);  // first: the guess may be the same
    const ReadArray start(guess);
    const ReadArray l(lower);
    const ReadArray h(upper);
    int failed = first_sweep(start.data(), x.data(), right.data(), l.data(), h.data(), others) ? 0 : 1;
    MPI_Allreduce(MPI_IN_PLACE, &failed, 1, MPI_INT, MPI_LOR, comm_);
    if (failed != 0) return false;
  }
  for (int sweep = 1; sweep < most_sweeps; ++sweep) {
    const double* others = rows_.ghosts(u);
    const WriteArray x(u);
    const ReadArray l(lower);
    const ReadArray h(upper);
    double change = sweep == 1 ? sweep_and_check(x.data(), right.data(), l.data(), h.data(), others)
                               : next_sweep(x.data(), right.data(), others);
    MPI_Allreduce(MPI_IN_PLACE, &change, 1, MPI_DOUBLE, MPI_MAX, comm_);
    // The next one would change that much times the contraction.
    if (change * rate_ <= settled) break;
  }
  return true;
}

}  // namespace sweepvi
