// ranks: 1 2 3
// The owners of PETSc objects: reference counts, moves, assignment over a live object, sharing.
#include <gtest/gtest.h>

#include "sweepvi/petsc.hpp"

namespace sweepvi {
namespace {

Vector make(PetscInt size = 3) {
  Vector vector;
  check(VecCreate(PETSC_COMM_WORLD, vector.put()));
  check(VecSetSizes(vector.get(), PETSC_DECIDE, size));
  check(VecSetType(vector.get(), VECSTANDARD));
  return vector;
}

PetscInt references(Vec vector) {
  PetscInt count = 0;
  check(PetscObjectGetReference(reinterpret_cast<PetscObject>(vector), &count));
  return count;
}

TEST(Handle, IsEmptyByDefaultAndAfterAMove) {
  Vector empty;
  EXPECT_FALSE(empty);
  Vector first = make();
  Vec raw = first.get();
  Vector second = std::move(first);
  EXPECT_FALSE(first);  // NOLINT(bugprone-use-after-move)
  EXPECT_EQ(second.get(), raw);
  EXPECT_EQ(references(raw), 1);
}

TEST(Handle, AssignmentDestroysWhatWasThere) {
  Vector target = make();
  const Vector watcher = Vector::share(target.get());
  EXPECT_EQ(references(watcher.get()), 2);
  target = make();
  EXPECT_EQ(references(watcher.get()), 1);
}

TEST(Handle, SelfMoveKeepsTheObject) {
  Vector vector = make();
  Vector& alias = vector;
  vector = std::move(alias);
  ASSERT_TRUE(vector);
  EXPECT_EQ(references(vector.get()), 1);
}

TEST(Handle, SharingCountsUpAndDown) {
  Vector owner = make();
  {
    const Vector shared = Vector::share(owner.get());
    EXPECT_EQ(references(owner.get()), 2);
  }
  EXPECT_EQ(references(owner.get()), 1);
}

TEST(Handle, PutReleasesTheOldObject) {
  Vector vector = make();
  const Vector watcher = Vector::share(vector.get());
  check(VecCreate(PETSC_COMM_WORLD, vector.put()));
  EXPECT_EQ(references(watcher.get()), 1);
}

TEST(Check, ThrowsWithPetscsText) {
  Vector vector = make();
  try {
    check(VecSetType(vector.get(), "no such type"));
    FAIL() << "an unknown type was accepted";
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ExitCode::internal);
    EXPECT_NE(std::string(error.what()).find("no such type"), std::string::npos) << error.what();
  }
}

TEST(Agree, EveryRankGetsTheLowestComplaint) {
  int rank = 0;
  int size = 1;
  MPI_Comm_rank(PETSC_COMM_WORLD, &rank);
  MPI_Comm_size(PETSC_COMM_WORLD, &size);
  const int lowest = size > 1 ? 1 : 0;  // rank 0 is content when there are others
  std::optional<Error> complaint;
  if (rank >= lowest) complaint = Error(ExitCode::bad_input, "from rank " + std::to_string(rank));
  try {
    agree(PETSC_COMM_WORLD, complaint);
    FAIL() << "the complaint was lost";
  } catch (const Error& error) {
    EXPECT_EQ(error.what(), "from rank " + std::to_string(lowest));
    EXPECT_EQ(error.code(), ExitCode::bad_input);
  }
  EXPECT_NO_THROW(agree(PETSC_COMM_WORLD, std::nullopt));
}

}  // namespace
}  // namespace sweepvi
