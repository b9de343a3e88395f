#include <algorithm>
#include <cmath>

#include "petsc/sparse.hpp"
#include "sweepvi/zd_system.hpp"

namespace sweepvi {

void ZdSystem::gains(double, Vec, std::vector<double>& m) const {
  std::fill(m.begin(), m.end(), 1.0);
}

bool ZdSystem::jacobian(double, Vec, Mat) const {
  return false;
}

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

// Finite differences: one evaluation of the rates for each colour of the pattern.
struct ZdJacobian::Colouring {
  const ZdSystem& system;
  MatFDColoring differences = nullptr;
  double t = 0.0;
  std::exception_ptr parked;

  Colouring(const ZdSystem& zd, Mat pattern) : system(zd) {
    MatColoring coloring = nullptr;
    ISColoring colours = nullptr;
    check(MatColoringCreate(pattern, &coloring));
    check(MatColoringSetType(coloring, MATCOLORINGGREEDY));
    check_options(MatColoringSetFromOptions(coloring));
    check(MatColoringApply(coloring, &colours));
    check(MatColoringDestroy(&coloring));
    check(MatFDColoringCreate(pattern, colours, &differences));
    check(MatFDColoringSetFunction(
        differences, reinterpret_cast<DifferencesCallback>(reinterpret_cast<void (*)()>(function)), this));
    // One colour at a time: PETSc 3.18 finds its block size per rank, dividing by the rows of ranks that have
    // none.
    PetscInt rows = 0;
    check(MatGetLocalSize(pattern, &rows, nullptr));
    check(MatFDColoringSetBlockSize(differences, std::max<PetscInt>(rows, 1), 1));
    check_options(MatFDColoringSetFromOptions(differences));
    check(MatFDColoringSetUp(pattern, colours, differences));
    check(ISColoringDestroy(&colours));
  }
  ~Colouring() { static_cast<void>(MatFDColoringDestroy(&differences)); }
  Colouring(const Colouring&) = delete;
  Colouring& operator=(const Colouring&) = delete;

  static PetscErrorCode function(void*, Vec u, Vec rates, void* context) {
    auto& self = *static_cast<Colouring*>(context);
    return guarded(self.parked, [&] { self.system.rates(self.t, u, rates); });
  }
};

ZdJacobian::ZdJacobian(const ZdSystem& system) : system_(system), jacobian_(system.pattern()) {}

ZdJacobian::~ZdJacobian() = default;

Mat ZdJacobian::evaluate(double t, Vec u) {
  check(MatZeroEntries(jacobian_.get()));
  if (!system_.jacobian(t, u, jacobian_.get())) return finite_differences(t, u);
  check(MatAssemblyBegin(jacobian_.get(), MAT_FINAL_ASSEMBLY));
  check(MatAssemblyEnd(jacobian_.get(), MAT_FINAL_ASSEMBLY));
  return jacobian_.get();
}

Mat ZdJacobian::finite_differences(double t, Vec u) {
  if (!colouring_) {
    differences_ = symmetric(system_.pattern().get());
    colouring_ = std::make_unique<Colouring>(system_, differences_.get());
  }
  colouring_->t = t;
  check(MatFDColoringApply(differences_.get(), colouring_->differences, u, colouring_.get()),
        colouring_->parked);
  return differences_.get();
}

double ZdJacobian::error(double t, Vec u) {
  std::vector<char> read(static_cast<std::size_t>(row_range(jacobian_.get()).size()), 1);
  for (const ZdSystem::Constraint& constraint : system_.constraints())
    for (std::size_t i = 0; i + 1 < constraint.levels.size(); ++i)
      read[static_cast<std::size_t>(constraint.levels[i])] = 0;
  const Matrix difference = add(finite_differences(t, u), -1.0, evaluate(t, u));
  double worst = 0.0;
  const PetscInt first = row_range(difference.get()).first;
  for_each_row(difference.get(), [&](PetscInt row, auto, auto values) {
    if (read[static_cast<std::size_t>(row - first)] == 0) return;
    double scale = 1.0;
    for (const auto& [column, value] : get_row(differences_.get(), row))
      scale = std::max(scale, std::abs(value));
    for (const double value : values)
      worst = std::max(worst, std::abs(value) / scale);
  });
  MPI_Allreduce(MPI_IN_PLACE, &worst, 1, MPI_DOUBLE, MPI_MAX,
                PetscObjectComm(reinterpret_cast<PetscObject>(jacobian_.get())));
  return worst;
}

}  // namespace sweepvi
