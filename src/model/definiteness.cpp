#include "model/definiteness.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/OrderingMethods>
#include <Eigen/Sparse>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <utility>

#include "parallel/gather.hpp"
#include "parallel/memory.hpp"

namespace sweepvi {

namespace {

constexpr std::size_t most_named = 8;
constexpr int lanczos_steps = 80;

/// (A + A') / 2.
Matrix symmetric_part(Mat matrix) {
  Matrix sum = add(matrix, 1.0, transpose(matrix).get());
  check(MatScale(sum.get(), 0.5));
  return sum;
}

/// 1 / sqrt(a_jj), or the first row on any rank whose diagonal entry is not positive.
struct UnitDiagonal {
  Vector scale;
  std::optional<std::pair<PetscInt, double>> refused;  // row and entry
};

UnitDiagonal unit_diagonal(Mat matrix) {
  UnitDiagonal result;
  check(MatCreateVecs(matrix, result.scale.put(), nullptr));
  check(MatGetDiagonal(matrix, result.scale.get()));
  PetscInt row = 0;
  double least = 0.0;
  check(VecMin(result.scale.get(), &row, &least));
  if (!(least > 0.0)) {
    result.refused = {row, least};
    return result;
  }
  check(VecSqrtAbs(result.scale.get()));
  check(VecReciprocal(result.scale.get()));
  return result;
}

/// Whether a_jj x_j > sum_k |a_jk| x_k in all rows, clear of rounding, for x = 1 or for x = `weights`.
bool is_dominant(Mat matrix, Vec weights) {
  int dominant[2] = {1, 1};
  Vector off = duplicate(weights);
  Vector sums = duplicate(weights);
  const Matrix size = absolute_copy(matrix);
  for (int k = 0; k < 2; ++k) {
    if (k == 0)
      check(VecSet(off.get(), 1.0));
    else
      check(VecCopy(weights, off.get()));
    check(MatMult(size.get(), off.get(), sums.get()));
    const ReadArray x(off.get());
    const ReadArray all(sums.get());
    const PetscInt first = row_range(matrix).first;
    for_each_row(matrix, [&](PetscInt row, auto columns, auto values) {
      double diagonal = 0.0;
      for (std::size_t i = 0; i < columns.size(); ++i)
        if (columns[i] == row) diagonal = values[i];
      const double own = diagonal * x[row - first];
      const double others = all[row - first] - std::abs(own);
      const double noise = static_cast<double>(columns.size() + 8) * std::numeric_limits<double>::epsilon();
      if (!(own - others > noise * all[row - first])) dominant[k] = 0;
    });
  }
  MPI_Allreduce(MPI_IN_PLACE, dominant, 2, MPI_INT, MPI_LAND,
                PetscObjectComm(reinterpret_cast<PetscObject>(matrix)));
  return dominant[0] != 0 || dominant[1] != 0;
}

using Columns = Eigen::SparseMatrix<double, Eigen::ColMajor, int>;

/// A symmetric matrix in an order of low fill, with what its factorization takes.
class Factorization {
public:
  explicit Factorization(const Columns& symmetric) {
    Eigen::PermutationMatrix<Eigen::Dynamic, Eigen::Dynamic, int> order;
    Eigen::AMDOrdering<int>()(symmetric, order);
    order_.assign(order.indices().data(), order.indices().data() + order.size());  // new -> old
    std::vector<int> place(order_.size());
    for (std::size_t i = 0; i < order_.size(); ++i)
      place[static_cast<std::size_t>(order_[i])] = static_cast<int>(i);
    // Row k of the lower triangle in the new order.
    starts_.assign(order_.size() + 1, 0);
    const auto each_lower = [&](auto&& visit) {
      for (int j = 0; j < symmetric.outerSize(); ++j)
        for (Columns::InnerIterator entry(symmetric, j); entry; ++entry) {
          const int row = place[static_cast<std::size_t>(entry.row())];
          const int column = place[static_cast<std::size_t>(entry.col())];
          if (column <= row) visit(static_cast<std::size_t>(row), column, entry.value());
        }
    };
    each_lower([&](std::size_t row, int, double) { ++starts_[row + 1]; });
    std::partial_sum(starts_.begin(), starts_.end(), starts_.begin());
    columns_.resize(starts_.back());
    values_.resize(starts_.back());
    std::vector<std::size_t> next(starts_.begin(), starts_.end() - 1);
    each_lower([&](std::size_t row, int column, double value) {
      columns_[next[row]] = column;
      values_[next[row]++] = value;
    });
  }

  /// Elimination tree and entries of each column of L. @return false if it takes more than is allowed
  bool count(double multiplications, double entries) {
    const std::size_t n = order_.size();
    parent_.assign(n, -1);
    column_counts_.assign(n, 0);
    std::vector<int> flag(n, -1);
    double work = 0.0;
    double fill = 0.0;
    for (std::size_t k = 0; k < n; ++k) {
      const int here = static_cast<int>(k);
      flag[k] = here;
      for (std::size_t p = starts_[k]; p < starts_[k + 1]; ++p)
        for (int i = columns_[p]; flag[index(i)] != here; i = parent_[index(i)]) {
          if (parent_[index(i)] == -1) parent_[index(i)] = here;
          work += static_cast<double>(++column_counts_[index(i)]);
          fill += 1.0;
          flag[index(i)] = here;
        }
      if (work > multiplications || fill > entries) return false;
    }
    return true;
  }

  /// L D L' until a pivot is not above rounding of ones; then x with L' x = e_k, so x' A x = d_k.
  /// @return x in the matrix's own order with that d_k, or nothing if all pivots are positive
  std::optional<std::pair<std::vector<double>, double>> vector_below_zero() const {
    const std::size_t n = order_.size();
    std::vector<std::size_t> begin(n + 1, 0);
    for (std::size_t i = 0; i < n; ++i)
      begin[i + 1] = begin[i] + static_cast<std::size_t>(column_counts_[i]);
    std::vector<int> rows(begin.back());
    std::vector<double> factors(begin.back());
    std::vector<std::size_t> end(begin.begin(), begin.end() - 1);
    std::vector<double> pivots(n, 0.0);
    std::vector<double> sums(n, 0.0);
    std::vector<int> flag(n, -1);
    std::vector<int> pattern(n);
    for (std::size_t k = 0; k < n; ++k) {
      const int here = static_cast<int>(k);
      flag[k] = here;
      std::size_t top = n;
      for (std::size_t p = starts_[k]; p < starts_[k + 1]; ++p) {
        sums[index(columns_[p])] += values_[p];
        std::size_t length = 0;
        for (int i = columns_[p]; flag[index(i)] != here; i = parent_[index(i)]) {
          pattern[length++] = i;
          flag[index(i)] = here;
        }
        while (length > 0)
          pattern[--top] = pattern[--length];
      }
      double pivot = std::exchange(sums[k], 0.0);
      for (std::size_t t = top; t < n; ++t) {
        const std::size_t i = index(pattern[t]);
        const double sum = std::exchange(sums[i], 0.0);
        for (std::size_t p = begin[i]; p < end[i]; ++p)
          sums[index(rows[p])] -= factors[p] * sum;
        const double factor = sum / pivots[i];
        pivot -= factor * sum;
        rows[end[i]] = here;
        factors[end[i]++] = factor;
      }
      // What a sum of so many terms of size 1 leaves where it should be 0.
      const double noise =
          (64.0 + 4.0 * static_cast<double>(n - top)) * std::numeric_limits<double>::epsilon();
      if (!(pivot > noise)) {
        std::vector<double> x(n, 0.0);
        sums[k] = 1.0;
        for (std::size_t j = k; j-- > 0;) {
          double sum = 0.0;
          for (std::size_t p = begin[j]; p < end[j]; ++p)
            sum -= factors[p] * sums[index(rows[p])];
          sums[j] = sum;
        }
        for (std::size_t i = 0; i <= k; ++i)
          x[index(order_[i])] = sums[i];
        return std::pair{x, pivot};
      }
      pivots[k] = pivot;
    }
    return {};
  }

private:
  static std::size_t index(int i) { return static_cast<std::size_t>(i); }

  std::vector<int> order_;  // new number -> old
  std::vector<std::size_t> starts_;
  std::vector<int> columns_;
  std::vector<double> values_;
  std::vector<int> parent_, column_counts_;
};

/// Rank 0's part: the matrix scaled to a unit diagonal as `entries`, its scale as `scale`.
/// @return false if it takes too much
bool factor(const std::vector<Triplet>& entries, const std::vector<double>& scale, double allowed,
            Definiteness& result) {
  if (entries.size() > static_cast<std::size_t>(std::numeric_limits<int>::max() / 2)) return false;
  std::vector<Eigen::Triplet<double, int>> triplets;
  triplets.reserve(entries.size());
  for (const Triplet& entry : entries)
    triplets.emplace_back(static_cast<int>(entry.row), static_cast<int>(entry.column),
                          entry.value * scale[static_cast<std::size_t>(entry.row)] *
                              scale[static_cast<std::size_t>(entry.column)]);
  const auto size = static_cast<int>(scale.size());
  Columns symmetric(size, size);
  symmetric.setFromTriplets(triplets.begin(), triplets.end());
  Factorization factorization(symmetric);
  constexpr double bytes_of_entry = sizeof(double) + sizeof(int);
  if (!factorization.count(allowed, 0.25 * available_memory().node / bytes_of_entry)) return false;
  result.how = Definiteness::How::factored;
  const auto found = factorization.vector_below_zero();
  result.definite = !found;
  if (!found) return true;
  std::vector<double> x = found->first;
  for (std::size_t i = 0; i < x.size(); ++i)
    x[i] *= scale[i];
  const auto size_of = [&](std::size_t i) { return std::abs(x[i]); };
  std::vector<std::size_t> order(x.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  const std::size_t named = std::min(most_named, order.size());
  std::partial_sort(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(named), order.end(),
                    [&](std::size_t a, std::size_t b) { return size_of(a) > size_of(b); });
  const double most = size_of(order.front());
  result.form = found->second / (most * most);
  constexpr double worth_naming = 0.1;
  for (std::size_t i = 0; i < named && size_of(order[i]) >= worth_naming * most; ++i)
    result.largest.push_back(static_cast<PetscInt>(order[i]));
  std::sort(result.largest.begin(), result.largest.end());
  return true;
}

/// A start that no symmetry of the matrix is orthogonal to, the same on any number of ranks.
void set_start(Vec start) {
  PetscInt first = 0;
  check(VecGetOwnershipRange(start, &first, nullptr));
  const WriteArray values(start);
  for (PetscInt i = 0; i < values.size(); ++i) {
    const double phase = static_cast<double>(first + i + 1) * 0.6180339887498949;
    values[i] = 0.5 + (phase - std::floor(phase));
    if ((first + i) % 2 != 0) values[i] = -values[i];
  }
}

/// Lanczos' bounds of the smallest eigenvalue of a matrix with a unit diagonal. @note Collective.
void estimate(Mat unit, Definiteness& result) {
  Vector q;
  Vector last;
  check(MatCreateVecs(unit, q.put(), last.put()));
  Vector next = duplicate(q.get());
  set_start(q.get());
  check(VecNormalize(q.get(), nullptr));
  check(VecSet(last.get(), 0.0));
  std::vector<double> alpha;
  std::vector<double> beta;
  PetscInt size = 0;
  check(MatGetSize(unit, &size, nullptr));
  for (int k = 0; k < std::min<PetscInt>(lanczos_steps, size); ++k) {
    check(MatMult(unit, q.get(), next.get()));
    if (k > 0) check(VecAXPY(next.get(), -beta.back(), last.get()));
    double own = 0.0;
    check(VecDot(next.get(), q.get(), &own));
    check(VecAXPY(next.get(), -own, q.get()));
    alpha.push_back(own);
    double norm = 0.0;
    check(VecNorm(next.get(), NORM_2, &norm));
    beta.push_back(norm);
    if (norm <= rounding) break;
    check(VecCopy(q.get(), last.get()));
    check(VecCopy(next.get(), q.get()));
    check(VecScale(q.get(), 1.0 / norm));
  }
  const auto count = static_cast<Eigen::Index>(alpha.size());
  const Eigen::VectorXd diagonal = Eigen::Map<Eigen::VectorXd>(alpha.data(), count);
  const Eigen::VectorXd off = Eigen::Map<Eigen::VectorXd>(beta.data(), std::max<Eigen::Index>(count - 1, 0));
  Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> ritz;
  ritz.computeFromTridiagonal(diagonal, off, Eigen::EigenvaluesOnly);
  result.how = Definiteness::How::estimated;
  result.form = ritz.eigenvalues()(0);
  result.definite = result.form > 0.0;
}

}  // namespace

const char* Definiteness::how_text() const {
  switch (how) {
    case How::dominance:
      return "diagonally dominant";
    case How::factored:
      return "factored";
    case How::estimated:
      return "estimated by Lanczos' method";
  }
  return "";
}

Definiteness examine_definiteness(Mat matrix, double allowed) {
  const MPI_Comm comm = PetscObjectComm(reinterpret_cast<PetscObject>(matrix));
  const Matrix symmetric = symmetric_part(matrix);
  Definiteness result;
  const UnitDiagonal unit = unit_diagonal(symmetric.get());
  if (unit.refused) {
    result.how = Definiteness::How::factored;  // e_j' A e_j is all there is to it
    result.definite = false;
    result.form = unit.refused->second;
    result.largest = {unit.refused->first};
    return result;
  }
  if (is_dominant(symmetric.get(), unit.scale.get())) return result;
  const std::vector<Triplet> entries = gather_entries(symmetric.get());
  std::vector<double> scale;
  {
    const ReadArray mine(unit.scale.get());
    scale = gather(comm, std::vector<double>(mine.data(), mine.data() + mine.size()));
  }
  int decided = 0;
  agreed(comm, [&] {
    if (!scale.empty()) decided = factor(entries, scale, allowed, result) ? 1 : 0;
  });
  MPI_Bcast(&decided, 1, MPI_INT, 0, comm);
  if (decided != 0) {
    int flags[2] = {static_cast<int>(result.how), result.definite ? 1 : 0};
    MPI_Bcast(flags, 2, MPI_INT, 0, comm);
    result.how = static_cast<Definiteness::How>(flags[0]);
    result.definite = flags[1] != 0;
    MPI_Bcast(&result.form, 1, MPI_DOUBLE, 0, comm);
    broadcast(comm, result.largest);
    return result;
  }
  check(MatDiagonalScale(symmetric.get(), unit.scale.get(), unit.scale.get()));
  estimate(symmetric.get(), result);
  return result;
}

}  // namespace sweepvi
