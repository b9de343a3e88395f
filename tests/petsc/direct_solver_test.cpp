// ranks: 1 2 3
// The default for linear systems: exact to rounding on any number of ranks, the same bits whatever was
// factored before, and failures that every rank hears of.
#include "petsc/direct_solver.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "dvi/systems.hpp"
#include "petsc/gathered_lu.hpp"
#include "petsc/guarded_setup.hpp"
#include "petsc/sparse.hpp"

namespace sweepvi {
namespace {

using test::ScopedOption;

int ranks() {
  int size = 1;
  MPI_Comm_size(PETSC_COMM_WORLD, &size);
  return size;
}

int rank() {
  int number = 0;
  MPI_Comm_rank(PETSC_COMM_WORLD, &number);
  return number;
}

/// A solver as the program makes them.
LinearSolver make_solver(Mat matrix) {
  LinearSolver solver;
  check(KSPCreate(PETSC_COMM_WORLD, solver.put()));
  check(KSPSetOperators(solver.get(), matrix, matrix));
  configure(solver.get());
  return solver;
}

/// Rows of this rank: `size` in all, none on the last of several ranks.
LocalRange share_of(PetscInt size) {
  const PetscInt owners = std::max(1, ranks() - 1);
  const PetscInt r = std::min<PetscInt>(rank(), owners);
  return {size * r / owners, size * std::min(r + 1, owners) / owners};
}

/// The matrix of a chain in contact: [lower triangular, -I; H, 0], where multipliers have no diagonal; some
/// are pinned, with a unit row in place of theirs. As of outputs and their rates, the pattern is far from
/// symmetric: MUMPS would look at the values before it orders such a matrix. `seed` chooses values, over
/// `decades`, and pinned rows; the pattern is always the same.
Matrix saddle(PetscInt size, unsigned seed, int decades = 0) {
  std::mt19937 generator(seed);
  std::uniform_real_distribution<double> uniform(0.5, 1.5);
  std::vector<double> value;
  std::vector<char> pinned;
  for (PetscInt i = 0; i < size; ++i) {
    value.push_back(uniform(generator) * std::pow(10.0, decades * (uniform(generator) - 1.0)));
    pinned.push_back(uniform(generator) < 0.8 ? 1 : 0);
  }
  RowBuilder rows;
  const LocalRange mine = share_of(2 * size);
  for (PetscInt row = mine.first; row < mine.last; ++row) {
    const PetscInt i = row / 2;
    const auto at = [&](PetscInt k) { return value[static_cast<std::size_t>(k)]; };
    if (row % 2 == 0) {
      rows.add(row, 2.0 + at(i));
      for (const PetscInt back : {1, 2, 3, 4})
        if (i >= back) rows.add(row - 2 * back, -0.5 * at(i - back));
      rows.add(row + 1, -1.0);
    } else {
      const bool unit = pinned[static_cast<std::size_t>(i)] != 0;
      rows.add(row, unit ? 1.0 : 0.0);
      rows.add(row - 1, unit ? 0.0 : 1.0);
      if (i > 0) rows.add(row - 3, unit ? 0.0 : -1.0);
    }
    rows.end_row();
  }
  return rows.finish(PETSC_COMM_WORLD, mine.size());
}

Vector some_vector(Mat matrix, double scale = 1.0) {
  Vector vector;
  check(MatCreateVecs(matrix, vector.put(), nullptr));
  const PetscInt first = row_range(matrix).first;
  const WriteArray values(vector.get());
  for (PetscInt i = 0; i < values.size(); ++i)
    values[i] = scale * std::sin(1.0 + 3.7 * static_cast<double>(first + i));
  return vector;
}

std::vector<double> solution_of(KSP solver, Mat matrix) {
  const Vector right = some_vector(matrix);
  const Vector solution = duplicate(right.get());
  EXPECT_TRUE(solve(solver, matrix, right.get(), solution.get()));
  const ReadArray values(solution.get());
  return {values.data(), values.data() + values.size()};
}

/// |A x - b| / (|A| |x|), in the maximum norm.
double backward_error(KSP solver, Mat matrix) {
  const Vector exact = some_vector(matrix);
  const Vector right = duplicate(exact.get());
  const Vector solution = duplicate(exact.get());
  check(MatMult(matrix, exact.get(), right.get()));
  EXPECT_TRUE(solve(solver, matrix, right.get(), solution.get()));
  const Vector rest = duplicate(exact.get());
  check(MatMult(matrix, solution.get(), rest.get()));
  check(VecAXPY(rest.get(), -1.0, right.get()));
  double error = 0.0;
  double size = 0.0;
  double norm = 0.0;
  check(VecNorm(rest.get(), NORM_INFINITY, &error));
  check(VecNorm(solution.get(), NORM_INFINITY, &size));
  check(MatNorm(matrix, NORM_INFINITY, &norm));
  return error / (size * norm);
}

std::string type_of(KSP solver) {
  PC pc = nullptr;
  PCType type = nullptr;
  check(KSPGetPC(solver, &pc));
  check(PCGetType(pc, &type));
  return type;
}

TEST(DirectSolver, SolvesUpToRounding) {
  const Matrix matrix = saddle(300, 1);
  const LinearSolver solver = make_solver(matrix.get());
  EXPECT_EQ(type_of(solver.get()), ranks() > 1 ? gathered_lu_type : PCLU);
  EXPECT_LE(backward_error(solver.get(), matrix.get()), 1e-14);  // growth of a few times rounding
}

TEST(DirectSolver, ForgetsWhatItFactoredBefore) {
  const Matrix last = saddle(300, 2);
  const std::vector<double> fresh = solution_of(make_solver(last.get()).get(), last.get());
  for (const unsigned seed : {3U, 4U, 5U}) {
    const Matrix matrix = saddle(300, seed, 8);
    const LinearSolver solver = make_solver(matrix.get());
    static_cast<void>(solution_of(solver.get(), matrix.get()));
    check(MatCopy(last.get(), matrix.get(), SAME_NONZERO_PATTERN));
    EXPECT_EQ(solution_of(solver.get(), matrix.get()), fresh) << "after seed " << seed;
  }
}

TEST(DirectSolver, GivesTheSameBitsEveryTime) {
  const Matrix matrix = saddle(3000, 6);
  const std::vector<double> first = solution_of(make_solver(matrix.get()).get(), matrix.get());
  for (int again = 0; again < 5; ++again)
    EXPECT_EQ(solution_of(make_solver(matrix.get()).get(), matrix.get()), first);
}

TEST(DirectSolver, TakesAnotherPatternAndAnotherSize) {
  const Matrix matrix = saddle(40, 7);
  const LinearSolver solver = make_solver(matrix.get());
  EXPECT_LE(backward_error(solver.get(), matrix.get()), 1e-14);
  RowBuilder rows;
  const LocalRange mine = row_range(matrix.get());
  for (PetscInt row = mine.first; row < mine.last; ++row) {
    rows.add(row, 2.0);
    rows.add((row + 7) % 80, 1.0);
    rows.end_row();
  }
  const Matrix other = rows.finish(PETSC_COMM_WORLD, mine.size());
  check(KSPSetOperators(solver.get(), other.get(), other.get()));
  EXPECT_LE(backward_error(solver.get(), other.get()), 1e-15);
  const Matrix smaller = saddle(11, 8);
  check(KSPReset(solver.get()));
  check(KSPSetOperators(solver.get(), smaller.get(), smaller.get()));
  EXPECT_LE(backward_error(solver.get(), smaller.get()), 1e-14);
}

TEST(DirectSolver, SolvesTransposedSystems) {
  const Matrix matrix = saddle(50, 9);
  const LinearSolver solver = make_solver(matrix.get());
  const Vector exact = some_vector(matrix.get());
  const Vector right = duplicate(exact.get());
  const Vector solution = duplicate(exact.get());
  check(MatMultTranspose(matrix.get(), exact.get(), right.get()));
  check(KSPSolveTranspose(solver.get(), right.get(), solution.get()));
  check(VecAXPY(solution.get(), -1.0, exact.get()));
  double error = 0.0;
  check(VecNorm(solution.get(), NORM_INFINITY, &error));
  EXPECT_LE(error, 1e-11);  // the condition number is some 1e3
}

TEST(DirectSolver, HasSerialPackagesOnAnyNumberOfRanks) {
  const ScopedOption package("-pc_factor_mat_solver_type", "petsc");
  const ScopedOption ordering("-pc_factor_mat_ordering_type", "natural");
  RowBuilder rows;
  const LocalRange mine = share_of(30);
  for (PetscInt row = mine.first; row < mine.last; ++row) {
    rows.add(row, 2.0);
    if (row > 0) rows.add(row - 1, -1.0);
    rows.end_row();
  }
  const Matrix matrix = rows.finish(PETSC_COMM_WORLD, mine.size());
  const LinearSolver solver = make_solver(matrix.get());
  PC pc = nullptr;
  check(KSPGetPC(solver.get(), &pc));
  EXPECT_NO_THROW(check_factorization(pc, matrix.get()));
  EXPECT_LE(backward_error(solver.get(), matrix.get()), 1e-15);
}

TEST(DirectSolver, RefusesPackagesThatCannotDoIt) {
  for (const char* type : {"lu", "gathered"}) {
    const ScopedOption chosen("-pc_type", type);
    const ScopedOption package("-pc_factor_mat_solver_type", "nonsense");
    const Matrix matrix = saddle(4, 10);
    const LinearSolver solver = make_solver(matrix.get());
    PC pc = nullptr;
    check(KSPGetPC(solver.get(), &pc));
    EXPECT_THROW(check_factorization(pc, matrix.get()), InputError) << type;
  }
}

TEST(DirectSolver, LeavesTheChoiceToOptions) {
  const Matrix matrix = saddle(4, 11);
  for (const char* type : {"lu", "bjacobi", "gathered"}) {
    const ScopedOption chosen("-pc_type", type);
    EXPECT_EQ(type_of(make_solver(matrix.get()).get()), type);
  }
  const ScopedOption chosen("-pc_type", "lu");
  const LinearSolver solver = make_solver(matrix.get());
  PC pc = nullptr;
  MatSolverType package = nullptr;
  check(KSPGetPC(solver.get(), &pc));
  check(PCFactorGetMatSolverType(pc, &package));
  EXPECT_STREQ(package, MATSOLVERMUMPS);
}

TEST(DirectSolver, SaysOnAllRanksThatAMatrixIsSingular) {
  const Matrix matrix = saddle(20, 12);
  const LinearSolver solver = make_solver(matrix.get());
  EXPECT_LE(backward_error(solver.get(), matrix.get()), 1e-14);
  const Matrix good = saddle(20, 12);
  const PetscInt zero_row = 6;  // of a state
  const LocalRange mine = row_range(matrix.get());
  check(MatSetOption(matrix.get(), MAT_KEEP_NONZERO_PATTERN, PETSC_TRUE));
  check(MatZeroRows(matrix.get(), mine.contains(zero_row) ? 1 : 0, &zero_row, 0.0, nullptr, nullptr));
  const Vector right = some_vector(matrix.get());
  const Vector solution = duplicate(right.get());
  EXPECT_FALSE(solve(solver.get(), matrix.get(), right.get(), solution.get()));
  check(MatCopy(good.get(), matrix.get(), SAME_NONZERO_PATTERN));  // and goes on
  EXPECT_LE(backward_error(solver.get(), matrix.get()), 1e-14);
}

// KLU raises an error then, and in the second case on one rank only.
TEST(DirectSolver, AnErrorOfThePackageIsAFailureOnAllRanks) {
  Matrix empty;
  PetscBool available = PETSC_FALSE;
  check(MatCreateSeqAIJ(PETSC_COMM_SELF, 0, 0, 0, nullptr, empty.put()));
  check(MatGetFactorAvailable(empty.get(), MATSOLVERKLU, MAT_FACTOR_LU, &available));
  if (available == PETSC_FALSE) GTEST_SKIP() << "PETSc has no KLU";
  for (const char* type : {"gathered", "bjacobi"}) {
    const ScopedOption chosen("-pc_type", type);
    const ScopedOption package("-pc_factor_mat_solver_type", "klu");
    const ScopedOption sub_type("-sub_pc_type", "lu");
    const ScopedOption sub_package("-sub_pc_factor_mat_solver_type", "klu");
    const Matrix matrix = saddle(20, 12);
    check(MatSetOption(matrix.get(), MAT_KEEP_NONZERO_PATTERN, PETSC_TRUE));
    const LocalRange mine = row_range(matrix.get());
    const PetscInt zero_row = 6;
    check(MatZeroRows(matrix.get(), mine.contains(zero_row) ? 1 : 0, &zero_row, 0.0, nullptr, nullptr));
    const LinearSolver solver = make_solver(matrix.get());
    const Vector right = some_vector(matrix.get());
    const Vector solution = duplicate(right.get());
    EXPECT_FALSE(solve(solver.get(), matrix.get(), right.get(), solution.get())) << type;
  }
}

TEST(DirectSolver, APreconditionerThatCannotBeSetUpIsBadInput) {
  const ScopedOption chosen("-pc_type", "fieldsplit");  // and no splits
  const Matrix matrix = saddle(4, 11);
  const LinearSolver solver = make_solver(matrix.get());
  const Vector right = some_vector(matrix.get());
  const Vector solution = duplicate(right.get());
  EXPECT_THROW(try_preconditioner(solver.get(), matrix.get()), Error);
  try {
    static_cast<void>(solve(solver.get(), matrix.get(), right.get(), solution.get()));
    FAIL() << "no error";
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ExitCode::bad_input);
    EXPECT_NE(std::string(error.what()).find("fieldsplit"), std::string::npos) << error.what();
  }
}

TEST(DirectSolver, MakesRoomWhereMumpsRunsOutOfWorkspace) {
  const ScopedOption little("-mat_mumps_icntl_14", "-95");  // per cent more than foreseen
  const Matrix matrix = saddle(3000, 13);
  const LinearSolver solver = make_solver(matrix.get());
  const Vector right = some_vector(matrix.get());
  const Vector solution = duplicate(right.get());
  check(KSPSolve(solver.get(), right.get(), solution.get()));
  KSPConvergedReason reason = KSP_CONVERGED_ITERATING;
  check(KSPGetConvergedReason(solver.get(), &reason));
  EXPECT_EQ(reason, KSP_DIVERGED_PC_FAILED);
  PC pc = nullptr;
  PCFailedReason why = PC_NOERROR;
  check(KSPGetPC(solver.get(), &pc));
  check(PCGetFailedReason(pc, &why));
  EXPECT_EQ(why, PC_FACTOR_OUTMEMORY);
  EXPECT_LE(backward_error(solver.get(), matrix.get()), 1e-14);
}

TEST(DirectSolver, AnEmptyMatrixIsNoFailure) {
  const ScopedOption type("-pc_type", "gathered");
  RowBuilder rows;
  const Matrix matrix = rows.finish(PETSC_COMM_WORLD, 0);
  const LinearSolver solver = make_solver(matrix.get());
  EXPECT_TRUE(solution_of(solver.get(), matrix.get()).empty());
}

}  // namespace
}  // namespace sweepvi
