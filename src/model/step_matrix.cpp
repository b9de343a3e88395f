#include "model/step_matrix.hpp"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <utility>
#include <vector>

#include "model/definiteness.hpp"
#include "parallel/gather.hpp"
#include "petsc/sparse.hpp"

namespace sweepvi {

namespace {

constexpr PetscInt dense_limit = 400;  // rows of a matrix whose eigenvalues are computed
constexpr double at_the_edge = 1e-9;   // a step that is singular itself is seen by its solver, and divided
constexpr double never = std::numeric_limits<double>::infinity();

/// Four digits, rounded down, so that the number itself works.
std::string rounded_down(double step) {
  const double unit = std::pow(10.0, std::floor(std::log10(step)) - 3.0);
  return fmt::format("{:.4g}", std::floor(step / unit * (1.0 - 1e-9)) * unit);
}

[[noreturn]] void refuse(const std::string& what, double h, double theta, const std::string& found,
                         double largest) {
  throw InputError(fmt::format(
      "model: {} for the step h = {:.6g} s, theta = {:g} ({}): a step would have another solution than the "
      "motion. The largest time.step that works is {} s",
      what, h, theta, found, rounded_down(largest)));
}

Matrix step_matrix(const LagrangianSystem& system, double h) {
  Matrix sum = add(system.M.get(), h * h, system.K.get());
  if (system.C) sum = add(sum.get(), h, system.C.get());
  return sum;
}

bool is_symmetric(Mat matrix) {
  if (matrix == nullptr) return true;
  const Matrix skew = add(matrix, -1.0, transpose(matrix).get());
  double sizes[2] = {0.0, 0.0};
  check(MatNorm(skew.get(), NORM_INFINITY, &sizes[0]));
  check(MatNorm(matrix, NORM_INFINITY, &sizes[1]));
  return sizes[0] <= rounding * sizes[1];
}

/// The largest h up to the given one at which the step's matrix is definite, by bisection: it is for h -> 0.
double largest_definite(const LagrangianSystem& system, double h) {
  constexpr double accuracy = 1e-5;
  double above = h;
  double below = 0.5 * h;
  while (below > 0.0 && !examine_definiteness(step_matrix(system, below).get()).definite) {
    above = below;
    below *= 0.5;
  }
  while (above - below > accuracy * above) {
    const double middle = 0.5 * (below + above);
    (examine_definiteness(step_matrix(system, middle).get()).definite ? below : above) = middle;
  }
  return below;
}

/// A whole matrix on rank 0.
Eigen::MatrixXd dense_on_root(Mat matrix) {
  PetscInt rows = 0;
  PetscInt columns = 0;
  check(MatGetSize(matrix, &rows, &columns));
  Eigen::MatrixXd full = Eigen::MatrixXd::Zero(rows, columns);
  for (const Triplet& entry : gather_entries(matrix))
    full(entry.row, entry.column) += entry.value;
  return full;
}

/// The largest real eigenvalue, -inf if there is none: complex pairs count if they are real up to what
/// rounding of the matrix splits a double eigenvalue into.
double largest_real_eigenvalue(const Eigen::MatrixXd& matrix) {
  const Eigen::VectorXcd values = matrix.eigenvalues();
  const double noise = 64.0 * std::numeric_limits<double>::epsilon() * matrix.norm();
  double largest = -never;
  for (const auto& value : values)
    if (std::abs(value.imag()) <= noise) largest = std::max(largest, value.real());
  return largest;
}

/// 1 / (largest positive real eigenvalue) of [0 I; -M^-1 K, -M^-1 C]: the first h with a singular step
/// matrix.
double first_singular(const LagrangianSystem& system) {
  const MPI_Comm comm = system.comm();
  const Eigen::MatrixXd M = dense_on_root(system.M.get());
  const Eigen::MatrixXd K = dense_on_root(system.K.get());
  Eigen::MatrixXd C = Eigen::MatrixXd::Zero(M.rows(), M.cols());
  if (system.C) C = dense_on_root(system.C.get());
  int rank = 0;
  MPI_Comm_rank(comm, &rank);
  double first = never;
  if (rank == 0) {
    const Eigen::Index n = M.rows();
    const Eigen::LLT<Eigen::MatrixXd> mass(M);
    Eigen::MatrixXd A = Eigen::MatrixXd::Zero(2 * n, 2 * n);
    A.topRightCorner(n, n).setIdentity();
    A.bottomLeftCorner(n, n) = -mass.solve(K);
    A.bottomRightCorner(n, n) = -mass.solve(C);
    const double largest = largest_real_eigenvalue(A);
    if (largest > 0.0) first = 1.0 / largest;
  }
  MPI_Bcast(&first, 1, MPI_DOUBLE, 0, comm);
  return first;
}

Matrix identity_like(Mat matrix) {
  const LocalRange range = row_range(matrix);
  RowBuilder rows;
  for (PetscInt row = range.first; row < range.last; ++row) {
    rows.add(row, 1.0);
    rows.end_row();
  }
  return rows.finish(PetscObjectComm(reinterpret_cast<PetscObject>(matrix)), range.size());
}

/// The largest real Ritz value of a matrix that is an eigenvalue to 1e-6, -inf if there is none: what lies at
/// the edge of its spectrum is found first.
/// Source: Arnoldi's method with reorthogonalisation, Saad, Numerical Methods for Large Eigenvalue Problems
/// (2011), 6.2.
double real_ritz_value(Mat A) {
  constexpr int most = 80;
  constexpr double converged = 1e-6;
  Vector start;
  check(MatCreateVecs(A, start.put(), nullptr));
  {
    const PetscInt first = row_range(A).first;
    const WriteArray values(start.get());
    for (PetscInt i = 0; i < values.size(); ++i)  // without pattern, the same whatever the ranks
      values[i] = 1.0 + std::fmod(0.6180339887498949 * static_cast<double>(first + i + 1), 1.0);
  }
  check(VecNormalize(start.get(), nullptr));
  std::vector<Vector> basis;
  basis.push_back(std::move(start));
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(most + 1, most);
  int size = 0;
  while (size < most) {
    Vector next = duplicate(basis.front().get());
    check(MatMult(A, basis.back().get(), next.get()));
    double before = 0.0;
    check(VecNorm(next.get(), NORM_2, &before));
    for (int pass = 0; pass < 2; ++pass)
      for (std::size_t k = 0; k < basis.size(); ++k) {
        double part = 0.0;
        check(VecDot(next.get(), basis[k].get(), &part));
        check(VecAXPY(next.get(), -part, basis[k].get()));
        H(static_cast<Eigen::Index>(k), size) += part;
      }
    double norm = 0.0;
    check(VecNorm(next.get(), NORM_2, &norm));
    H(size + 1, size) = norm;
    ++size;
    if (!(norm > 1e-12 * before)) break;  // an invariant subspace
    check(VecScale(next.get(), 1.0 / norm));
    basis.push_back(std::move(next));
  }
  const Eigen::EigenSolver<Eigen::MatrixXd> ritz(H.topLeftCorner(size, size));
  double largest = -never;
  for (int k = 0; k < size; ++k) {
    const std::complex<double> value = ritz.eigenvalues()(k);
    const double residual = H(size, size - 1) * std::abs(ritz.eigenvectors()(size - 1, k));
    if (std::abs(value.imag()) <= converged * std::abs(value) && residual <= converged * std::abs(value))
      largest = std::max(largest, value.real());
  }
  return largest;
}

}  // namespace

std::string coordinates_text(const LagrangianSystem& system, const std::vector<PetscInt>& rows) {
  const LocalRange range = row_range(system.M.get());
  std::vector<PetscInt> mine;
  for (const PetscInt row : rows)
    if (range.contains(row))
      mine.push_back(system.coordinate_order[static_cast<std::size_t>(row - range.first)]);
  std::vector<PetscInt> all = gather(system.comm(), mine);
  broadcast(system.comm(), all);
  std::sort(all.begin(), all.end());
  return fmt::format("coordinate{} {}", all.size() == 1 ? "" : "s", fmt::join(all, ", "));
}

std::string check_step_matrix(const LagrangianSystem& system, double h, double theta) {
  const double weighted = h * theta;
  const Matrix J = step_matrix(system, weighted);
  const Definiteness found = examine_definiteness(J.get());
  const bool symmetric = is_symmetric(system.K.get()) && is_symmetric(system.C.get());
  const char* const what = "M + theta h Cv + theta^2 h^2 K";
  if (found.definite)
    return fmt::format("{} positive definite ({})", symmetric ? "" : "not symmetric, its symmetric part",
                       found.how_text());
  if (symmetric) {
    const std::string where =
        found.largest.empty()
            ? fmt::format("its smallest eigenvalue is {:.3g} with a diagonal of ones", found.form)
            : fmt::format("v' J v = {:.3g} for a v along {}", found.form,
                          coordinates_text(system, found.largest));
    refuse(fmt::format("{} is not positive definite", what), h, theta, where,
           largest_definite(system, weighted) / theta);
  }
  if (2 * system.coordinates() > dense_limit)
    return "not symmetric, and its symmetric part not definite; too large for its eigenvalues to be computed";
  const double first = first_singular(system);
  if (first < weighted * (1.0 - at_the_edge))
    refuse(fmt::format("{} is singular at {:.4g} times h", what, first / weighted), h, theta,
           "a real eigenvalue of the motion grows faster", first / theta);
  return "not symmetric, nonsingular for all smaller steps";
}

std::string check_first_order_step(Mat A, double h, double theta, const std::string& name) {
  const double weighted = h * theta;
  const MPI_Comm comm = PetscObjectComm(reinterpret_cast<PetscObject>(A));
  int far = 1;  // no disc reaches 1 / h
  for_each_row(A, [&](PetscInt row, auto columns, auto values) {
    double reach = 0.0;
    for (std::size_t k = 0; k < columns.size(); ++k)
      reach += columns[k] == row ? values[k] : std::abs(values[k]);
    if (!(weighted * reach < 1.0)) far = 0;
  });
  MPI_Allreduce(MPI_IN_PLACE, &far, 1, MPI_INT, MPI_LAND, comm);
  if (far != 0) return "nonsingular for all smaller steps (diagonally dominant)";
  PetscInt n = 0;
  check(MatGetSize(A, &n, nullptr));
  const bool large = n > dense_limit;
  if (large) {  // the symmetric part of I - s h A is definite for all smaller s, if it is
    const Definiteness found = examine_definiteness(add(identity_like(A).get(), -weighted, A).get());
    if (found.definite)
      return fmt::format("nonsingular for all smaller steps (its symmetric part is definite: {})",
                         found.how_text());
  }
  double largest = -never;
  if (large) {
    largest = real_ritz_value(A);
  } else {
    const Eigen::MatrixXd full = dense_on_root(A);
    int rank = 0;
    MPI_Comm_rank(comm, &rank);
    if (rank == 0) largest = largest_real_eigenvalue(full);
    MPI_Bcast(&largest, 1, MPI_DOUBLE, 0, comm);
  }
  if (weighted * largest > 1.0 + at_the_edge)
    refuse(fmt::format("I - s h theta {} is singular at s = {:.4g}", name, 1.0 / (weighted * largest)), h,
           theta, fmt::format("{} has the real eigenvalue {:.4g} 1/s", name, largest),
           1.0 / (largest * theta));
  if (large)
    return "not known: its symmetric part is not definite; Arnoldi's method finds no real eigenvalue beyond "
           "1/h";
  return "nonsingular for all smaller steps (eigenvalues computed)";
}

}  // namespace sweepvi
