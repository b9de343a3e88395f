// ranks: 1 2 3
// Sweeps over levels of constraints on paths: they end at the solution of the box VI of the whole step, on
// any number of ranks, remember nothing, and know steps they do not fit.
#include <gtest/gtest.h>

#include <random>

#include "dvi/systems.hpp"
#include "petsc/sparse.hpp"
#include "vi/certificate.hpp"
#include "vi/path_sweeps.hpp"

namespace sweepvi::test {
namespace {

constexpr PetscInt balls_per_rank = 60;

/// What to do differently.
struct Twist {
  double spring = 0.0;      ///< h times the stiffness between neighbours, over their mass
  double sign = -1.0;       ///< of what a contact does to the ball below
  PetscInt also_reads = 0;  ///< contacts read a ball that much further down, too
  bool ring = false;        ///< the first ball touches the last
};

/// A step of a column of balls that are in contact, or about to be: unknowns q, v of this rank's balls, then
/// nu_1, nu_2 of each ball's contact with the one below.
///
///     q_i = b + h v_i + (nu_{1,i} - nu_{1,i+1}) / 2,    v_i = b + nu_{2,i} - nu_{2,i+1} - spring,
///     0 <= nu_1  _|_  q_i - q_{i-1} - g >= 0,           0 <= nu_2  _|_  v_i - v_{i-1} >= 0.
struct Problem {
  explicit Problem(unsigned seed, Twist twist = {}) {
    int rank = 0;
    int ranks = 1;
    MPI_Comm_rank(PETSC_COMM_WORLD, &rank);
    MPI_Comm_size(PETSC_COMM_WORLD, &ranks);
    constexpr double h = 1e-2;
    const PetscInt n = balls_per_rank;
    const PetscInt all = ranks * n;
    const auto place = [n](PetscInt ball, PetscInt kind) {  // 0: q, 1: v, 2: nu_1, 3: nu_2
      const PetscInt local = ball % n;
      return ball / n * 4 * n + (kind < 2 ? kind * n + local : 2 * n + 2 * local + kind - 2);
    };
    const auto below = [&](PetscInt ball) { return ball > 0 ? ball - 1 : twist.ring ? all - 1 : -1; };
    const auto above = [&](PetscInt ball) { return ball + 1 < all ? ball + 1 : twist.ring ? 0 : -1; };
    RowBuilder rows;
    for (const PetscInt kind : {0, 1}) {
      for (PetscInt i = rank * n; i < (rank + 1) * n; ++i) {
        const double push = kind == 0 ? 0.5 : 1.0;
        rows.add(place(i, kind), 1.0);
        if (kind == 0) rows.add(place(i, 1), -h);
        if (kind == 1 && twist.spring != 0.0)
          for (const PetscInt j : {i - 1, i + 1})
            if (j >= 0 && j < all) {
              rows.add(place(i, 0), twist.spring);
              rows.add(place(j, 0), -twist.spring);
            }
        rows.add(place(i, kind + 2), -push);
        if (above(i) >= 0) rows.add(place(above(i), kind + 2), -twist.sign * push);
        rows.end_row();
      }
    }
    for (PetscInt i = rank * n; i < (rank + 1) * n; ++i) {
      for (const PetscInt kind : {0, 1}) {
        rows.add(place(i, kind), 1.0);
        if (below(i) >= 0) rows.add(place(below(i), kind), -1.0);
        if (twist.also_reads != 0 && i >= twist.also_reads)
          rows.add(place(i - twist.also_reads, kind), -0.25);
        rows.add(place(i, kind + 2), 0.0);
        rows.end_row();
      }
    }
    K = rows.finish(PETSC_COMM_WORLD, 4 * n);
    for (Vector* vector : {&b, &lower, &upper, &u, &f, &terms})
      *vector = make_vector(PETSC_COMM_WORLD, 4 * n);
    level.assign(static_cast<std::size_t>(2 * n), 0);
    std::mt19937 generator(seed + 100U * static_cast<unsigned>(rank));
    std::uniform_real_distribution<double> number(-1.0, 1.0);
    const WriteArray right(b.get());
    const WriteArray l(lower.get());
    const WriteArray guess(u.get());
    check(VecSet(upper.get(), PETSC_INFINITY));
    for (PetscInt i = 0; i < 4 * n; ++i) {
      l[i] = PETSC_NINFINITY;
      guess[i] = number(generator);
      right[i] = number(generator);
    }
    for (PetscInt i = 0; i < n; ++i) {
      const bool closed = number(generator) < 0.4;
      level.insert(level.end(), {1, 2});
      pinned.insert(pinned.end(), {0, static_cast<char>(closed ? 0 : 1)});
      right[i] = static_cast<double>(rank * n + i) + (closed ? 0.0 : 0.3 * number(generator));
      const PetscInt nu = 2 * n + 2 * i;
      right[nu] = 1.0;
      right[nu + 1] = 0.0;
      l[nu] = 0.0;
      guess[nu] = std::max(0.0, guess[nu]);
      guess[nu + 1] = closed ? std::max(0.0, guess[nu + 1]) : 0.0;
      if (closed) l[nu + 1] = 0.0;
    }
  }

  /// Worst natural residual over the terms of its row at u, by PETSc's products. Outputs are known up to the
  /// terms of the states they read, a tenth of which counts as theirs, as in PrimalDual. Pinned multipliers
  /// are 0.
  double ratio() const {
    const PetscInt states = 2 * balls_per_rank;
    check(MatMult(K.get(), u.get(), f.get()));
    check(VecAXPY(f.get(), -1.0, b.get()));
    const Matrix absolute = absolute_copy(K.get());
    const Vector sizes = duplicate(u.get());
    check(VecCopy(u.get(), sizes.get()));
    check(VecAbs(sizes.get()));
    check(MatMult(absolute.get(), sizes.get(), terms.get()));
    const Vector inherited = duplicate(u.get());
    {
      const ReadArray right(b.get());
      const WriteArray own(terms.get());
      const WriteArray of_states(sizes.get());
      for (PetscInt i = 0; i < own.size(); ++i) {
        own[i] += std::abs(right[i]);
        of_states[i] = i < states ? own[i] : 0.0;
      }
    }
    check(MatMult(absolute.get(), sizes.get(), inherited.get()));
    double worst = 0.0;
    const ReadArray x(u.get());
    const ReadArray value(f.get());
    const ReadArray l(lower.get());
    const ReadArray h(upper.get());
    const ReadArray size(terms.get());
    const ReadArray more(inherited.get());
    for (PetscInt i = 0; i < x.size(); ++i) {
      if (i >= states && pinned[static_cast<std::size_t>(i - states)] != 0) {
        EXPECT_EQ(x[i], 0.0);
        continue;
      }
      if (i >= states) positive += x[i] > 0.0 ? 1 : 0;
      worst = std::max(worst, std::abs(natural_residual(x[i], value[i], l[i], h[i])) /
                                  (size[i] + (i < states ? 0.0 : 0.1 * more[i])));
    }
    MPI_Allreduce(MPI_IN_PLACE, &worst, 1, MPI_DOUBLE, MPI_MAX, PETSC_COMM_WORLD);
    return worst;
  }
  bool solve(PathSweeps& sweeps) const {
    return sweeps.solve(u.get(), b.get(), lower.get(), upper.get(), pinned);
  }
  PathSweeps sweeps(const AffineRows& rows) const { return {PETSC_COMM_WORLD, rows, level}; }

  Matrix K;
  std::vector<int> level;
  std::vector<char> pinned;
  Vector b, lower, upper, u, f, terms;
  mutable int positive = 0;  // multipliers
};

TEST(PathSweeps, SolveAColumnAtOnce) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    SCOPED_TRACE(seed);
    const Problem problem(seed);
    const AffineRows rows(problem.K.get());
    PathSweeps sweeps = problem.sweeps(rows);
    ASSERT_TRUE(sweeps.worthwhile());
    ASSERT_TRUE(problem.solve(sweeps));
    EXPECT_LE(problem.ratio(), 1e-14);
    EXPECT_GT(problem.positive, 5);  // on each rank: there is something to solve
  }
}

TEST(PathSweeps, CarrySpringsByFurtherSweeps) {
  for (const double spring : {1e-6, 1e-3, 1e-1, 1.0}) {
    SCOPED_TRACE(spring);
    const Problem problem(3, {.spring = spring});
    const AffineRows rows(problem.K.get());
    PathSweeps sweeps = problem.sweeps(rows);
    ASSERT_TRUE(sweeps.worthwhile());
    ASSERT_TRUE(problem.solve(sweeps));
    EXPECT_LE(problem.ratio(), 1e-14);
  }
}

// A second solve takes off what was put on, to rounding of the terms.
TEST(PathSweeps, RefineFromWhereTheyAre) {
  const Problem problem(5);
  const AffineRows rows(problem.K.get());
  PathSweeps sweeps = problem.sweeps(rows);
  ASSERT_TRUE(problem.solve(sweeps));
  {
    const WriteArray u(problem.u.get());
    for (PetscInt i = 0; i < 2 * balls_per_rank; ++i)
      u[i] += 1e-9;
    for (PetscInt i = 2 * balls_per_rank; i < u.size(); ++i)
      u[i] *= 1.0 + 1e-9;
  }
  EXPECT_GT(problem.ratio(), 1e-11);
  ASSERT_TRUE(problem.solve(sweeps));
  EXPECT_LE(problem.ratio(), 1e-14);
}

TEST(PathSweeps, RememberNothing) {
  const Problem one(11);
  const Problem other(12);
  const AffineRows rows(one.K.get());
  PathSweeps fresh = one.sweeps(rows);
  PathSweeps used = one.sweeps(rows);
  const Vector guess = duplicate(one.u.get());
  check(VecCopy(one.u.get(), guess.get()));
  ASSERT_TRUE(other.solve(used));
  ASSERT_TRUE(one.solve(fresh));
  ASSERT_TRUE(used.solve(guess.get(), one.b.get(), one.lower.get(), one.upper.get(), one.pinned));
  EXPECT_EQ(everywhere(one.u.get()), everywhere(guess.get()));
}

TEST(PathSweeps, KnowWhereTheyAreOfNoUse) {
  const auto worthwhile = [](Twist twist) {
    const Problem problem(1, twist);
    const AffineRows rows(problem.K.get());
    return problem.sweeps(rows).worthwhile();
  };
  EXPECT_TRUE(worthwhile({}));
  EXPECT_FALSE(worthwhile({.spring = 100.0}));  // as strong as the masses
  EXPECT_FALSE(worthwhile({.sign = 1.0}));      // no M-matrix
  EXPECT_FALSE(worthwhile({.also_reads = 7}));  // no path
  EXPECT_FALSE(worthwhile({.ring = true}));
  const Problem problem(1);
  const AffineRows rows(problem.K.get());
  const std::vector<int> states(problem.level.size(), 0);
  EXPECT_FALSE(PathSweeps(PETSC_COMM_WORLD, rows, states).worthwhile());
}

TEST(PathSweeps, RefuseOtherBounds) {
  int rank = 0;
  MPI_Comm_rank(PETSC_COMM_WORLD, &rank);
  for (const bool at_upper : {true, false}) {
    const Problem problem(1);
    const AffineRows rows(problem.K.get());
    PathSweeps sweeps = problem.sweeps(rows);
    ASSERT_TRUE(problem.solve(sweeps));
    if (rank == 0) {  // all ranks refuse
      const WriteArray bound(at_upper ? problem.upper.get() : problem.lower.get());
      bound[2 * balls_per_rank] = at_upper ? 3.0 : -1.0;
    }
    EXPECT_FALSE(problem.solve(sweeps));
  }
}

}  // namespace
}  // namespace sweepvi::test
