#include "vi/block_sweeps.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <span>
#include <utility>

#include "petsc/alike.hpp"
#include "petsc/sparse.hpp"

namespace sweepvi {

namespace {

constexpr int most_sweeps = 12;
constexpr double settled = 2e-16;  // change of what a row reads, over the terms of the row

}  // namespace

BlockSweeps::BlockSweeps(MPI_Comm comm, const AffineRows& rows, const std::vector<PetscInt>& block,
                         Degenerate degenerate)
    : comm_(comm),
      rows_(rows),
      slack_(degenerate == Degenerate::at_bound    ? held_rtol
             : degenerate == Degenerate::off_bound ? -held_rtol
                                                   : 0.0),
      count_(rows.size()) {
  int small = find_blocks(rows, block) ? 1 : 0;
  MPI_Allreduce(MPI_IN_PLACE, &small, 1, MPI_INT, MPI_LAND, comm);
  rate_ = small != 0 ? contraction() : HUGE_VAL;
  MPI_Allreduce(MPI_IN_PLACE, &rate_, 1, MPI_DOUBLE, MPI_MAX, comm);
  if (!worthwhile()) forget_blocks();
}

void BlockSweeps::forget_blocks() {
  blocks_ = {};
  readings_ = {};
  rows_of_readings_ = {};
  entries_ = {};
  read_ = {};
  inverses_ = {};
  active_ = {};
  bounded_ = {};
}

// Calls visit(number of the block, itself, its box, its first unknown, its first reading row of all).
template <class Visit>
void BlockSweeps::each_block(Visit&& visit) {
  PetscInt first = 0;
  std::size_t row = 0;
  for (std::size_t e = 0; e < blocks_.size(); ++e) {
    const Block& block = blocks_[e];
    SmallBox& box = boxes_[static_cast<std::size_t>(block.box)];
    visit(e, block, box, first, row);
    const Reading& reading = readings_[static_cast<std::size_t>(block.reading)];
    row += static_cast<std::size_t>(reading.end - reading.first);
    first += box.size();
  }
}

// Calls visit(row in the block, its entries).
template <class Visit>
void BlockSweeps::each_reading_row(const Block& block, Visit&& visit) const {
  const Reading& reading = readings_[static_cast<std::size_t>(block.reading)];
  auto begin = entries_.data() + reading.entries;
  for (auto r = reading.first; r < reading.end; ++r) {
    const ReadingRow& row = rows_of_readings_[static_cast<std::size_t>(r)];
    const Entry* end = entries_.data() + row.end;
    visit(row.row, std::span(begin, end));
    begin = end;
  }
}

bool BlockSweeps::find_blocks(const AffineRows& rows, const std::vector<PetscInt>& block) {
  Alike boxes, readings;
  std::vector<double> matrix, read;  // read: row, number of entries, entries
  std::size_t reading_rows = 0;
  for (PetscInt first = 0; first < count_;) {
    PetscInt end = first + 1;
    while (end < count_ && block[static_cast<std::size_t>(end)] == block[static_cast<std::size_t>(first)])
      ++end;
    const auto size = static_cast<int>(end - first);
    if (size > SmallBox::largest) return false;
    matrix.assign(static_cast<std::size_t>(size) * static_cast<std::size_t>(size), 0.0);
    read.clear();
    for (PetscInt i = first; i < end; ++i) {
      std::size_t head = 0;
      for (const auto& [offset, value] : rows.entries(i)) {
        const PetscInt column = i + offset;
        if (column >= first && column < end) {
          matrix[static_cast<std::size_t>((i - first) * size + column - first)] = value;
        } else if (value != 0.0) {
          if (head == 0) {
            read.push_back(static_cast<double>(i - first));
            head = read.size();
            read.push_back(0.0);
          }
          read[head] += 1.0;
          read.push_back(static_cast<double>(column - first));
          read.push_back(value);
        }
      }
    }
    const auto [box, new_box] = boxes.number(matrix);
    if (new_box) boxes_.emplace_back(size, matrix);
    const auto [reading, new_reading] = readings.number(read);
    if (new_reading) add_reading(read);
    blocks_.push_back({box, reading});
    const Reading& its = readings_[static_cast<std::size_t>(reading)];
    reading_rows += static_cast<std::size_t>(its.end - its.first);
    first = end;
  }
  read_.resize(reading_rows);
  inverses_.resize(blocks_.size());
  active_.assign(blocks_.size(), 0);
  bounded_.assign(blocks_.size(), 0);
  return true;
}

void BlockSweeps::add_reading(const std::vector<double>& read) {
  Reading reading{static_cast<std::int32_t>(rows_of_readings_.size()), 0,
                  static_cast<std::int32_t>(entries_.size())};
  for (std::size_t k = 0; k < read.size();) {
    const auto row = static_cast<std::int32_t>(read[k++]);
    for (auto left = static_cast<int>(read[k++]); left > 0; --left, k += 2)
      entries_.push_back({static_cast<PetscInt>(read[k]), read[k + 1]});
    rows_of_readings_.push_back({row, static_cast<std::int32_t>(entries_.size())});
  }
  reading.end = static_cast<std::int32_t>(rows_of_readings_.size());
  readings_.push_back(reading);
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
    each_block([&](std::size_t, const Block& block, SmallBox& box, PetscInt first, std::size_t) {
      const double* inverse = box.inverse_of(0);
      if (inverse == nullptr) {  // singular
        largest = HUGE_VAL;
        return;
      }
      left.fill(0.0);
      each_reading_row(block, [&](int row, std::span<const Entry> entries) {
        double sum = 0.0;
        for (const Entry& entry : entries) {
          const PetscInt column = first + entry.offset;
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
  each_block([&](std::size_t e, const Block& block, SmallBox& box, PetscInt first, std::size_t reading_row) {
    if (!found) return;
    const int size = box.size();
    SmallBox::Mask active = 0, bounded = 0;
    for (int i = 0; i < size; ++i) {
      right[static_cast<std::size_t>(i)] = b[first + i];
      if (lower[first + i] > PETSC_NINFINITY || upper[first + i] < PETSC_INFINITY) bounded |= 1U << i;
      if (guess[first + i] <= lower[first + i] || guess[first + i] >= upper[first + i]) active |= 1U << i;
    }
    double* read = read_.data() + reading_row;
    each_reading_row(block, [&](int row, std::span<const Entry> entries) {
      double sum = 0.0;
      for (const Entry& entry : entries) {
        const PetscInt column = first + entry.offset;
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
  each_block([&](std::size_t e, const Block& block, SmallBox& box, PetscInt first, std::size_t reading_row) {
    double* read = read_.data() + reading_row;
    bool changed = false;
    each_reading_row(block, [&](int row, std::span<const Entry> entries) {
      double sum = 0.0;
      double terms = std::abs(b[first + row]);
      for (const Entry& entry : entries) {
        const PetscInt column = first + entry.offset;
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
    if (changed) after(e, box, first, read_.data() + reading_row);
  });
  return change;
}

double BlockSweeps::next_sweep(double* u, const double* b, const double* others) {
  return carry_on(u, b, others, [](std::size_t, const SmallBox&, PetscInt, const double*) {});
}

// What is left of b for a block by what it reads.
void BlockSweeps::find_right(const Block& block, const SmallBox& box, const double* b, const double* read,
                             double* right) const {
  std::copy_n(b, box.size(), right);
  each_reading_row(block, [&](int row, std::span<const Entry>) { right[row] -= *read++; });
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
      carry_on(u, b, others, [&](std::size_t e, SmallBox& box, PetscInt first, const double* read) {
        if (bounded_[e] == 0) return;
        find_right(blocks_[e], box, b + first, read, right.data());
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
  each_block([&](std::size_t e, const Block&, SmallBox& box, PetscInt first, std::size_t) {
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
