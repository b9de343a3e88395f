// ranks: 1 2 3 5
// What is kept per row follows its row to another rank.
#include <gtest/gtest.h>

#include <numeric>

#include "parallel/row_move.hpp"

namespace sweepvi::test {
namespace {

/// Rows 0 ... 9, all on the last rank, in steps of three: 0 3 6 9 2 5 8 1 4 7 dealt out over the ranks.
class RowMoves : public testing::Test {
protected:
  static constexpr PetscInt count = 10;

  RowMoves() {
    MPI_Comm_rank(comm_, &rank_);
    MPI_Comm_size(comm_, &ranks_);
    if (rank_ == ranks_ - 1)
      for (PetscInt row = 0; row < count; ++row)
        old_.push_back(row);
    PetscInt mine = PETSC_DECIDE;
    PetscInt total = count;
    check(PetscSplitOwnership(comm_, &mine, &total));
    PetscInt last = 0;
    MPI_Scan(&mine, &last, 1, MPIU_INT, MPI_SUM, comm_);
    for (PetscInt row = last - mine; row < last; ++row)
      new_.push_back(3 * row % count);
  }

  RowMove move(const std::vector<PetscInt>& rows) const {
    return {comm_, static_cast<PetscInt>(old_.size()), rows};
  }

  MPI_Comm comm_ = PETSC_COMM_WORLD;
  int rank_ = 0;
  int ranks_ = 1;
  std::vector<PetscInt> old_, new_;
};

TEST_F(RowMoves, CarryValuesOfAnyKind) {
  struct Named {
    double value;
    char letter;
  };
  std::vector<Named> values;
  for (const PetscInt row : old_)
    values.push_back({0.5 * static_cast<double>(row), static_cast<char>('a' + row)});
  const std::vector<Named> moved = move(new_).moved(values);
  ASSERT_EQ(moved.size(), new_.size());
  for (std::size_t i = 0; i < moved.size(); ++i) {
    EXPECT_EQ(moved[i].value, 0.5 * static_cast<double>(new_[i]));
    EXPECT_EQ(moved[i].letter, 'a' + new_[i]);
  }
}

TEST_F(RowMoves, TellWhereEachRowWent) {
  const std::vector<PetscInt> numbers = move(new_).new_numbers();
  ASSERT_EQ(numbers.size(), old_.size());
  for (std::size_t row = 0; row < numbers.size(); ++row)
    EXPECT_EQ(3 * numbers[row] % count, static_cast<PetscInt>(row));
}

TEST_F(RowMoves, MayAskForARowTwiceAndForNone) {
  const std::vector<PetscInt> wanted = rank_ == 0 ? std::vector<PetscInt>{7, 2, 7} : std::vector<PetscInt>{};
  EXPECT_EQ(move(wanted).moved(old_), wanted);
}

TEST_F(RowMoves, KnowWhetherAnythingMoves) {
  EXPECT_TRUE(move(new_).moves());
  EXPECT_FALSE(move(old_).moves());
  std::vector<PetscInt> first_owns_all(rank_ == 0 ? count : 0);
  std::iota(first_owns_all.begin(), first_owns_all.end(), 0);
  EXPECT_EQ(move(first_owns_all).moves(), ranks_ > 1);
}

TEST_F(RowMoves, CarryVectorsMatricesAndForcesAlike) {
  const RowMove rows = move(new_);
  // f_i = i, and diag(i) shifted by one column: row i reads x_{i + 1}
  RowBuilder builder;
  Vector x = make_vector(comm_, static_cast<PetscInt>(old_.size()));
  std::vector<Signal> all;
  for (PetscInt i = 0; i < count; ++i)
    all.push_back({static_cast<double>(i), 0.0, 0.0, 0.0});
  for (const PetscInt row : old_) {
    builder.add((row + 1) % count, static_cast<double>(row));
    builder.end_row();
    WriteArray(x.get())[row] = static_cast<double>(row);
  }
  const Matrix A = moved(builder.finish(comm_, static_cast<PetscInt>(old_.size())).get(), rows, rows);
  const Forcing f = moved(comm_, Forcing::from(all, 0, static_cast<PetscInt>(old_.size())), rows);
  x = rows.moved(x.get());
  Vector y = duplicate(x.get());
  check(MatMult(A.get(), x.get(), y.get()));
  f.add_to(y.get(), 0.0, 0, 1.0);
  const ReadArray values(y.get());
  for (std::size_t i = 0; i < new_.size(); ++i) {
    const PetscInt row = new_[i];
    EXPECT_EQ(values[static_cast<PetscInt>(i)], static_cast<double>(row * ((row + 1) % count) + row));
  }
}

}  // namespace
}  // namespace sweepvi::test
