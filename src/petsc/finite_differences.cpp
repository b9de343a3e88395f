#include "petsc/finite_differences.hpp"

#include <algorithm>
#include <utility>

#include "petsc/sparse.hpp"

namespace sweepvi {

namespace {

// PETSc has changed how it declares this callback; its type is what the call takes.
template <class Call>
struct SecondParameter;
template <class Result, class First, class Second, class... Rest>
struct SecondParameter<Result (*)(First, Second, Rest...)> {
  using Type = Second;
};
using DifferencesCallback = SecondParameter<decltype(&MatFDColoringSetFunction)>::Type;

// The pattern of |P| + |P'| + I: PETSc's parallel colourings take it for granted that a pattern is symmetric.
Matrix symmetric(Mat pattern) {
  const LocalRange range = row_range(pattern);
  RowBuilder ones;
  RowBuilder identity;
  for_each_row(pattern, [&](PetscInt row, auto columns, auto) {
    for (const PetscInt column : columns)
      ones.add(column, 1.0);
    ones.end_row();
    identity.add(row, 1.0);
    identity.end_row();
  });
  const MPI_Comm comm = PetscObjectComm(reinterpret_cast<PetscObject>(pattern));
  const Matrix P = ones.finish(comm, range.size());
  const Matrix I = identity.finish(comm, range.size());
  return add(add(P.get(), 1.0, transpose(P.get()).get()).get(), 1.0, I.get());
}

}  // namespace

FiniteDifferences::FiniteDifferences(Mat pattern, Function function)
    : function_(std::move(function)), jacobian_(symmetric(pattern)) {
  Mat matrix = jacobian_.get();
  MatColoring coloring = nullptr;
  ISColoring colours = nullptr;
  check(MatColoringCreate(matrix, &coloring));
  check(MatColoringSetType(coloring, MATCOLORINGGREEDY));
  check_options(MatColoringSetFromOptions(coloring));
  check(MatColoringApply(coloring, &colours));
  check(MatColoringDestroy(&coloring));
  check(MatFDColoringCreate(matrix, colours, &colours_));
  check(MatFDColoringSetFunction(
      colours_, reinterpret_cast<DifferencesCallback>(reinterpret_cast<void (*)()>(call)), this));
  // One colour at a time: PETSc 3.18 finds its block size per rank, dividing by the rows of ranks that have
  // none.
  PetscInt rows = 0;
  check(MatGetLocalSize(matrix, &rows, nullptr));
  check(MatFDColoringSetBlockSize(colours_, std::max<PetscInt>(rows, 1), 1));
  check_options(MatFDColoringSetFromOptions(colours_));
  check(MatFDColoringSetUp(matrix, colours, colours_));
  check(ISColoringDestroy(&colours));
}

FiniteDifferences::~FiniteDifferences() {
  static_cast<void>(MatFDColoringDestroy(&colours_));
}

Mat FiniteDifferences::evaluate(Vec u) {
  check(MatFDColoringApply(jacobian_.get(), colours_, u, this), parked_);
  return jacobian_.get();
}

PetscErrorCode FiniteDifferences::call(void*, Vec u, Vec values, void* self) {
  auto& differences = *static_cast<FiniteDifferences*>(self);
  return guarded(differences.parked_, [&] { differences.function_(u, values); });
}

}  // namespace sweepvi
