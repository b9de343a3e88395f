#pragma once

#include <petscsys.h>

#include <Eigen/Core>
#include <cmath>
#include <functional>
#include <memory>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "dvi/affine_vi.hpp"
#include "petsc/sparse.hpp"
#include "sweepvi/step_solver.hpp"
#include "vi/affine_box.hpp"

namespace sweepvi::test {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Random numbers, the same on every rank and machine.
class Random {
public:
  explicit Random(unsigned seed) : engine_(seed) {}
  double operator()() { return static_cast<double>(engine_()) / 2147483648.0 - 1.0; }  // [-1, 1)
  double between(double a, double b) { return a + (b - a) * 0.5 * ((*this)() + 1.0); }
  Index below(Index n) { return static_cast<Index>(engine_() % static_cast<std::uint32_t>(n)); }
  bool chance(double p) { return between(0.0, 1.0) < p; }
  VectorXd vector(Index n) {
    return VectorXd::NullaryExpr(n, [this] { return (*this)(); });
  }
  MatrixXd matrix(Index rows, Index columns) {
    return MatrixXd::NullaryExpr(rows, columns, [this] { return (*this)(); });
  }

private:
  std::mt19937 engine_;
};

// ---- families of P-matrices ----

inline MatrixXd diagonally_dominant(Random& random, Index n) {
  MatrixXd M = random.matrix(n, n);
  for (Index i = 0; i < n; ++i)
    M(i, i) = M.row(i).cwiseAbs().sum() * random.between(1.01, 1.5);
  return M;
}

/// B B' plus a skew part as large.
inline MatrixXd definite(Random& random, Index n) {
  const MatrixXd B = random.matrix(n, n);
  const MatrixXd K = random.matrix(n, n);
  return B * B.transpose() / static_cast<double>(n) + 0.01 * MatrixXd::Identity(n, n) + K - K.transpose();
}

/// Ones on the diagonal, entries up to 10 below; the solution may grow like 10^n.
inline MatrixXd triangular(Random& random, Index n) {
  MatrixXd M = 10.0 * random.matrix(n, n);
  M.triangularView<Eigen::Upper>().setZero();
  M.diagonal().setOnes();
  return M;
}

inline MatrixXd m_matrix(Random& random, Index n) {
  MatrixXd M = MatrixXd::Zero(n, n);
  for (Index i = 0; i < n; ++i) {
    for (Index j = 0; j < n; ++j)
      if (j != i && random.chance(0.3)) M(i, j) = -random.between(0.0, 1.0);
    M(i, i) = -M.row(i).sum() + random.between(1e-3, 1.0);
  }
  return M;
}

/// Rows and columns of a definite matrix over 12 decades each.
inline MatrixXd badly_scaled(Random& random, Index n) {
  MatrixXd M = definite(random, n);
  for (Index i = 0; i < n; ++i) {
    M.row(i) *= std::pow(10.0, random.between(-6.0, 6.0));
    M.col(i) *= std::pow(10.0, random.between(-6.0, 6.0));
  }
  return M;
}

/// Newton's methods go round in circles on such blocks (I. Ben Gharbia, J. C. Gilbert, Math. Program. 134
/// (2012) 349-364): P, and neither definite nor dominant.
inline MatrixXd circulant_blocks(Random& random, Index n) {
  MatrixXd M = MatrixXd::Identity(n, n);
  for (Index first = 0; first + 2 < n; first += 3)
    for (Index j = 0; j < 3; ++j)
      M(first + j, first + (j + 1) % 3) = random.between(1.1, 3.0);
  return M;
}

struct Family {
  const char* name;
  MatrixXd (*make)(Random&, Index);
};
inline constexpr Family p_matrices[] = {{"diagonally dominant", diagonally_dominant},
                                        {"definite", definite},
                                        {"triangular", triangular},
                                        {"M-matrix", m_matrix},
                                        {"badly scaled", badly_scaled},
                                        {"circulant blocks", circulant_blocks}};

// ---- problems ----

/// The LCP of a P-matrix, with a random q. One in three is degenerate: some z_i = w_i = 0.
inline AffineBox random_lcp(Random& random, const Family& family, Index n) {
  AffineBox box{family.make(random, n), random.vector(n), VectorXd::Zero(n),
                VectorXd::Constant(n, PETSC_INFINITY)};
  if (random.chance(1.0 / 3.0)) {
    VectorXd u = VectorXd::Zero(n);
    VectorXd force = VectorXd::Zero(n);
    for (Index i = 0; i < n; ++i) {
      if (random.chance(0.4))
        u[i] = random.between(0.0, 1.0);
      else if (random.chance(0.5))
        force[i] = random.between(0.0, 1.0);
    }
    box.q = force - box.M * u;
  } else if (random.chance(0.5)) {
    box.q.setConstant(-1.0);
  }
  return box;
}

/// A third of the rows without bounds, a third with one, a third with two, some of these a single point.
inline AffineBox random_mixed(Random& random, const Family& family, Index n) {
  AffineBox box{family.make(random, n), 2.0 * random.vector(n), VectorXd::Constant(n, PETSC_NINFINITY),
                VectorXd::Constant(n, PETSC_INFINITY)};
  for (Index i = 0; i < n; ++i) {
    const Index kind = random.below(3);
    const double anchor = random();
    if (kind == 1) (random.chance(0.5) ? box.lower : box.upper)[i] = anchor;
    if (kind != 2) continue;
    box.lower[i] = anchor;
    box.upper[i] = anchor + (random.chance(0.1) ? 0.0 : random.between(0.0, 2.0));
  }
  return box;
}

/// 2 ... largest, small ones more often.
inline Index random_size(Random& random, Index largest) {
  return static_cast<Index>(
      std::lround(std::exp(random.between(std::log(2.0), std::log(static_cast<double>(largest))))));
}

// ---- how they are solved and judged ----

/// The program's own way: a step of AffineVi.
struct Solved {
  StepReport report;
  VectorXd u;
};

/// @param u0  where the solver starts; empty: at 0
inline std::unique_ptr<AffineVi> affine_vi(const AffineBox& box, const VectorXd& u0 = {}) {
  PetscInt local = PETSC_DECIDE;
  PetscInt total = static_cast<PetscInt>(box.q.size());
  check(PetscSplitOwnership(PETSC_COMM_WORLD, &local, &total));
  Vector q = make_vector(PETSC_COMM_WORLD, local);
  PetscInt first = 0;
  check(VecGetOwnershipRange(q.get(), &first, nullptr));
  const auto piece = [&](const VectorXd& values) {
    Vector mine = duplicate(q.get());
    const WriteArray to(mine.get());
    for (PetscInt i = 0; i < local; ++i)
      to[i] = values[first + i];
    return mine;
  };
  RowBuilder rows;
  for (PetscInt i = first; i < first + local; ++i) {
    for (Index j = 0; j < box.q.size(); ++j)
      if (box.M(i, j) != 0.0 || j == i) rows.add(static_cast<PetscInt>(j), box.M(i, j));
    rows.end_row();
  }
  Matrix M = rows.finish(PETSC_COMM_WORLD, local);
  return std::make_unique<AffineVi>(std::move(M), piece(box.q), piece(box.lower), piece(box.upper),
                                    piece(u0.size() > 0 ? u0 : VectorXd::Zero(box.q.size())));
}

inline Solved solve(const AffineBox& box, const VectorXd& u0 = {}) {
  const auto vi = affine_vi(box, u0);
  NonlinearSolver snes;
  check(SNESCreate(PETSC_COMM_WORLD, snes.put()));
  StepSolver solver(snes.get(), *vi);
  Solved solved;
  solved.report = solver.solve({1, 0.0, 0.0, 0.0});
  const ReadArray mine(solver.solution());
  solved.u = VectorXd::Zero(box.q.size());
  PetscInt first = 0;
  check(VecGetOwnershipRange(solver.solution(), &first, nullptr));
  for (PetscInt i = 0; i < mine.size(); ++i)
    solved.u[first + i] = mine[i];
  MPI_Allreduce(MPI_IN_PLACE, solved.u.data(), static_cast<int>(solved.u.size()), MPI_DOUBLE, MPI_SUM,
                PETSC_COMM_WORLD);
  return solved;
}

/// How far u is from a solution, in extended precision and by a rule of its own: in the box; each row's F
/// over the sum of its terms, of the sign that the place of u_i allows. What is at a bound is exactly there,
/// or so close that it changes no row by more than `near` of its terms: it is moved there first.
inline double judge(const AffineBox& box, VectorXd u, double near = 1e-10) {
  using Extended = Eigen::Matrix<long double, Eigen::Dynamic, 1>;
  using ExtendedMatrix = Eigen::Matrix<long double, Eigen::Dynamic, Eigen::Dynamic>;
  const Index n = u.size();
  const ExtendedMatrix M = box.M.cast<long double>();
  const auto terms_at = [&](const VectorXd& v) -> Extended {
    return M.cwiseAbs() * v.cwiseAbs().cast<long double>() + box.q.cwiseAbs().cast<long double>();
  };
  Extended terms = terms_at(u);
  Extended F = M * u.cast<long double>() + box.q.cast<long double>();
  for (Index i = 0; i < n; ++i) {
    if (!std::isfinite(u[i])) return HUGE_VAL;
    const double bound = F[i] > 0.0L ? box.lower[i] : box.upper[i];  // where F pushes
    const long double distance = std::abs(static_cast<long double>(u[i]) - bound);
    if (std::abs(F[i]) <= near * terms[i] || distance > near * terms[i]) continue;
    bool visible = false;
    for (Index j = 0; j < n; ++j)
      visible = visible || std::abs(M(j, i)) * distance > near * terms[j];
    if (!visible) u[i] = bound;
  }
  terms = terms_at(u);
  F = M * u.cast<long double>() + box.q.cast<long double>();
  long double worst = 0.0L;
  for (Index i = 0; i < n; ++i) {
    if (u[i] < box.lower[i] || u[i] > box.upper[i]) return HUGE_VAL;
    const bool at_lower = u[i] == box.lower[i];
    const bool at_upper = u[i] == box.upper[i];
    long double wrong = std::abs(F[i]);
    if (at_lower && at_upper)
      wrong = 0.0L;
    else if (at_lower)
      wrong = std::max(0.0L, -F[i]);
    else if (at_upper)
      wrong = std::max(0.0L, F[i]);
    if (wrong > 0.0L) worst = std::max(worst, wrong / terms[i]);
  }
  return static_cast<double>(worst);
}

}  // namespace sweepvi::test
