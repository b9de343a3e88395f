#include "dvi/coordinate_condition.hpp"

#include <algorithm>
#include <utility>

#include "dvi/output_coordinates.hpp"
#include "petsc/sparse.hpp"

namespace sweepvi {

namespace {

/// s, from the start and two rates: positions, velocities, accelerations.
Vector sizes_of_states(const LinearSystem& system, double h) {
  constexpr int rates = 3;
  Vector sizes = duplicate(system.x0.get());
  check(VecCopy(system.x0.get(), sizes.get()));
  check(VecAbs(sizes.get()));
  const Matrix A = absolute_copy(system.A.get());
  Vector moved = duplicate(sizes.get());
  for (int k = 0; k < rates; ++k) {
    check(MatMult(A.get(), sizes.get(), moved.get()));
    check(VecScale(moved.get(), h));
    check(VecPointwiseMax(sizes.get(), sizes.get(), moved.get()));
  }
  return sizes;
}

}  // namespace

double coordinate_condition(const LinearSystem& system, const RelativeDegree& relative_degree, double h) {
  if (relative_degree.outputs_are_states) return 1.0;
  const OutputCoordinates coordinates(system, relative_degree);
  const Vector sizes = sizes_of_states(system, h);
  Vector spread = duplicate(sizes.get());
  Vector next = duplicate(sizes.get());
  check(VecCopy(sizes.get(), spread.get()));
  const auto apply = [&](Mat matrix) {
    check(MatMult(absolute_copy(matrix).get(), spread.get(), next.get()));
    std::swap(spread, next);
  };
  apply(coordinates.to_u_matrix().get());
  if (const Matrix jumps = coordinates.jumps()) {
    apply(coordinates.inverse_jumps(jumps.get()).get());
    apply(jumps.get());
  }
  apply(coordinates.to_x_matrix().get());
  double worst = 1.0;
  {
    const ReadArray of(sizes.get());
    const ReadArray to(spread.get());
    for (PetscInt i = 0; i < of.size(); ++i)
      if (of[i] > 0.0) worst = std::max(worst, to[i] / of[i]);
  }
  MPI_Allreduce(MPI_IN_PLACE, &worst, 1, MPI_DOUBLE, MPI_MAX, system.comm());
  return worst;
}

}  // namespace sweepvi
