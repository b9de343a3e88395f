#include "vi/small_box.hpp"

#include <petscsnes.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <utility>

namespace sweepvi {

namespace {

constexpr int most_sets = 12;   // tried one after the other, before all of them are
constexpr int most_bounds = 8;  // of a box whose sets are all tried

std::size_t place(int stride, int i, int j) {
  return static_cast<std::size_t>(j) * static_cast<std::size_t>(stride) + static_cast<std::size_t>(i);
}

/// Gauss and Jordan, with exchange of rows; columns that are `stride` apart. Empty if it is singular.
std::vector<double> inverse_of_columns(std::vector<double> a, int n, int stride) {
  std::vector<double> inverse(a.size(), 0.0);
  for (int i = 0; i < n; ++i)
    inverse[place(stride, i, i)] = 1.0;
  const auto at = [stride](std::vector<double>& m, int i, int j) -> double& {
    return m[place(stride, i, j)];
  };
  for (int k = 0; k < n; ++k) {
    int pivot = k;
    for (int i = k + 1; i < n; ++i)
      if (std::abs(at(a, i, k)) > std::abs(at(a, pivot, k))) pivot = i;
    if (!(std::abs(at(a, pivot, k)) > 0.0)) return {};
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
  return inverse;
}

bool has_lower(double bound) {
  return bound > PETSC_NINFINITY;
}
bool has_upper(double bound) {
  return bound < PETSC_INFINITY;
}

}  // namespace

SmallBox::SmallBox(int size, std::vector<double> matrix)
    : size_(size), stride_(size + size % 2), matrix_(std::move(matrix)) {
  columns_.assign(static_cast<std::size_t>(stride_) * static_cast<std::size_t>(size_), 0.0);
  row_sums_.assign(static_cast<std::size_t>(size_), 0.0);
  for (int i = 0; i < size_; ++i)
    for (int j = 0; j < size_; ++j) {
      const double entry = matrix_[place(size_, j, i)];
      columns_[place(stride_, i, j)] = entry;
      row_sums_[static_cast<std::size_t>(i)] += std::abs(entry);
    }
  find_chain();
}

std::vector<int> reading_order(const std::vector<double>& matrix, int size) {
  const auto reads = [&](int i, int j) { return j != i && matrix[place(size, j, i)] != 0.0; };
  std::vector<int> order;
  std::vector<char> taken(static_cast<std::size_t>(size), 0);
  while (static_cast<int>(order.size()) < size) {
    int next = -1, most_read = -1;
    for (int i = 0; i < size; ++i) {
      if (taken[static_cast<std::size_t>(i)] != 0) continue;
      int behind = 0, read = 0;
      for (int j = 0; j < size; ++j) {
        if (!reads(i, j)) continue;
        ++read;
        if (taken[static_cast<std::size_t>(j)] == 0) ++behind;
      }
      const int rank = behind == 0 ? size : read;
      if (rank > most_read) {
        most_read = rank;
        next = i;
      }
    }
    taken[static_cast<std::size_t>(next)] = 1;
    order.push_back(next);
  }
  return order;
}

// Summing rows in that order must not make much of the errors there are: none that is 1 in all unknowns may
// grow beyond `most`.
void SmallBox::find_chain() {
  constexpr double most = 2.0;
  const auto entry = [&](int i, int j) { return matrix_[place(size_, j, i)]; };
  for (const int next : reading_order(matrix_, size_)) {
    const double by = 1.0 / entry(next, next);
    for (int j = 0; j < size_; ++j)
      if (j != next && entry(next, j) != 0.0) reads_.push_back({j, by * entry(next, j)});
    chain_.push_back({next, static_cast<int>(reads_.size()), by});
  }
  std::vector<double> error(static_cast<std::size_t>(size_), 1.0);
  if (mended_error(error) <= most) return;
  chain_.clear();  // it is more, or not a number
  reads_.clear();
}

// What is left of errors at most, and their largest.
double SmallBox::mended_error(std::vector<double>& error) const {
  double worst = 0.0;
  auto read = reads_.begin();
  for (const Row& row : chain_) {
    double sum = 0.0;
    for (; read < reads_.begin() + row.end; ++read)
      sum += std::abs(read->value) * error[static_cast<std::size_t>(read->column)];
    error[static_cast<std::size_t>(row.row)] = sum;
    worst = sum > worst || std::isnan(sum) ? sum : worst;
  }
  return worst;
}

void SmallBox::mend(const double* right, Mask active, double* u) const {
  const Read* const reads = reads_.data();
  const Read* read = reads;
  for (const Row& row : chain_) {
    const Read* const end = reads + row.end;
    if ((active >> row.row & 1U) == 0) {
      double sum = right[row.row] * row.by;
      for (; read < end; ++read)
        sum -= read->value * u[read->column];
      u[row.row] = sum;
    }
    read = end;
  }
}

const double* SmallBox::inverse_of(Mask active) {
  for (const Set& set : sets_)
    if (set.active == active) return set.inverse.empty() ? nullptr : set.inverse.data();
  std::vector<double> matrix = columns_;
  for (int i = 0; i < size_; ++i)
    if ((active >> i & 1U) != 0)
      for (int j = 0; j < size_; ++j)
        matrix[place(stride_, i, j)] = i == j ? 1.0 : 0.0;
  sets_.push_back({active, inverse_of_columns(std::move(matrix), size_, stride_)});
  const std::vector<double>& inverse = sets_.back().inverse;
  return inverse.empty() ? nullptr : inverse.data();
}

/// One solve: what it is given, and the set being tried. Where the size is known at compile time loops are
/// straight code; Fixed = 0: it is not.
template <int Fixed>
class SmallBox::Attempt {
public:
  // NOLINTNEXTLINE(cppcoreguidelines-pro-type-member-init): filled as far as they are read
  Attempt(SmallBox& box, const double* right, const double* lower, const double* upper, double slack,
          const double* guess, double* u)
      : box_(box), right_(right), lower_(lower), upper_(upper), slack_(slack), u_(u) {
    // From the guess, u = u_0 + inverse (right - M u_0): errors of the inverse then are relative to the
    // change.
    const auto last = static_cast<std::size_t>(stride() - 1);
    start_[last] = off_[last] = 0.0;
    for (int i = 0; i < size(); ++i) {
      const auto k = static_cast<std::size_t>(i);
      start_[k] = guess[i];
      off_[k] = right[i];
      if (has_lower(lower[i]) || has_upper(upper[i])) bounded_ |= Mask{1} << i;
    }
    for (int j = 0; j < size(); ++j)
      add_product(box.columns_.data(), j, -start_[static_cast<std::size_t>(j)], off_);
  }

  /// Semismooth Newton, as Predictor does on all unknowns of a step; where it repeats itself, every set.
  const double* solve(Mask& active) {
    active_ = active & bounded_;
    for (Mask rest = active_; rest != 0; rest &= rest - 1) {
      const int i = std::countr_zero(rest);
      if (has_upper(upper_[i]) && !(start_[static_cast<std::size_t>(i)] <= lower_[i])) above_ |= Mask{1} << i;
    }
    const double* inverse = iterate();
    if (inverse == nullptr) {
      mends_ = !box_.chain_.empty();
      inverse = mends_ ? iterate() : nullptr;
    }
    if (inverse == nullptr) inverse = enumerate();
    active = active_;
    return inverse;
  }

private:
  using Values = std::array<double, largest>;
  int size() const { return Fixed > 0 ? Fixed : box_.size_; }
  int stride() const { return Fixed > 0 ? Fixed + Fixed % 2 : box_.stride_; }
  void add_product(const double* columns, int j, double factor, Values& to) const {
    const double* column = columns + static_cast<std::ptrdiff_t>(j) * stride();
    for (int i = 0; i < stride(); ++i)
      to[static_cast<std::size_t>(i)] += factor * column[i];
  }
  double bound_of(int i) const { return (above_ >> i & 1U) != 0 ? upper_[i] : lower_[i]; }

  const double* iterate() {
    for (int tried = 0; tried < most_sets; ++tried) {
      const double* inverse = try_set();
      if (inverse == nullptr) return nullptr;
      const auto [now, now_above] = classify();
      if (now == active_ && now_above == above_) return inverse;
      active_ = now;
      above_ = now_above;
    }
    return nullptr;
  }

  // u of the set. Null if its matrix is singular.
  const double* try_set() {
    const double* inverse = box_.inverse_of(active_);
    if (inverse == nullptr) return nullptr;
    Values given = off_;
    for (Mask rest = active_; rest != 0; rest &= rest - 1) {
      const int i = std::countr_zero(rest);
      given[static_cast<std::size_t>(i)] = bound_of(i) - start_[static_cast<std::size_t>(i)];
    }
    Values now{};
    for (int j = 0; j < size(); ++j)
      add_product(inverse, j, given[static_cast<std::size_t>(j)], now);
    largest_ = 0.0;
    for (int i = 0; i < size(); ++i) {
      u_[i] = start_[static_cast<std::size_t>(i)] + now[static_cast<std::size_t>(i)];
      largest_ = std::max(largest_, std::abs(u_[i]));
    }
    for (Mask rest = active_; rest != 0; rest &= rest - 1) {
      const int i = std::countr_zero(rest);
      u_[i] = bound_of(i);
    }
    if (mends_) box_.mend(right_, active_, u_);
    return inverse;
  }

  // The set that u, and F in rows that are active, ask for: which are, and which of them above.
  std::pair<Mask, Mask> classify() const {
    Mask now = 0, now_above = 0;
    for (Mask rest = bounded_; rest != 0; rest &= rest - 1) {
      const int i = std::countr_zero(rest);
      const bool is_active = (active_ >> i & 1U) != 0;
      // Far from a bound terms need not be known.
      const double at_most =
          std::abs(slack_) * (std::abs(right_[i]) + box_.row_sums_[static_cast<std::size_t>(i)] * largest_);
      if (!is_active && u_[i] > lower_[i] + at_most && u_[i] < upper_[i] - at_most) continue;
      const double* row = box_.matrix_.data() + static_cast<std::ptrdiff_t>(i) * size();
      double f = 0.0, terms = std::abs(right_[i]);
      for (int j = 0; j < size(); ++j) {
        const double product = row[j] * u_[j];
        f += product;
        terms += std::abs(product);
      }
      f = is_active ? f - right_[i] : 0.0;
      const double shifted = u_[i] - f;
      if (has_lower(lower_[i]) && shifted <= lower_[i] + slack_ * terms)
        now |= Mask{1} << i;
      else if (has_upper(upper_[i]) && shifted >= upper_[i] - slack_ * terms)
        now |= Mask{1} << i, now_above |= Mask{1} << i;
    }
    return {now, now_above};
  }

  const double* enumerate() {
    std::array<int, most_bounds> bounded{};
    int bounds = 0;
    for (int i = 0; i < size(); ++i)
      for (const bool is_upper : {false, true}) {
        if (!(is_upper ? has_upper(upper_[i]) && upper_[i] > PETSC_NINFINITY
                       : has_lower(lower_[i]) && lower_[i] < PETSC_INFINITY))
          continue;
        if (bounds == most_bounds) return nullptr;
        bounded[static_cast<std::size_t>(bounds++)] = 2 * i + (is_upper ? 1 : 0);
      }
    for (Mask chosen = 0; chosen < Mask{1} << bounds; ++chosen) {
      active_ = above_ = 0;
      bool twice = false;
      for (int k = 0; k < bounds; ++k) {
        if ((chosen >> k & 1U) == 0) continue;
        const int bound = bounded[static_cast<std::size_t>(k)];
        const Mask bit = Mask{1} << bound / 2;
        twice = twice || (active_ & bit) != 0;
        active_ |= bit;
        if (bound % 2 == 1) above_ |= bit;
      }
      if (twice) continue;
      const double* inverse = try_set();
      if (inverse != nullptr && classify() == std::pair{active_, above_}) return inverse;
    }
    return nullptr;
  }

  SmallBox& box_;
  const double* right_;
  const double* lower_;
  const double* upper_;
  double slack_;
  double* u_;
  Values start_, off_;  // NOLINT: filled as far as they are read
  Mask bounded_ = 0, active_ = 0, above_ = 0;
  bool mends_ = false;    // small numbers may have drowned in large ones
  double largest_ = 0.0;  // |u_i|
};

template <int Fixed>
const double* SmallBox::solve_sized(
    const double* right, const double* lower, const double* upper, double slack, const double* guess,
    double* u,  // NOLINT(readability-non-const-parameter): the attempt writes it
    Mask& active) {
  return Attempt<Fixed>(*this, right, lower, upper, slack, guess, u).solve(active);
}

const double* SmallBox::solve(const double* right, const double* lower, const double* upper, double slack,
                              const double* guess, double* u, Mask& active) {
  switch (size_) {
    case 1:
      return solve_sized<1>(right, lower, upper, slack, guess, u, active);
    case 2:
      return solve_sized<2>(right, lower, upper, slack, guess, u, active);
    case 4:
      return solve_sized<4>(right, lower, upper, slack, guess, u, active);
    case 5:
      return solve_sized<5>(right, lower, upper, slack, guess, u, active);
    default:
      return solve_sized<0>(right, lower, upper, slack, guess, u, active);
  }
}

}  // namespace sweepvi
