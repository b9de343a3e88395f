#include <Eigen/Dense>
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <string>

#include "model/constraint_names.hpp"
#include "parallel/gather.hpp"
#include "sweepvi/relative_degree.hpp"

namespace sweepvi {

namespace {

constexpr Eigen::Index dense_limit = 300;  // coupled constraints examined densely
constexpr Eigen::Index minors_limit = 14;  // 2^14 principal minors
constexpr double singular_rtol = 1e-12;    // smallest over largest singular value

using Solvability = MarkovReport::Solvability;

/// Constraints coupled through M, directly or over others.
std::vector<std::vector<PetscInt>> coupled_groups(PetscInt count, const std::vector<Triplet>& entries) {
  std::vector<PetscInt> parent(static_cast<std::size_t>(count));
  std::iota(parent.begin(), parent.end(), 0);
  const auto root = [&](PetscInt i) {
    while (parent[static_cast<std::size_t>(i)] != i) {
      auto& up = parent[static_cast<std::size_t>(i)];
      up = parent[static_cast<std::size_t>(up)];
      i = up;
    }
    return i;
  };
  for (const Triplet& entry : entries)
    if (entry.value != 0.0) parent[static_cast<std::size_t>(root(entry.row))] = root(entry.column);
  std::vector<PetscInt> group_of(static_cast<std::size_t>(count), -1);
  std::vector<std::vector<PetscInt>> groups;
  for (PetscInt i = 0; i < count; ++i) {
    PetscInt& group = group_of[static_cast<std::size_t>(root(i))];
    if (group < 0) {
      group = static_cast<PetscInt>(groups.size());
      groups.emplace_back();
    }
    groups[static_cast<std::size_t>(group)].push_back(i);
  }
  return groups;
}

bool all_principal_minors_positive(const Eigen::MatrixXd& m) {
  const Eigen::Index n = m.rows();
  for (unsigned subset = 1; subset < (1U << n); ++subset) {
    std::vector<Eigen::Index> rows;
    for (Eigen::Index i = 0; i < n; ++i)
      if ((subset >> i & 1U) != 0) rows.push_back(i);
    if (m(rows, rows).eval().determinant() <= 0.0) return false;
  }
  return true;
}

std::string list(const std::vector<PetscInt>& numbers) {
  std::string text;
  for (std::size_t i = 0; i < numbers.size() && i < 10; ++i)
    text += (i > 0 ? ", " : "") + std::to_string(numbers[i]);
  return numbers.size() > 10 ? text + ", ..." : text;
}

void take(MarkovReport& report, Solvability found, const std::vector<PetscInt>& names) {
  if (static_cast<int>(found) <= static_cast<int>(report.solvability)) return;
  report.solvability = found;
  report.doubtful_count = static_cast<int>(std::min(names.size(), report.doubtful.size()));
  std::copy_n(names.begin(), report.doubtful_count, report.doubtful.begin());
}

/// Constraints that take part in the null space of a singular group.
std::vector<PetscInt> dependent(const Eigen::MatrixXd& v, const std::vector<PetscInt>& names) {
  std::vector<PetscInt> numbers;
  for (Eigen::Index i = 0; i < v.rows(); ++i)
    if (std::abs(v(i, v.cols() - 1)) > 1e-8) numbers.push_back(names[static_cast<std::size_t>(i)]);
  return numbers;
}

/// Entries in units of the diagonal, M_ij / sqrt(M_ii M_jj): masses of many decades make no matrix singular.
std::vector<Triplet> in_units_of_diagonal(const std::vector<PetscInt>& group, std::vector<Triplet> entries) {
  std::vector<double> root(group.size(), 1.0);
  const auto at = [&](PetscInt number) -> double& {
    return root[static_cast<std::size_t>(std::lower_bound(group.begin(), group.end(), number) -
                                         group.begin())];
  };
  for (const Triplet& entry : entries)
    if (entry.row == entry.column && entry.value > 0.0) at(entry.row) = std::sqrt(entry.value);
  for (Triplet& entry : entries)
    entry.value = entry.value / at(entry.row) / at(entry.column);
  return entries;
}

/// A large group: a sparse Cholesky factorization of its symmetric part, with pivots above rounding, proves
/// it.
bool symmetric_part_is_definite(const std::vector<PetscInt>& group, const std::vector<Triplet>& entries) {
  using SparseMatrix = Eigen::SparseMatrix<double>;
  const auto local = [&](PetscInt number) {
    return std::lower_bound(group.begin(), group.end(), number) - group.begin();
  };
  std::vector<Eigen::Triplet<double, Eigen::Index>> halves;
  double largest = 0.0;
  for (const Triplet& entry : entries) {
    halves.emplace_back(local(entry.row), local(entry.column), 0.5 * entry.value);
    halves.emplace_back(local(entry.column), local(entry.row), 0.5 * entry.value);
    if (entry.row == entry.column) largest = std::max(largest, std::abs(entry.value));
  }
  const auto size = static_cast<Eigen::Index>(group.size());
  SparseMatrix symmetric(size, size);
  symmetric.setFromTriplets(halves.begin(), halves.end());
  const Eigen::SimplicialLDLT<SparseMatrix> factors(symmetric);
  return factors.info() == Eigen::Success && factors.vectorD().minCoeff() > singular_rtol * largest;
}

void examine_group(const std::vector<PetscInt>& group, const std::vector<Triplet>& given, bool first_order,
                   const std::vector<PetscInt>& scene_number, MarkovReport& report) {
  const std::vector<Triplet> entries = in_units_of_diagonal(group, given);
  const auto size = static_cast<Eigen::Index>(group.size());
  std::vector<PetscInt> names;
  names.reserve(group.size());
  for (const PetscInt i : group)
    names.push_back(scene_number[static_cast<std::size_t>(i)]);
  if (size > dense_limit) {
    report.condition_known = false;
    if (!symmetric_part_is_definite(group, entries)) take(report, Solvability::not_checked, names);
    return;
  }
  const auto dense = [&](const std::vector<Triplet>& of) {
    Eigen::MatrixXd matrix = Eigen::MatrixXd::Zero(size, size);
    for (const Triplet& entry : of) {
      const auto i = std::lower_bound(group.begin(), group.end(), entry.row) - group.begin();
      const auto j = std::lower_bound(group.begin(), group.end(), entry.column) - group.begin();
      matrix(i, j) += entry.value;
    }
    return matrix;
  };
  const Eigen::MatrixXd m = dense(entries);
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(m, Eigen::ComputeFullU);
  const double largest = svd.singularValues()(0);
  const double smallest = svd.singularValues()(size - 1);
  const bool singular = smallest <= singular_rtol * largest;
  const Eigen::MatrixXd symmetric = 0.5 * (m + m.transpose());
  const double lowest =
      Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(symmetric, Eigen::EigenvaluesOnly).eigenvalues()(0);
  if (singular && !first_order)
    throw InputError(
        "model: the leading Markov matrix C A^{r-1} B is singular: constraints " +
        list(dependent(svd.matrixU(), names)) +
        " depend on each other, so lambda cannot hold them independently (no vector relative degree); "
        "merge or drop one of them");
  if (!singular) {
    const Eigen::VectorXd values = Eigen::JacobiSVD<Eigen::MatrixXd>(dense(given)).singularValues();
    report.condition = std::max(report.condition, values(0) / values(size - 1));
  }
  if (singular) report.condition = std::numeric_limits<double>::infinity();
  if (lowest > 0.0) return;
  if (first_order && lowest >= -singular_rtol * largest) {
    take(report, Solvability::positive_semidefinite, names);
  } else if (size <= minors_limit) {
    if (!all_principal_minors_positive(m) && !first_order)
      throw InputError(
          "model: the leading Markov matrix C A^{r-1} B of constraints " + list(names) +
          " is not a P-matrix (a principal minor is not positive): a step could have no solution, or "
          "several; check the signs of B and C");
    take(report, first_order ? Solvability::not_checked : Solvability::p_matrix, names);
  } else {
    take(report, Solvability::not_checked, names);
  }
}

}  // namespace

std::string MarkovReport::diagnosis() const {
  const std::string who =
      list({doubtful.begin(), doubtful.begin() + doubtful_count}) + (doubtful_count == 8 ? ", ..." : "");
  switch (solvability) {
    case Solvability::positive_definite:
    case Solvability::p_matrix:
      return {};
    case Solvability::positive_semidefinite:
      return "The leading Markov matrix of constraints " + who +
             " is only positive semidefinite: a step in which they contradict each other has no solution";
    case Solvability::not_checked:
      return "The leading Markov matrix of constraints " + who +
             " is not known to be a P-matrix: a step may have no solution, or several";
  }
  return {};
}

MarkovReport check_markov_matrix(const LinearSystem& system, const RelativeDegree& relative_degree) {
  const MPI_Comm comm = system.comm();
  const bool first_order = relative_degree.highest <= 1;
  std::optional<Error> complaint;
  for (std::size_t a = 0; a < relative_degree.degree.size() && !complaint; ++a) {
    const double own = relative_degree.markov_diagonal[a];
    if (own < 0.0 && relative_degree.degree[a] == 0)
      complaint = InputError("model.D: " + constraint_name(system, a) + " has the negative diagonal entry " +
                             std::to_string(own) +
                             ": a step could have no solution, or several; D must be positive semidefinite");
    else if (own < 0.0)
      complaint =
          InputError("model: " + constraint_name(system, a) +
                     " has a negative leading Markov parameter C A^{r-1} B = " + std::to_string(own) +
                     " (r = " + std::to_string(relative_degree.degree[a]) +
                     "): lambda >= 0 would push it out of its set; change the sign of its column of B");
    else if (own == 0.0 && !first_order)
      complaint = InputError("model: " + constraint_name(system, a) +
                             " is not reached by its own multiplier (diagonal "
                             "entry of C A^{r-1} B is 0, r = " +
                             std::to_string(relative_degree.degree[a]) +
                             "); order the columns of B like the rows of C");
  }
  agree(comm, complaint);

  const std::vector<Triplet> entries = gather_entries(relative_degree.markov.get());
  const std::vector<PetscInt> scene_number = gather(comm, system.constraint_order);
  MarkovReport report;
  agreed(comm, [&] {
    if (scene_number.empty()) return;  // not rank 0
    report.nonzeros = static_cast<PetscInt>(entries.size());
    double smallest = std::numeric_limits<double>::infinity();
    double largest = 0.0;
    bool all_diagonal = true;
    for (const Triplet& entry : entries) {
      if (entry.value == 0.0) continue;
      all_diagonal = all_diagonal && entry.row == entry.column;
      smallest = std::min(smallest, std::abs(entry.value));
      largest = std::max(largest, std::abs(entry.value));
    }
    report.diagonal = all_diagonal;
    if (all_diagonal) {
      report.condition = largest / smallest;  // signs were checked above
      return;
    }
    std::vector<std::vector<PetscInt>> groups =
        coupled_groups(static_cast<PetscInt>(scene_number.size()), entries);
    std::vector<PetscInt> group_of(scene_number.size());
    for (std::size_t g = 0; g < groups.size(); ++g)
      for (const PetscInt i : groups[g])
        group_of[static_cast<std::size_t>(i)] = static_cast<PetscInt>(g);
    std::vector<std::vector<Triplet>> entries_of(groups.size());
    for (const Triplet& entry : entries)
      if (entry.value != 0.0)
        entries_of[static_cast<std::size_t>(group_of[static_cast<std::size_t>(entry.row)])].push_back(entry);
    for (std::size_t g = 0; g < groups.size(); ++g) {
      report.largest_block = std::max(report.largest_block, static_cast<PetscInt>(groups[g].size()));
      examine_group(groups[g], entries_of[g], first_order, scene_number, report);
    }
  });
  MPI_Bcast(&report, sizeof report, MPI_BYTE, 0, comm);
  return report;
}

ZeroDynamics zero_dynamics(const LinearSystem& system, const RelativeDegree& relative_degree,
                           PetscInt limit) {
  ZeroDynamics result;
  result.size = system.states() - relative_degree.outputs;
  result.largest_real_part = std::numeric_limits<double>::quiet_NaN();
  if (result.size <= 0 || system.states() > limit || relative_degree.lowest == 0) return result;
  const MPI_Comm comm = system.comm();
  const auto dense = [&](Mat matrix) {
    PetscInt rows = 0;
    PetscInt columns = 0;
    check(MatGetSize(matrix, &rows, &columns));
    Eigen::MatrixXd full = Eigen::MatrixXd::Zero(rows, columns);
    for (const Triplet& entry : gather_entries(matrix))
      full(entry.row, entry.column) = entry.value;
    return full;
  };
  const Eigen::MatrixXd A = dense(system.A.get());
  const Eigen::MatrixXd B = dense(system.B.get());
  const Eigen::MatrixXd Z = dense(relative_degree.Z.get());
  const Eigen::MatrixXd M = dense(relative_degree.markov.get());
  // Rows C_a A^{r-1}: the last output of each constraint.
  const LocalRange outputs = row_range(relative_degree.Z.get());
  std::vector<PetscInt> mine;
  for (std::size_t a = 0; a < relative_degree.degree.size(); ++a)
    mine.push_back(outputs.first + relative_degree.first_level[a + 1] - 1);
  const std::vector<PetscInt> last = gather(comm, mine);
  int rank = 0;
  MPI_Comm_rank(comm, &rank);
  if (rank == 0) {
    // lambda = -M^{-1} C A^r x holds the outputs; what remains moves in the kernel of Z.
    Eigen::MatrixXd top(static_cast<Eigen::Index>(last.size()), A.cols());
    for (std::size_t a = 0; a < last.size(); ++a)
      top.row(static_cast<Eigen::Index>(a)) = Z.row(last[a]);
    const Eigen::MatrixXd held = A - B * M.fullPivLu().solve(top * A);
    const Eigen::MatrixXd kernel =
        Eigen::MatrixXd(Z.transpose().fullPivHouseholderQr().matrixQ()).rightCols(result.size);
    result.largest_real_part = (kernel.transpose() * held * kernel).eigenvalues().real().maxCoeff();
  }
  MPI_Bcast(&result, sizeof result, MPI_BYTE, 0, comm);
  return result;
}

}  // namespace sweepvi
