#include <algorithm>
#include <cmath>

#include "petsc/finite_differences.hpp"
#include "petsc/sparse.hpp"
#include "sweepvi/zd_system.hpp"

namespace sweepvi {

void ZdSystem::gains(double, Vec, std::vector<double>& m) const {
  std::fill(m.begin(), m.end(), 1.0);
}

bool ZdSystem::jacobian(double, Vec, Mat) const {
  return false;
}

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
  t_ = t;
  if (!differences_) {
    const auto rates = [this](Vec at, Vec result) { system_.rates(t_, at, result); };
    differences_ = std::make_unique<FiniteDifferences>(system_.pattern().get(), rates);
  }
  return differences_->evaluate(u);
}

double ZdJacobian::error(double t, Vec u) {
  std::vector<char> read(static_cast<std::size_t>(row_range(jacobian_.get()).size()), 1);
  for (const ZdSystem::Constraint& constraint : system_.constraints())
    for (std::size_t i = 0; i + 1 < constraint.levels.size(); ++i)
      read[static_cast<std::size_t>(constraint.levels[i])] = 0;
  Mat differences = finite_differences(t, u);
  const Matrix difference = add(differences, -1.0, evaluate(t, u));
  double worst = 0.0;
  const PetscInt first = row_range(difference.get()).first;
  for_each_row(difference.get(), [&](PetscInt row, auto, auto values) {
    if (read[static_cast<std::size_t>(row - first)] == 0) return;
    double scale = 1.0;
    for (const auto& [column, value] : get_row(differences, row))
      scale = std::max(scale, std::abs(value));
    for (const double value : values)
      worst = std::max(worst, std::abs(value) / scale);
  });
  MPI_Allreduce(MPI_IN_PLACE, &worst, 1, MPI_DOUBLE, MPI_MAX,
                PetscObjectComm(reinterpret_cast<PetscObject>(jacobian_.get())));
  return worst;
}

}  // namespace sweepvi
