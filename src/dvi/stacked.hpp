#pragma once

#include <algorithm>
#include <cstddef>

#include "sweepvi/petsc.hpp"

namespace sweepvi {

/// Where the unknowns (x, nu) of a primal-dual form stand: each rank's are its states, then its multipliers.
/// Numbers of states and multipliers are global ones of their own; `like_x` and `like_nu` must outlive this.
class Stacked {
public:
  Stacked(Mat like_x, Vec like_nu) {
    check(MatGetOwnershipRanges(like_x, &x_));
    check(VecGetOwnershipRanges(like_nu, &nu_));
    int size = 0;
    MPI_Comm_size(PetscObjectComm(reinterpret_cast<PetscObject>(like_x)), &size);
    ranks_ = static_cast<std::size_t>(size);
  }
  PetscInt x(PetscInt j) const { return j + nu_[owner(x_, j)]; }
  PetscInt nu(PetscInt j) const { return j + x_[owner(nu_, j) + 1]; }

private:
  std::size_t owner(const PetscInt* ranges, PetscInt j) const {
    return static_cast<std::size_t>(std::upper_bound(ranges, ranges + ranks_ + 1, j) - ranges) - 1;
  }
  const PetscInt* x_ = nullptr;
  const PetscInt* nu_ = nullptr;
  std::size_t ranks_ = 0;
};

}  // namespace sweepvi
