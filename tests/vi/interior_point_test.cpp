// ranks: 1 2 3
// The interior-point method by itself: problems whose active-set matrices are singular, equations written
// with either sign, units far apart, and problems without a solution. What it must find is known, or judged
// by the certificate.
#include "vi/interior_point.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "dvi/affine_vi.hpp"
#include "dvi/systems.hpp"
#include "petsc/sparse.hpp"
#include "vi/certificate.hpp"

namespace sweepvi::test {
namespace {

constexpr double none = PETSC_INFINITY;

/// M u + q in [lower, upper], M dense, known to every rank.
struct Problem {
  std::vector<std::vector<double>> M;
  std::vector<double> q, lower, upper;

  std::unique_ptr<AffineVi> distributed() const {
    auto total = static_cast<PetscInt>(q.size());
    PetscInt local = PETSC_DECIDE;
    check(PetscSplitOwnership(PETSC_COMM_WORLD, &local, &total));
    RowBuilder rows;
    std::vector<Vector> vectors;
    for (const auto* values : {&q, &lower, &upper}) {
      vectors.push_back(make_vector(PETSC_COMM_WORLD, local));
      PetscInt first = 0;
      check(VecGetOwnershipRange(vectors.back().get(), &first, nullptr));
      const WriteArray to(vectors.back().get());
      std::copy_n(values->begin() + first, local, to.data());
    }
    PetscInt first = 0;
    check(VecGetOwnershipRange(vectors[0].get(), &first, nullptr));
    for (PetscInt i = first; i < first + local; ++i) {
      rows.add(i, 0.0);
      for (std::size_t j = 0; j < q.size(); ++j) {
        const double value = M[static_cast<std::size_t>(i)][j];
        if (value != 0.0) rows.add(static_cast<PetscInt>(j), value);
      }
      rows.end_row();
    }
    Vector start = duplicate(vectors[0].get());
    return std::make_unique<AffineVi>(rows.finish(PETSC_COMM_WORLD, local), std::move(vectors[0]),
                                      std::move(vectors[1]), std::move(vectors[2]), std::move(start));
  }
};

struct Found {
  InteriorPoint::Result result;
  double ratio = 0.0;  // of the certificate
  std::vector<double> u;
};

Found solve(const Problem& problem, InteriorPoint::Begin begin) {
  const auto vi = problem.distributed();
  const CertificateOptions options;
  Certificate certificate(*vi, options);
  InteriorPoint method(*vi);
  Vector u = duplicate(vi->state());
  const Vector lower = duplicate(u.get());
  const Vector upper = duplicate(u.get());
  const Vector f = duplicate(u.get());
  vi->begin({1, 0.0, 0.0, 0.0}, lower.get(), upper.get(), u.get());
  const Vector settled = duplicate(u.get());
  const auto ratio = [&](Vec point) {
    check(VecCopy(point, settled.get()));
    return certificate.settled_ratio(settled.get(), lower.get(), upper.get(), f.get());
  };
  Found found;
  found.result = method.solve(u.get(), lower.get(), upper.get(), options, begin, ratio);
  found.ratio = ratio(u.get());
  found.u = everywhere(settled.get());
  return found;
}

Found expect_solved(const Problem& problem) {
  Found found;
  for (const auto begin : {InteriorPoint::Begin::by_sets, InteriorPoint::Begin::on_path}) {
    found = solve(problem, begin);
    EXPECT_LE(found.ratio, CertificateOptions().rtol);
    EXPECT_EQ(found.result.reason, "INTERIOR_CONVERGED");
    EXPECT_LE(found.result.iterations, 60);  // 10 to 30 along the path, and proximal steps before and after
  }
  return found;
}

/// The optimality conditions of min 1/2 x'K x + c'x where G x >= g and E x = e, x in [lower, upper]. `sign`:
/// how the equations are written.
Problem programme(const std::vector<double>& K, const std::vector<double>& c,
                  const std::vector<std::vector<double>>& G, const std::vector<double>& g,
                  const std::vector<std::vector<double>>& E, const std::vector<double>& e, double sign,
                  double lower = 0.0, double upper = none) {
  const std::size_t n = c.size();
  const std::size_t size = n + g.size() + e.size();
  Problem problem{std::vector(size, std::vector(size, 0.0)), c, std::vector(n, lower), std::vector(n, upper)};
  for (std::size_t i = 0; i < n; ++i)
    problem.M[i][i] = K[i];
  const auto add = [&](const std::vector<double>& row, double right, double times, double least) {
    const std::size_t at = problem.q.size();
    for (std::size_t j = 0; j < n; ++j) {
      problem.M[at][j] = times * row[j];
      problem.M[j][at] = -row[j];
    }
    problem.q.push_back(-times * right);
    problem.lower.push_back(least);
    problem.upper.push_back(none);
  };
  for (std::size_t i = 0; i < g.size(); ++i)
    add(G[i], g[i], 1.0, 0.0);
  for (std::size_t i = 0; i < e.size(); ++i)
    add(E[i], e[i], sign, PETSC_NINFINITY);
  return problem;
}

// min x1 + 2 x2 where x1 + x2 >= 1, three times, x <= 0.75: no matrix of active rows is regular.
TEST(InteriorPoint, LinearProgrammeWithRepeatedRows) {
  const Found found =
      expect_solved(programme({0, 0}, {1, 2}, {{1, 1}, {1, 1}, {1, 1}}, {1, 1, 1}, {}, {}, 1.0, 0.0, 0.75));
  EXPECT_NEAR(found.u[0], 0.75, 1e-12);
  EXPECT_NEAR(found.u[1], 0.25, 1e-12);
}

// Equations whose multipliers are only known up to a null vector, with either sign.
TEST(InteriorPoint, DependentEquationsOfEitherSign) {
  for (const double sign : {1.0, -1.0}) {
    const Found found = expect_solved(
        programme({1, 0, 2}, {-1, 1, 0}, {}, {}, {{1, 1, 1}, {2, 2, 2}, {0, 0, 0}}, {3, 6, 0}, sign));
    // x1 - 1 = 2 x3 = p <= 1, x1 + x3 <= 3: p = 1, x = (2, 1/2, 1/2).
    EXPECT_NEAR(found.u[0], 2.0, 1e-10);
    EXPECT_NEAR(found.u[1], 0.5, 1e-10);
    EXPECT_NEAR(found.u[2], 0.5, 1e-10);
  }
}

// Rows and unknowns in units of their own.
TEST(InteriorPoint, UnitsFarApart) {
  std::mt19937 engine(3);  // the same on all ranks
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  constexpr std::size_t n = 12;
  Problem problem{std::vector(n, std::vector(n, 0.0)), std::vector(n, 0.0), std::vector(n, 0.0),
                  std::vector(n, none)};
  std::vector<double> row(n);
  std::vector<double> column(n);
  for (std::size_t i = 0; i < n; ++i) {
    row[i] = std::pow(10.0, 5.0 * uniform(engine));
    column[i] = std::pow(10.0, 5.0 * uniform(engine));
  }
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j < i; ++j) {  // skew, rows 2 and 3 in n alike
      const double value = std::round(3.0 * uniform(engine));
      problem.M[i][j] = value;
      problem.M[j][i] = -value;
    }
  }
  std::vector<double> u(n);
  for (std::size_t i = 0; i < n; ++i)
    u[i] = std::max(0.0, uniform(engine));
  for (std::size_t i = 0; i < n; ++i) {
    double f = u[i] > 0.0 ? 0.0 : std::max(0.0, uniform(engine));  // often both are 0
    for (std::size_t j = 0; j < n; ++j)
      f -= problem.M[i][j] * u[j];
    problem.q[i] = row[i] * f;
  }
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t j = 0; j < n; ++j)
      problem.M[i][j] *= row[i] * column[j];
  expect_solved(problem);
}

// x >= 0, -x >= 1.
TEST(InteriorPoint, NoSolutionIsAResult) {
  const Found found = solve(programme({0}, {1}, {{-1}}, {1}, {}, {}, 1.0), InteriorPoint::Begin::on_path);
  EXPECT_GT(found.ratio, 1e-6);
  EXPECT_NE(found.result.reason, "INTERIOR_CONVERGED");
}

}  // namespace
}  // namespace sweepvi::test
