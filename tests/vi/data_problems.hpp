#pragma once

#include <petscsys.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "dvi/affine_vi.hpp"
#include "petsc/sparse.hpp"
#include "sweepvi/step_solver.hpp"
#include "vi/random_problems.hpp"

namespace sweepvi::test {

/// An LCP or mixed LCP by rows, known to be solvable or not by the way it was made: all numbers are integers
/// times powers of two, and sums of them exact.
struct DataProblem {
  std::vector<std::map<PetscInt, double>> rows;
  std::vector<double> q, u0;
  std::vector<char> free;  // F_i = 0, u_i without bounds
  std::string kind;

  explicit DataProblem(std::size_t n) : rows(n), q(n, 0.0), u0(n, 0.0), free(n, 0) {
    for (std::size_t i = 0; i < n; ++i)
      rows[i][static_cast<PetscInt>(i)] = 0.0;
  }
  std::size_t size() const { return rows.size(); }
  void add(std::size_t i, std::size_t j, double value) { rows[i][static_cast<PetscInt>(j)] += value; }
  double times(std::size_t i, const std::vector<double>& u) const {
    double sum = 0.0;
    for (const auto& [j, value] : rows[i])
      sum += value * u[static_cast<std::size_t>(j)];
    return sum;
  }
  /// q such that u and w solve it.
  void solved_by(const std::vector<double>& u, const std::vector<double>& w) {
    for (std::size_t i = 0; i < size(); ++i)
      q[i] = w[i] - times(i, u);
  }
};

class DataProblems {
public:
  explicit DataProblems(unsigned seed) : random_(seed) {}

  static constexpr int kinds = 7;

  /// Of `n` unknowns or some more. Unsolvable: with d >= 0, M'd <= 0 and q'd = -gap, gap / (|q| |d|) between
  /// 1e-6 and 1.
  DataProblem make(int kind, std::size_t n, bool solvable) {
    DataProblem problem = kind == 0   ? laplacian(n, 0, solvable)
                          : kind == 1 ? laplacian(n, 6, solvable)
                          : kind == 2 ? skew(n, solvable)
                          : kind == 3 ? low_rank(n, solvable)
                          : kind == 4 ? saddle(n, solvable)
                          : kind == 5 ? two_parts(n, solvable)
                                      : directed(n, solvable);
    start(problem);
    return problem;
  }

  /// M = L + ground, L a Laplacian with springs of 1 ... 2^46, q of size 1: solvable, and rows cancel 14
  /// digits.
  DataProblem stiff(std::size_t n, bool grounded) {
    DataProblem problem(n);
    problem.kind = grounded ? "stiff, grounded" : "stiff, floating";
    springs(problem, 0, n, 46);
    for (double& value : problem.q)
      value = integer(-3, 3);
    if (grounded) {
      problem.add(index(n), 0, 0.0);
      const std::size_t held = index(n);
      problem.add(held, held, 1.0);
    } else {  // sum q >= 0: a solution exists
      double sum = 0.0;
      for (const double value : problem.q)
        sum += value;
      if (sum < 0.0) problem.q[index(n)] -= sum;
    }
    start(problem);
    return problem;
  }

private:
  double integer(int a, int b) { return static_cast<double>(a + random_.below(b - a + 1)); }
  std::size_t index(std::size_t n) { return static_cast<std::size_t>(random_.below(static_cast<Index>(n))); }
  /// Between 1e-6 and 1, a power of two.
  double gap() { return std::ldexp(1.0, -static_cast<int>(random_.below(20))); }
  double weight(int decades) { return std::ldexp(1.0, static_cast<int>(random_.below(decades + 1))); }

  void start(DataProblem& problem) {
    const Index how = random_.below(4);
    const double size = how == 0 ? 0.0 : how == 1 ? 1.0 : how == 2 ? 1e3 : 1e6;
    const bool same = random_.chance(0.5);
    for (double& value : problem.u0)
      value = size * (same ? 1.0 : random_.between(0.0, 1.0));
  }
  /// A random solution: some u_i, some w_i, some neither.
  void solve_by_something(DataProblem& problem) {
    std::vector<double> u(problem.size(), 0.0);
    std::vector<double> w(problem.size(), 0.0);
    for (std::size_t i = 0; i < problem.size(); ++i) {
      const Index place = random_.below(5);
      if (problem.free[i] != 0)
        u[i] = integer(-4, 4);
      else if (place < 3)
        u[i] = integer(0, 4);
      else if (place == 3)
        w[i] = integer(0, 3);
    }
    problem.solved_by(u, w);
  }
  /// q of size 1 with sum over [first, last) d_i q_i = -gap |d| |q|: d_i are powers of two.
  void exclude(DataProblem& problem, const std::vector<double>& d) {
    double sum = 0.0;
    double squares = 0.0;
    std::size_t least = 0;
    for (std::size_t i = 0; i < problem.size(); ++i) {
      problem.q[i] = integer(-3, 3);
      if (d[i] == 0.0) continue;
      sum += d[i] * problem.q[i];
      squares += d[i] * d[i];
      if (d[least] == 0.0 || d[i] < d[least]) least = i;
    }
    problem.q[least] -= sum / d[least];  // sum of d q is 0 now
    double norm = 0.0;
    for (const double value : problem.q)
      norm += value * value;
    const double size = std::exp2(std::ceil(0.5 * std::log2(norm + 1.0)));
    const double length = std::exp2(std::ceil(0.5 * std::log2(squares)));
    problem.q[least] -= std::max(gap(), 0x1p-19) * size * length / d[least];
  }

  /// A connected graph of springs, 1 ... 2^decades, between the unknowns [first, last): a path, and chords.
  void springs(DataProblem& problem, std::size_t first, std::size_t last, int decades) {
    const auto join = [&](std::size_t i, std::size_t j) {
      if (i == j) return;
      const double k = weight(decades);
      problem.add(i, i, k);
      problem.add(j, j, k);
      problem.add(i, j, -k);
      problem.add(j, i, -k);
    };
    for (std::size_t i = first + 1; i < last; ++i)
      join(random_.chance(0.7) ? i - 1 : first + index(i - first), i);
    for (std::size_t k = 0; k < (last - first) / 4; ++k)
      join(first + index(last - first), first + index(last - first));
  }

  DataProblem laplacian(std::size_t n, int decades, bool solvable) {
    DataProblem problem(n);
    problem.kind = decades == 0 ? "Laplacian" : "Laplacian, springs 1 ... 64";
    springs(problem, 0, n, decades);
    if (solvable)
      solve_by_something(problem);
    else
      exclude(problem, std::vector<double>(n, 1.0));
    return problem;
  }

  /// M = [0 -A'; A 0]: the rows of a linear program. Unsolvable: a row of A and a multiple of another, or of
  /// a sum of two, contradict each other.
  DataProblem skew(std::size_t n, bool solvable) {
    const std::size_t columns = std::max<std::size_t>(1, n / 2);
    const std::size_t faces = std::max<std::size_t>(3, n - columns);
    DataProblem problem(columns + faces);
    problem.kind = "skew";
    std::vector<std::vector<double>> A(faces, std::vector<double>(columns, 0.0));
    const std::size_t entries = std::min<std::size_t>(columns, 4);
    for (auto& row : A)
      for (std::size_t k = 0; k < entries; ++k)
        row[index(columns)] = integer(-3, 3);
    std::vector<double> d(problem.size(), 0.0);
    const bool three = random_.chance(0.5);
    const double multiple = weight(3);
    for (std::size_t j = 0; j < columns; ++j)
      A[0][j] = -multiple * (A[1][j] + (three ? A[2][j] : 0.0));
    d[columns] = 1.0;
    d[columns + 1] = multiple;
    if (three) d[columns + 2] = multiple;
    for (std::size_t a = 0; a < faces; ++a)
      for (std::size_t j = 0; j < columns; ++j)
        if (A[a][j] != 0.0) {
          problem.add(columns + a, j, A[a][j]);
          problem.add(j, columns + a, -A[a][j]);
        }
    if (solvable)
      solve_by_something(problem);
    else
      exclude(problem, d);
    return problem;
  }

  /// M = B B' with d'B = 0, d of powers of two.
  DataProblem low_rank(std::size_t n, bool solvable) {
    n = std::max<std::size_t>(2, std::min<std::size_t>(n, 120));  // dense
    DataProblem problem(n);
    problem.kind = "low rank";
    const std::size_t rank = random_.chance(0.5) ? 1 : 1 + index(n - 1);
    std::vector<double> d(n);
    for (double& value : d)
      value = weight(2);
    d[0] = 1.0;
    for (std::size_t k = 0; k < rank; ++k) {
      std::vector<double> b(n);
      double sum = 0.0;
      for (std::size_t i = 1; i < n; ++i) {
        b[i] = integer(-2, 2);
        sum += d[i] * b[i];
      }
      b[0] = -sum;
      for (std::size_t i = 0; i < n; ++i)
        for (std::size_t j = 0; j < n; ++j)
          if (b[i] * b[j] != 0.0) problem.add(i, j, b[i] * b[j]);
    }
    if (solvable)
      solve_by_something(problem);
    else
      exclude(problem, d);
    return problem;
  }

  /// Equations with multipliers: a definite block, and constraints of which some repeat each other.
  DataProblem saddle(std::size_t n, bool solvable) {
    const std::size_t states = std::max<std::size_t>(2, n / 2);
    const std::size_t faces = std::max<std::size_t>(2, n - states);
    DataProblem problem(states + faces);
    problem.kind = "saddle";
    std::fill_n(problem.free.begin(), states, 1);
    for (std::size_t i = 0; i < states; ++i)
      problem.add(i, i, 1.0 + weight(3));
    for (std::size_t a = 0; a < faces; ++a) {
      const double sign = a % 2 == 0 ? 1.0 : -1.0;
      const std::size_t i = (a / 2) % states;
      const std::size_t j = (i + 1) % states;
      for (const auto& [column, value] : {std::pair{i, sign}, std::pair{j, -sign}}) {
        if (states == 2 && column == j) continue;
        problem.add(states + a, column, value);
        problem.add(column, states + a, -value);
      }
    }
    std::vector<double> d(problem.size(), 0.0);
    d[states] = d[states + 1] = 1.0;
    if (solvable)
      solve_by_something(problem);
    else
      exclude(problem, d);
    return problem;
  }

  /// A Laplacian that is unsolvable, or not, beside one that is grounded and 2^30 as large.
  DataProblem two_parts(std::size_t n, bool solvable) {
    const std::size_t half = std::max<std::size_t>(2, n / 2);
    DataProblem problem(2 * half);
    problem.kind = "beside a larger one";
    springs(problem, 0, half, 0);
    springs(problem, half, 2 * half, 0);
    problem.add(half, half, 1.0);
    if (solvable) {
      solve_by_something(problem);
    } else {
      std::vector<double> d(2 * half, 0.0);
      std::fill_n(d.begin(), half, 1.0);
      exclude(problem, d);
    }
    for (std::size_t i = half; i < 2 * half; ++i)
      problem.q[i] *= 0x1p30;
    return problem;
  }

  /// Not symmetric: M'd = 0 and M e = 0, a directed flow with as much out as in.
  DataProblem directed(std::size_t n, bool solvable) {
    DataProblem problem(n);
    problem.kind = "directed";
    const auto cycle = [&](std::size_t length) {
      const double k = weight(3);
      const std::size_t first = index(n);
      const std::size_t stride = 1 + index(n > 2 ? n - 1 : 1);
      std::size_t i = first;
      for (std::size_t step = 0; step < length; ++step) {
        const std::size_t j = step + 1 == length ? first : (i + stride) % n;
        if (i != j) {
          problem.add(i, i, k);
          problem.add(i, j, -k);
        }
        i = j;
      }
    };
    for (std::size_t i = 0; i < n; ++i) {  // around all of them
      problem.add(i, i, 1.0);
      problem.add(i, (i + 1) % n, -1.0);
    }
    for (std::size_t k = 0; k < n / 3; ++k)
      cycle(2 + index(4));
    if (solvable)
      solve_by_something(problem);
    else
      exclude(problem, std::vector<double>(n, 1.0));
    return problem;
  }

  Random random_;
};

inline Solved solve(const DataProblem& problem) {
  PetscInt local = PETSC_DECIDE;
  PetscInt total = static_cast<PetscInt>(problem.size());
  check(PetscSplitOwnership(PETSC_COMM_WORLD, &local, &total));
  Vector q = make_vector(PETSC_COMM_WORLD, local);
  PetscInt first = 0;
  check(VecGetOwnershipRange(q.get(), &first, nullptr));
  const auto piece = [&](auto&& value) {
    Vector mine = duplicate(q.get());
    const WriteArray to(mine.get());
    for (PetscInt i = 0; i < local; ++i)
      to[i] = value(static_cast<std::size_t>(first + i));
    return mine;
  };
  RowBuilder rows;
  for (PetscInt i = first; i < first + local; ++i) {
    for (const auto& [column, value] : problem.rows[static_cast<std::size_t>(i)])
      rows.add(column, value);
    rows.end_row();
  }
  AffineVi vi(rows.finish(PETSC_COMM_WORLD, local), piece([&](std::size_t i) { return problem.q[i]; }),
              piece([&](std::size_t i) { return problem.free[i] != 0 ? PETSC_NINFINITY : 0.0; }),
              piece([](std::size_t) { return PETSC_INFINITY; }),
              piece([&](std::size_t i) { return problem.u0[i]; }));
  NonlinearSolver snes;
  check(SNESCreate(PETSC_COMM_WORLD, snes.put()));
  StepSolver solver(snes.get(), vi);
  Solved solved;
  solved.report = solver.solve({1, 0.0, 0.0, 0.0});
  solved.u = VectorXd::Zero(static_cast<Index>(problem.size()));
  {
    const ReadArray mine(solver.solution());
    for (PetscInt i = 0; i < mine.size(); ++i)
      solved.u[first + i] = mine[i];
  }
  MPI_Allreduce(MPI_IN_PLACE, solved.u.data(), static_cast<int>(solved.u.size()), MPI_DOUBLE, MPI_SUM,
                PETSC_COMM_WORLD);
  return solved;
}

}  // namespace sweepvi::test
