// ranks: 1 2 3
#include "petsc/affine_rows.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>
#include <random>
#include <vector>

#include "petsc/sparse.hpp"

namespace sweepvi {
namespace {

constexpr PetscInt own_rows = 40;

using Fill = std::function<void(RowBuilder&, PetscInt row, PetscInt size)>;

Matrix square(const Fill& fill) {
  int ranks = 1, rank = 0;
  MPI_Comm_size(PETSC_COMM_WORLD, &ranks);
  MPI_Comm_rank(PETSC_COMM_WORLD, &rank);
  RowBuilder rows;
  for (PetscInt i = rank * own_rows; i < (rank + 1) * own_rows; ++i) {
    fill(rows, i, ranks * own_rows);
    rows.end_row();
  }
  return rows.finish(PETSC_COMM_WORLD, own_rows);
}

// A chain; with period > 1 elements of several unknowns, of which the first are coupled.
Fill chain(PetscInt period) {
  return [period](RowBuilder& rows, PetscInt row, PetscInt size) {
    const PetscInt phase = row % period;
    if (phase == 0 && row >= period) rows.add(row - period, -0.25);
    rows.add(row, 1.0 + 0.1 * static_cast<double>(phase));
    if (phase + 1 < period) rows.add(row + 1, -1e-2);
    if (phase == 0 && row + period < size) rows.add(row + period, -0.3);
  };
}

// No two rows alike; some empty.
void irregular(RowBuilder& rows, PetscInt row, PetscInt size) {
  std::mt19937 engine(static_cast<unsigned>(row) + 1);
  for (PetscInt k = row % 7; k > 0; --k)
    rows.add(static_cast<PetscInt>(engine() % static_cast<unsigned>(size)),
             static_cast<double>(engine()) * 1e-9 - 2.0);
}

Vector waves(Vec like, double phase) {
  Vector result = duplicate(like);
  PetscInt first = 0;
  check(VecGetOwnershipRange(like, &first, nullptr));
  const WriteArray values(result.get());
  for (PetscInt i = 0; i < values.size(); ++i)
    values[i] = std::sin(phase + 1.7 * static_cast<double>(first + i));
  return result;
}

Vector absolute(const Vector& from) {
  Vector result = duplicate(from.get());
  check(VecCopy(from.get(), result.get()));
  check(VecAbs(result.get()));
  return result;
}

// Sums of up to 8 terms of size 3, in another order.
void expect_near(const Vector& expected, const Vector& found) {
  const ReadArray a(expected.get());
  const ReadArray b(found.get());
  for (PetscInt i = 0; i < a.size(); ++i)
    EXPECT_NEAR(a[i], b[i], 5e-15) << "row " << i;
}

class Rows : public testing::TestWithParam<int> {
protected:
  Matrix matrix() const {
    switch (GetParam()) {
      case 0:
        return square(irregular);
      default:
        return square(chain(GetParam()));
    }
  }
};

TEST_P(Rows, AreThoseOfMatMult) {
  const Matrix K = matrix();
  const Matrix size = absolute_copy(K.get());
  const AffineRows rows(K.get());
  EXPECT_EQ(rows.size(), own_rows);
  Vector like;
  check(MatCreateVecs(K.get(), like.put(), nullptr));
  const Vector u = waves(like.get(), 0.3);
  const Vector b = waves(like.get(), 1.1);
  const Vector terms_of_b = absolute(b);
  const Vector f = duplicate(like.get()), terms = duplicate(like.get());
  const Vector expected = duplicate(like.get()), expected_terms = duplicate(like.get());
  check(MatMult(K.get(), u.get(), expected.get()));
  check(VecAXPY(expected.get(), -1.0, b.get()));
  check(MatMultAdd(size.get(), absolute(u).get(), terms_of_b.get(), expected_terms.get()));

  rows.residual(u.get(), b.get(), f.get());
  rows.terms(u.get(), terms_of_b.get(), terms.get());
  expect_near(expected, f);
  expect_near(expected_terms, terms);

  check(VecSet(f.get(), NAN));
  check(VecSet(terms.get(), NAN));
  rows.evaluate(u.get(), b.get(), terms_of_b.get(), f.get(), terms.get());
  expect_near(expected, f);
  expect_near(expected_terms, terms);

  check(VecAXPY(expected.get(), 1.0, b.get()));
  check(VecAXPY(expected_terms.get(), -1.0, terms_of_b.get()));
  rows.map(u.get(), absolute(u).get(), f.get(), terms.get());
  expect_near(expected, f);
  expect_near(expected_terms, terms);

  check(VecCopy(b.get(), f.get()));
  check(VecCopy(terms_of_b.get(), terms.get()));
  rows.add_product(u.get(), f.get(), terms.get());
  check(VecAXPY(expected.get(), 1.0, b.get()));
  check(VecAXPY(expected_terms.get(), 1.0, terms_of_b.get()));
  expect_near(expected, f);
  expect_near(expected_terms, terms);
}

// Apart: rows of a kind that are side by side do not follow each other.
TEST_P(Rows, AreEachVisitedOnce) {
  const Matrix K = matrix();
  const AffineRows rows(K.get());
  Vector like;
  check(MatCreateVecs(K.get(), like.put(), nullptr));
  const Vector u = waves(like.get(), 0.3);
  const Vector expected = duplicate(like.get());
  rows.multiply(u.get(), expected.get());
  const double* const others = rows.ghosts(u.get());
  const ReadArray own(u.get());
  const ReadArray sums(expected.get());
  for (const bool apart : {false, true}) {
    std::vector<PetscInt> visited;
    const auto visit = [&](PetscInt i, const AffineRows::Row& row) {
      visited.push_back(i);
      EXPECT_DOUBLE_EQ(row.sum, sums[i]) << "row " << i;
    };
    if (apart)
      rows.each_row_apart(own.data(), others, visit);
    else
      rows.each_row(own.data(), others, visit);
    if (apart && GetParam() == 1) {
      EXPECT_EQ(visited[3] - visited[2], 2);
    }
    std::sort(visited.begin(), visited.end());
    std::vector<PetscInt> all(own_rows);
    std::iota(all.begin(), all.end(), 0);
    EXPECT_EQ(visited, all);
  }
}

INSTANTIATE_TEST_SUITE_P(Kinds, Rows, testing::Values(0, 1, 2, 5), [](const auto& kind) {
  return kind.param == 0 ? std::string("irregular") : "chain" + std::to_string(kind.param);
});

// Twice as many columns as rows, or half: which columns are our own is told by the columns.
TEST(AffineRows, MayBeRectangular) {
  int ranks = 1, rank = 0;
  MPI_Comm_size(PETSC_COMM_WORLD, &ranks);
  MPI_Comm_rank(PETSC_COMM_WORLD, &rank);
  for (const PetscInt columns : {own_rows / 2, 2 * own_rows}) {
    RowBuilder builder;
    for (PetscInt i = rank * own_rows; i < (rank + 1) * own_rows; ++i) {
      builder.add((3 * i) % (ranks * columns), 2.0);
      builder.add((5 * i + 1) % (ranks * columns), -1.0);
      builder.end_row();
    }
    const Matrix K = builder.finish(PETSC_COMM_WORLD, columns);
    Vector x, y;
    check(MatCreateVecs(K.get(), x.put(), y.put()));
    const Vector u = waves(x.get(), 0.2);
    const Vector zero = duplicate(y.get()), f = duplicate(y.get());
    check(VecSet(zero.get(), 0.0));
    check(MatMult(K.get(), u.get(), y.get()));
    AffineRows(K.get()).residual(u.get(), zero.get(), f.get());
    expect_near(y, f);
  }
}

}  // namespace
}  // namespace sweepvi
