#pragma once

#include <vector>

#include "petsc/sparse.hpp"

namespace sweepvi {

/// Parts of a square matrix that have nothing to do with each other: connected components of the graph of its
/// pattern.
class Components {
public:
  /// @note Collective.
  explicit Components(Mat matrix);

  /// Components with a row on this rank, numbered from 0.
  std::size_t count() const { return count_; }
  /// The component of a local row.
  std::size_t of(PetscInt row) const { return of_row_[static_cast<std::size_t>(row)]; }
  /// Adds up what each rank has of each component; entry `count()` is added up over all ranks.
  /// @note Collective.
  void sum(std::vector<double>& values) const;

private:
  struct Shared {
    std::size_t component, slot;
  };
  MPI_Comm comm_;
  std::size_t count_ = 0;
  std::vector<std::size_t> of_row_;
  std::vector<Shared> shared_;         // components of this rank that other ranks know, too
  mutable std::vector<double> slots_;  // of all shared components, and one more
};

}  // namespace sweepvi
