#include "model/bounded_rows.hpp"

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <cstring>

namespace sweepvi {

namespace {

constexpr double half_ulp = 0.5 * std::numeric_limits<double>::epsilon();

struct Split {
  double value, error;  // their sum is exact
};

Split exact_sum(double a, double b) {
  const double sum = a + b;
  const double part = sum - a;
  return {sum, (a - (sum - part)) + (b - part)};
}

Split exact_product(double a, double b) {
  const double product = a * b;
  return {product, std::fma(a, b, -product)};
}

bool is_short_binary(double value) {
  std::uint64_t bits = 0;
  std::memcpy(&bits, &value, sizeof bits);
  constexpr std::uint64_t tail = (std::uint64_t{1} << 21) - 1;  // of 52 stored bits
  return (bits & tail) == 0 || (std::abs(value) <= 0x1p53 && std::trunc(value) == value);
}

bool is_short_decimal(double value) {
  constexpr int digits = 9;
  constexpr int exact_powers = 23;  // 10^22 is the last that a double holds
  static const auto powers = [] {
    std::array<double, exact_powers> all{};
    all[0] = 1.0;
    for (std::size_t k = 1; k < all.size(); ++k)
      all[k] = 10.0 * all[k - 1];
    return all;
  }();
  const int leading = static_cast<int>(std::floor(std::log10(std::abs(value))));
  const int places = digits - 1 - leading;
  if (places >= 0 && places < exact_powers) {
    // Both are exact, so their quotient is the double nearest to that decimal number.
    const double power = powers[static_cast<std::size_t>(places)];
    return std::nearbyint(value * power) / power == value;
  }
  char text[32];
  std::snprintf(text, sizeof text, "%.*e", digits - 1, value);
  return std::strtod(text, nullptr) == value;
}

/// A sum that is being built.
struct Accumulator {
  double high = 0.0, low = 0.0, bound = 0.0, arithmetic = 0.0, magnitude = 0.0;
  bool written = true, used = false;

  void add_low(double term) {
    const Split sum = exact_sum(low, term);
    low = sum.value;
    arithmetic += std::abs(sum.error);
  }

  void add(const BoundedEntry& p, double a, double a_bound) {
    const Split product = exact_product(p.high, a);
    const Split sum = exact_sum(high, product.value);
    high = sum.value;
    add_low(sum.error);
    add_low(product.error);
    if (p.low != 0.0) {
      const Split small = exact_product(p.low, a);
      add_low(small.value);
      arithmetic += std::abs(small.error);
    }
    // Below this the error of a product is no longer a number.
    constexpr double smallest_split = 0x1p-960;
    if (std::abs(product.value) < smallest_split && p.high != 0.0) arithmetic += 0x1p-1060;
    const double size = std::abs(a);
    bound += p.bound * (size + a_bound) + std::abs(p.high + p.low) * a_bound;
    arithmetic += p.arithmetic * size;
    magnitude += p.magnitude * size;
    written = written && p.written;
  }
};

/// The rows of a matrix that these rows need, wherever they live.
class NeededRows {
public:
  /// @note Collective.
  NeededRows(const std::vector<BoundedRow>& rows, Mat matrix) {
    const MPI_Comm comm = PetscObjectComm(reinterpret_cast<PetscObject>(matrix));
    int ranks = 1;
    MPI_Comm_size(comm, &ranks);
    check(MatGetSize(matrix, nullptr, &columns_));
    if (ranks == 1) {
      local_ = matrix;
      return;
    }
    for (const BoundedRow& row : rows)
      for (const BoundedEntry& entry : row)
        numbers_.push_back(entry.column);
    std::sort(numbers_.begin(), numbers_.end());
    numbers_.erase(std::unique(numbers_.begin(), numbers_.end()), numbers_.end());
    IndexSet wanted;
    IndexSet all;
    check(ISCreateGeneral(PETSC_COMM_SELF, static_cast<PetscInt>(numbers_.size()), numbers_.data(),
                          PETSC_COPY_VALUES, wanted.put()));
    check(ISCreateStride(PETSC_COMM_SELF, columns_, 0, 1, all.put()));
    const IS rows_wanted = wanted.get();
    const IS columns_wanted = all.get();
    check(MatCreateSubMatrices(matrix, 1, &rows_wanted, &columns_wanted, MAT_INITIAL_MATRIX, &brought_));
    local_ = brought_[0];
  }
  ~NeededRows() {
    if (brought_ != nullptr) static_cast<void>(MatDestroySubMatrices(1, &brought_));
  }
  NeededRows(const NeededRows&) = delete;
  NeededRows& operator=(const NeededRows&) = delete;

  PetscInt columns() const { return columns_; }

  template <class Visit>
  void row(PetscInt number, Visit&& visit) const {
    const PetscInt at =
        numbers_.empty() ? number
                         : static_cast<PetscInt>(std::lower_bound(numbers_.begin(), numbers_.end(), number) -
                                                 numbers_.begin());
    PetscInt count = 0;
    const PetscInt* columns = nullptr;
    const PetscScalar* values = nullptr;
    check(MatGetRow(local_, at, &count, &columns, &values));
    for (PetscInt k = 0; k < count; ++k)
      if (values[k] != 0.0) visit(columns[k], values[k]);
    check(MatRestoreRow(local_, at, &count, &columns, &values));
  }

private:
  std::vector<PetscInt> numbers_;  // of the rows brought here, sorted; none with one rank
  Mat* brought_ = nullptr;
  Mat local_ = nullptr;
  PetscInt columns_ = 0;
};

}  // namespace

double data_bound(double value) {
  return is_short_binary(value) ? 0.0 : half_ulp * std::abs(value);
}

bool was_written(double value) {
  return is_short_binary(value) || is_short_decimal(value);
}

std::vector<BoundedRow> bounded_rows(Mat matrix) {
  std::vector<BoundedRow> rows;
  for_each_row(matrix, [&](PetscInt, auto columns, auto values) {
    BoundedRow& row = rows.emplace_back();
    for (std::size_t k = 0; k < columns.size(); ++k)
      if (values[k] != 0.0)
        row.push_back({columns[k], values[k], 0.0, data_bound(values[k]), 0.0, std::abs(values[k]),
                       was_written(values[k])});
  });
  return rows;
}

std::vector<BoundedRow> multiply(const std::vector<BoundedRow>& rows, Mat matrix) {
  const NeededRows needed(rows, matrix);
  std::vector<Accumulator> sums(static_cast<std::size_t>(needed.columns()));
  std::vector<PetscInt> touched;
  std::vector<BoundedRow> products;
  products.reserve(rows.size());
  for (const BoundedRow& row : rows) {
    for (const BoundedEntry& entry : row)
      needed.row(entry.column, [&](PetscInt column, double value) {
        Accumulator& sum = sums[static_cast<std::size_t>(column)];
        if (!sum.used) {
          sum.used = true;
          touched.push_back(column);
        }
        sum.add(entry, value, data_bound(value));
        sum.written = sum.written && was_written(value);
      });
    std::sort(touched.begin(), touched.end());
    BoundedRow& product = products.emplace_back();
    product.reserve(touched.size());
    for (const PetscInt column : touched) {
      Accumulator& sum = sums[static_cast<std::size_t>(column)];
      const Split value = exact_sum(sum.high, sum.low);
      product.push_back({column, value.value, value.error, sum.bound + sum.arithmetic, sum.arithmetic,
                         sum.magnitude, sum.written});
      sum = Accumulator{};
    }
    touched.clear();
  }
  return products;
}

double dot(const BoundedRow& a, const BoundedRow& b) {
  Accumulator sum;
  for (auto i = a.begin(), j = b.begin(); i != a.end() && j != b.end();) {
    if (i->column < j->column) {
      ++i;
    } else if (j->column < i->column) {
      ++j;
    } else {
      sum.add(*i, j->high, 0.0);
      if (j->low != 0.0) sum.add(*i, j->low, 0.0);
      ++i, ++j;
    }
  }
  return sum.high + sum.low;
}

SparseRow rounded(const BoundedRow& row) {
  SparseRow values;
  for (const BoundedEntry& entry : row)
    if (!entry.within_bound() && (entry.written || entry.ratio() > rounding))
      values.emplace_back(entry.column, entry.value());
  return values;
}

SparseRow at_face_value(const BoundedRow& row) {
  SparseRow values;
  for (const BoundedEntry& entry : row)
    if (std::abs(entry.value()) > entry.arithmetic) values.emplace_back(entry.column, entry.value());
  return values;
}

}  // namespace sweepvi
