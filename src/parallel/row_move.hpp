#pragma once

#include <petscsf.h>

#include <type_traits>
#include <vector>

#include "petsc/sparse.hpp"
#include "sweepvi/linear_system.hpp"

namespace sweepvi {

using StarForest = Handle<PetscSF, PetscSFDestroy>;

/// Rows of one kind (states, constraints, outputs) change owners and order. Carries what is kept per row
/// along.
class RowMove {
public:
  /// @param old_count  rows this rank owns, before; they are numbered through the ranks
  /// @param rows       old numbers of the rows this rank owns, or just asks for, from now on
  /// @note Collective on `comm`, as are all members but `rows`.
  RowMove(MPI_Comm comm, PetscInt old_count, const std::vector<PetscInt>& rows);

  const IndexSet& rows() const { return rows_; }
  bool moves() const;  ///< some row changes its number or its owner

  /// What was kept per old row, per new row. T is trivially copyable.
  template <class T>
  std::vector<T> moved(const std::vector<T>& values) const {
    static_assert(std::is_trivially_copyable_v<T>);
    std::vector<T> result(count());
    bring(values.data(), result.data(), sizeof(T));
    return result;
  }
  Vector moved(Vec vector) const;

  /// The new number of each row this rank owned. Every row must have one new owner.
  std::vector<PetscInt> new_numbers() const;

private:
  std::size_t count() const;
  void bring(const void* old_values, void* new_values, std::size_t value_size) const;

  MPI_Comm comm_;
  PetscInt old_count_;
  IndexSet rows_;
  StarForest forest_;  // roots: old rows, leaves: new rows
};

/// The matrix whose rows and columns move.
/// @note Collective.
Matrix moved(Mat matrix, const RowMove& rows, const RowMove& columns);

/// The forcing whose rows move.
/// @note Collective on `comm`.
Forcing moved(MPI_Comm comm, const Forcing& forcing, const RowMove& rows);

}  // namespace sweepvi
