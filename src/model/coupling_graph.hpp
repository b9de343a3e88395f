#pragma once

#include "model/chain_spec.hpp"
#include "petsc/sparse.hpp"

namespace sweepvi {

/// Who is coupled with whom in a chain: S(w)_i = sum_j k_ij (w_j - w_i) - ends_i w_i.
class CouplingGraph {
public:
  /// @param elements  this rank's, contiguous
  /// @note Collective on `comm`. `spec` must outlive the graph.
  CouplingGraph(MPI_Comm comm, const ChainSpec& spec, LocalRange elements);

  struct Row {
    SparseRow neighbours;  ///< (j, k_ij), k_ij != 0
    double ends = 0.0;     ///< coupling to neighbours that are missing, as if they rested at w = 0
  };
  /// Of an element this rank owns.
  Row row(PetscInt i) const;

private:
  void add(Row& row, PetscInt neighbour, bool exists) const;

  const ChainSpec& spec_;
  Matrix weights_;  // empty: neighbours follow from the topology
};

}  // namespace sweepvi
