#include "vi/block_sweeps.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include "petsc/sparse.hpp"

namespace sweepvi {

namespace {

constexpr int largest_block = 16;
constexpr int most_sweeps = 12;
constexpr int most_sets = 12;      // tried by a block one after the other, before all of them are
constexpr int most_bounds = 8;     // of a block whose sets are all tried
constexpr double settled = 1e-16;  // change of what a row reads, over its terms

bool invert(std::vector<double>& a, int n) {
  std::vector<double> inverse(a.size(), 0.0);
  for (int i = 0; i < n; ++i)
    inverse[static_cast<std::size_t>(i) * static_cast<std::size_t>(n + 1)] = 1.0;
  const auto at = [n](std::vector<double>& m, int i, int j) -> double& {
    return m[static_cast<std::size_t>(i) * static_cast<std::size_t>(n) + static_cast<std::size_t>(j)];
  };
  for (int k = 0; k < n; ++k) {
    int pivot = k;
    for (int i = k + 1; i < n; ++i)
      if (std::abs(at(a, i, k)) > std::abs(at(a, pivot, k))) pivot = i;
    if (!(std::abs(at(a, pivot, k)) > 0.0)) return false;
    for (int j = 0; j < n; ++j) {
      std::swap(at(a, k, j), at(a, pivot, j));
      std::swap(at(inverse, k, j), at(inverse, pivot, j));
    }
    const double by = 1.0 / at(a, k, k);
    for (int j = 0; j < n; ++j) {
      at(a, k, j) *= by;
      at(inverse, k, j) *= by;
    }
    for (int i = 0; i < n; ++i) {
      const double factor = at(a, i, k);
      if (i == k || factor == 0.0) continue;
      for (int j = 0; j < n; ++j) {
        at(a, i, j) -= factor * at(a, k, j);
        at(inverse, i, j) -= factor * at(inverse, k, j);
      }
    }
  }
  a = std::move(inverse);
  return true;
}

/// y = matrix x. Sizes of the elements there are are known at compile time.
template <int Size>
void multiply(const double* matrix, const double* x, double* y) {
  for (int i = 0; i < Size; ++i) {
    double sum = 0.0;
    for (int j = 0; j < Size; ++j)
      sum += matrix[i * Size + j] * x[j];
    y[i] = sum;
  }
}

void multiply(int size, const double* matrix, const double* x, double* y) {
  switch (size) {
    case 1:
      return multiply<1>(matrix, x, y);
    case 2:
      return multiply<2>(matrix, x, y);
    case 4:
      return multiply<4>(matrix, x, y);
    case 5:
      return multiply<5>(matrix, x, y);
    default:
      for (int i = 0; i < size; ++i) {
        double sum = 0.0;
        for (int j = 0; j < size; ++j)
          sum += matrix[i * size + j] * x[j];
        y[i] = sum;
      }
  }
}

bool finite(double bound) {
  return bound > PETSC_NINFINITY && bound < PETSC_INFINITY;
}

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
  if (worthwhile())
    find_scalars();
  else
    forget_blocks();
}

void BlockSweeps::forget_blocks() {
  blocks_ = {};
  reading_ = {};
  entries_ = {};
  read_ = {};
  inverses_ = {};
  active_ = {};
}

void BlockSweeps::find_scalars() {
  int all = 1;
  for (const Kind& kind : kinds_)
    if (kind.size != 1 || !(kind.matrix[0] > 0.0)) all = 0;
  MPI_Allreduce(MPI_IN_PLACE, &all, 1, MPI_INT, MPI_LAND, comm_);
  scalars_ = all != 0;
  if (!scalars_) return;
  for (std::size_t e = 0; e + 1 < blocks_.size(); ++e)
    inverse_diagonal_.push_back(1.0 / kinds_[static_cast<std::size_t>(blocks_[e].kind)].matrix[0]);
  forget_blocks();  // K is all that is needed
  read_.assign(static_cast<std::size_t>(count_), 0.0);
}

bool BlockSweeps::find_blocks(const AffineRows& rows, const std::vector<PetscInt>& block) {
  std::map<std::vector<double>, std::int32_t> known;
  std::vector<double> last_matrix;
  std::int32_t last_kind = -1;
  for (PetscInt first = 0; first < count_;) {
    PetscInt end = first + 1;
    while (end < count_ && block[static_cast<std::size_t>(end)] == block[static_cast<std::size_t>(first)])
      ++end;
    const auto size = static_cast<int>(end - first);
    if (size > largest_block) return false;
    std::vector<double> matrix(static_cast<std::size_t>(size * size), 0.0);
    const auto reading = static_cast<std::int32_t>(reading_.size());
    for (PetscInt i = first; i < end; ++i) {
      const auto row = static_cast<std::size_t>(i);
      const auto entries = static_cast<std::int32_t>(entries_.size());
      for (PetscInt k = rows.starts()[row]; k < rows.starts()[row + 1]; ++k) {
        const PetscInt column = rows.columns()[static_cast<std::size_t>(k)];
        const double value = rows.values()[static_cast<std::size_t>(k)];
        if (column >= first && column < end)
          matrix[static_cast<std::size_t>((i - first) * size + column - first)] = value;
        else if (value != 0.0)
          entries_.push_back({column, value});
      }
      if (entries_.size() > static_cast<std::size_t>(entries))
        reading_.push_back({static_cast<std::int32_t>(i - first), entries});
    }
    if (last_kind < 0 || matrix != last_matrix) {
      const auto [at, is_new] = known.try_emplace(matrix, static_cast<std::int32_t>(kinds_.size()));
      if (is_new) kinds_.push_back({size, matrix, {}});
      last_kind = at->second;
      last_matrix = std::move(matrix);
    }
    blocks_.push_back({first, last_kind, reading});
    first = end;
  }
  blocks_.push_back({count_, -1, static_cast<std::int32_t>(reading_.size())});
  reading_.push_back({-1, static_cast<std::int32_t>(entries_.size())});
  read_.resize(reading_.size());
  inverses_.resize(blocks_.size());
  active_.assign(blocks_.size(), 0);
  return true;
}

// About the spectral radius of |inverse| |what blocks read| without active sets: how a vector that is 1 at
// first grows over ten products.
double BlockSweeps::contraction() {
  constexpr int products = 10;
  const Vector vector = make_vector(comm_, count_);
  check(VecSet(vector.get(), 1.0));
  double largest = 1.0;  // of the last product
  std::array<double, largest_block> right{}, left{};
  for (int product = 0; product < products; ++product) {
    const double* others = rows_.ghosts(vector.get());
    const WriteArray x(vector.get());
    largest = 0.0;
    for (std::size_t e = 0; e + 1 < blocks_.size(); ++e) {
      const Block& block = blocks_[e];
      Kind& kind = kinds_[static_cast<std::size_t>(block.kind)];
      const double* inverse = inverse_of(kind, 0);
      if (inverse == nullptr) {  // singular
        largest = HUGE_VAL;
        continue;
      }
      right.fill(0.0);
      for (auto r = block.rows; r < blocks_[e + 1].rows; ++r) {
        const auto row = static_cast<std::size_t>(r);
        for (auto k = reading_[row].entries; k < reading_[row + 1].entries; ++k) {
          const Entry& entry = entries_[static_cast<std::size_t>(k)];
          right[static_cast<std::size_t>(reading_[row].row)] +=
              std::abs(entry.value) *
              (entry.column < count_ ? x[entry.column] : others[entry.column - count_]);
        }
      }
      for (int i = 0; i < kind.size; ++i) {
        double sum = 0.0;
        for (int j = 0; j < kind.size; ++j)
          sum += std::abs(inverse[i * kind.size + j]) * right[static_cast<std::size_t>(j)];
        left[static_cast<std::size_t>(i)] = sum;
        largest = std::max(largest, sum);
      }
      std::copy_n(left.begin(), kind.size, x.data() + block.first);
    }
  }
  return std::pow(largest, 1.0 / products);
}

// The matrix of a set has identity rows where it is active. Null if it is singular.
const double* BlockSweeps::inverse_of(Kind& kind, Mask active) {
  for (const Pattern& pattern : kind.patterns)
    if (pattern.active == active) return pattern.inverse.empty() ? nullptr : pattern.inverse.data();
  Pattern pattern{active, kind.matrix};
  for (int i = 0; i < kind.size; ++i) {
    if ((active >> i & 1U) == 0) continue;
    for (int j = 0; j < kind.size; ++j)
      pattern.inverse[static_cast<std::size_t>(i) * static_cast<std::size_t>(kind.size) +
                      static_cast<std::size_t>(j)] = i == j ? 1.0 : 0.0;
  }
  if (!invert(pattern.inverse, kind.size)) pattern.inverse.clear();
  kind.patterns.push_back(std::move(pattern));
  const std::vector<double>& inverse = kind.patterns.back().inverse;
  return inverse.empty() ? nullptr : inverse.data();
}

// Semismooth Newton on one block, as Predictor does on all; where that repeats itself, every set.
const double* BlockSweeps::solve_block(Kind& kind, const double* right, const double* lower,
                                       const double* upper, double* u, Mask& active) {
  const int size = kind.size;
  // From the guess, u = u_0 + inverse (right - K u_0): errors of the inverse then are relative to the change.
  std::array<double, largest_block> start, off, given;  // NOLINT: filled as far as they are read
  std::copy_n(u, size, start.begin());
  multiply(size, kind.matrix.data(), u, off.data());
  for (int i = 0; i < size; ++i)
    off[static_cast<std::size_t>(i)] = right[i] - off[static_cast<std::size_t>(i)];
  Mask above = 0;
  const auto bound_of = [&](int i) { return (above >> i & 1U) != 0 ? upper[i] : lower[i]; };
  const auto try_set = [&]() -> const double* {
    const double* inverse = inverse_of(kind, active);
    if (inverse == nullptr) return nullptr;
    if (active == 0) {
      multiply(size, inverse, off.data(), u);
    } else {
      for (int i = 0; i < size; ++i) {
        const auto k = static_cast<std::size_t>(i);
        given[k] = (active >> i & 1U) == 0 ? off[k] : bound_of(i) - start[k];
      }
      multiply(size, inverse, given.data(), u);
    }
    for (int i = 0; i < size; ++i)
      u[i] = (active >> i & 1U) == 0 ? start[static_cast<std::size_t>(i)] + u[i] : bound_of(i);
    return inverse;
  };
  const auto classify = [&]() {
    Mask now = 0, now_above = 0;
    for (int i = 0; i < size; ++i) {
      const bool has_lower = lower[i] > PETSC_NINFINITY, has_upper = upper[i] < PETSC_INFINITY;
      if (!has_lower && !has_upper) continue;
      const double* row = kind.matrix.data() + static_cast<std::ptrdiff_t>(i) * size;
      double f = 0.0, terms = std::abs(right[i]);
      for (int j = 0; j < size; ++j) {
        const double product = row[j] * u[j];
        f += product;
        terms += std::abs(product);
      }
      f = (active >> i & 1U) != 0 ? f - right[i] : 0.0;
      const double shifted = u[i] - f;
      if (has_lower && shifted <= lower[i] + slack_ * terms)
        now |= Mask{1} << i;
      else if (has_upper && shifted >= upper[i] - slack_ * terms)
        now |= Mask{1} << i, now_above |= Mask{1} << i;
    }
    return std::pair{now, now_above};
  };
  for (int i = 0; i < size; ++i)
    if ((active >> i & 1U) != 0 && finite(upper[i]) && !(u[i] <= lower[i])) above |= Mask{1} << i;
  for (int tried = 0; tried < most_sets; ++tried) {
    const double* inverse = try_set();
    if (inverse == nullptr) break;
    const auto [now, now_above] = classify();
    if (now == active && now_above == above) return inverse;
    active = now;
    above = now_above;
  }
  std::array<int, most_bounds> bounded{};
  int bounds = 0;
  for (int i = 0; i < size; ++i)
    for (const bool is_upper : {false, true}) {
      if (!finite(is_upper ? upper[i] : lower[i])) continue;
      if (bounds == most_bounds) return nullptr;
      bounded[static_cast<std::size_t>(bounds++)] = 2 * i + (is_upper ? 1 : 0);
    }
  for (Mask chosen = 0; chosen < Mask{1} << bounds; ++chosen) {
    active = above = 0;
    bool twice = false;
    for (int k = 0; k < bounds; ++k) {
      if ((chosen >> k & 1U) == 0) continue;
      const int bound = bounded[static_cast<std::size_t>(k)];
      const Mask bit = Mask{1} << bound / 2;
      twice = twice || (active & bit) != 0;
      active |= bit;
      if (bound % 2 == 1) above |= bit;
    }
    if (twice) continue;
    const double* inverse = try_set();
    if (inverse != nullptr && classify() == std::pair{active, above}) return inverse;
  }
  return nullptr;
}

// What a row reads from other blocks, and the sum of the absolute values of its terms.
std::pair<double, double> BlockSweeps::read(std::int32_t row, const double* u, const double* others) const {
  const auto r = static_cast<std::size_t>(row);
  double sum = 0.0;
  double size = 0.0;
  for (auto k = reading_[r].entries; k < reading_[r + 1].entries; ++k) {
    const Entry& entry = entries_[static_cast<std::size_t>(k)];
    const double term =
        entry.value * (entry.column < count_ ? u[entry.column] : others[entry.column - count_]);
    sum += term;
    size += std::abs(term);
  }
  return {sum, size};
}

bool BlockSweeps::first_sweep(double* u, const double* b, const double* lower, const double* upper,
                              const double* others) {
  std::array<double, largest_block> right{};
  for (std::size_t e = 0; e + 1 < blocks_.size(); ++e) {
    const Block& block = blocks_[e];
    Kind& kind = kinds_[static_cast<std::size_t>(block.kind)];
    const PetscInt first = block.first;
    std::copy_n(b + first, kind.size, right.begin());
    for (auto r = block.rows; r < blocks_[e + 1].rows; ++r) {
      const auto row = static_cast<std::size_t>(r);
      read_[row] = read(r, u, others).first;
      right[static_cast<std::size_t>(reading_[row].row)] -= read_[row];
    }
    Mask active = 0;
    for (int i = 0; i < kind.size; ++i)
      if (u[first + i] <= lower[first + i] || u[first + i] >= upper[first + i]) active |= Mask{1} << i;
    inverses_[e] = solve_block(kind, right.data(), lower + first, upper + first, u + first, active);
    if (inverses_[e] == nullptr) return false;
    active_[e] = active;
  }
  return true;
}

// With the sets of the first sweep: u changes by the inverse times the change of what is read. Returns the
// largest such change over its terms.
double BlockSweeps::next_sweep(double* u, const double* others) {
  double change = 0.0;
  for (std::size_t e = 0; e + 1 < blocks_.size(); ++e) {
    const Block& block = blocks_[e];
    const int size = kinds_[static_cast<std::size_t>(block.kind)].size;
    for (auto r = block.rows; r < blocks_[e + 1].rows; ++r) {
      const auto row = static_cast<std::size_t>(r);
      const auto [now, size_read] = read(r, u, others);
      const double by = now - read_[row];
      read_[row] = now;
      const int j = reading_[row].row;
      if (by == 0.0 || (active_[e] >> j & 1U) != 0) continue;
      change = std::max(change, std::abs(by) / size_read);
      const double* column = inverses_[e] + j;
      for (int i = 0; i < size; ++i)
        u[block.first + i] -= column[static_cast<std::ptrdiff_t>(i) * size] * by;
    }
  }
  MPI_Allreduce(MPI_IN_PLACE, &change, 1, MPI_DOUBLE, MPI_MAX, comm_);
  return change;
}

void BlockSweeps::refine(Vec u, Vec f) {
  if (scalars_) return;  // each of their sweeps does that
  std::array<double, largest_block> residual{}, by{};
  const WriteArray x(u);
  const ReadArray off(f);
  for (std::size_t e = 0; e + 1 < blocks_.size(); ++e) {
    const PetscInt first = blocks_[e].first;
    const int size = kinds_[static_cast<std::size_t>(blocks_[e].kind)].size;
    for (int i = 0; i < size; ++i)
      residual[static_cast<std::size_t>(i)] = (active_[e] >> i & 1U) != 0 ? 0.0 : off[first + i];
    multiply(size, inverses_[e], residual.data(), by.data());
    for (int i = 0; i < size; ++i)
      x[first + i] -= by[static_cast<std::size_t>(i)];
  }
}

// From u to `next`: without what a row reads of this sweep's own, which one unknown after the other would
// wait for. Returns the largest change of an unknown over what its row is made of.
double BlockSweeps::scalar_sweep(const double* u, const double* b, const double* lower, const double* upper,
                                 const double* others, double* next) const {
  const PetscInt* starts = rows_.starts().data();
  const PetscInt* columns = rows_.columns().data();
  const double* values = rows_.values().data();
  double change = 0.0;
  for (PetscInt i = 0; i < count_; ++i) {
    double sum = b[i];
    double size = std::abs(b[i]);
    for (PetscInt k = starts[i]; k < starts[i + 1]; ++k) {
      const PetscInt column = columns[k];
      const double term = values[k] * (column < count_ ? u[column] : others[column - count_]);
      sum -= term;
      size += std::abs(term);
    }
    const double by = inverse_diagonal_[static_cast<std::size_t>(i)];
    next[i] = std::min(std::max(u[i] + sum * by, lower[i]), upper[i]);
    const double moved = std::abs(next[i] - u[i]);
    if (moved > change * size * by) change = moved / (size * by);
  }
  return change;
}

bool BlockSweeps::solve_scalars(Vec u, Vec b, Vec lower, Vec upper) {
  const ReadArray right(b);
  const ReadArray l(lower);
  const ReadArray h(upper);
  for (int sweep = 0; sweep < most_sweeps; ++sweep) {
    const double* others = rows_.ghosts(u);
    double change = 0.0;
    {
      const WriteArray x(u);
      change = scalar_sweep(x.data(), right.data(), l.data(), h.data(), others, read_.data());
      std::copy(read_.begin(), read_.end(), x.data());
    }
    MPI_Allreduce(MPI_IN_PLACE, &change, 1, MPI_DOUBLE, MPI_MAX, comm_);
    if (change * rate_ <= settled) break;
  }
  return true;
}

bool BlockSweeps::solve(Vec u, Vec b, Vec lower, Vec upper) {
  if (scalars_) return solve_scalars(u, b, lower, upper);
  {
    const double* others = rows_.ghosts(u);
    const WriteArray x(u);
    const ReadArray right(b);
    const ReadArray l(lower);
    const ReadArray h(upper);
    int failed = first_sweep(x.data(), right.data(), l.data(), h.data(), others) ? 0 : 1;
    MPI_Allreduce(MPI_IN_PLACE, &failed, 1, MPI_INT, MPI_LOR, comm_);
    if (failed != 0) return false;
  }
  for (int sweep = 1; sweep < most_sweeps; ++sweep) {
    const double* others = rows_.ghosts(u);
    const WriteArray x(u);
    const double change = next_sweep(x.data(), others);
    // The next one would change that much times the contraction.
    if (change * rate_ <= settled) break;
  }
  return true;
}

}  // namespace sweepvi
