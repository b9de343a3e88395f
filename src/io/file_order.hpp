#pragma once

#include <vector>

#include "petsc/sparse.hpp"

namespace sweepvi {

/// Brings values that ranks own in the solver's order into the file's order, where each rank holds a
/// contiguous slice.
class FileOrder {
public:
  /// @param file_index  position in the file of each value this rank owns; over all ranks a permutation of
  /// the kept ones
  ///                    (-1: not recorded)
  /// @param total       recorded values in all
  /// @note Collective on `comm`.
  FileOrder(MPI_Comm comm, const std::vector<PetscInt>& file_index, PetscInt total);

  PetscInt first() const { return first_; }  ///< this rank's slice of the file order
  PetscInt count() const { return count_; }
  /// Values of `width` numbers each. @note Collective.
  void bring(const double* mine, double* slice, std::size_t width = 1);

private:
  PetscInt first_ = 0, count_ = 0;
  std::vector<std::size_t> kept_;  // of this rank's values
  Vector mine_, slice_;
  Scatter scatter_;
};

}  // namespace sweepvi
