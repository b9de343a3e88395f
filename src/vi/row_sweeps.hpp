#pragma once

#include <vector>

#include "vi/block_rows.hpp"

namespace sweepvi {

/// Solves an affine step whose rows are governed by their diagonals, as those of short steps are (I - h A):
/// projected Gauss-Seidel,
///
///     u_i <- mid(l_i, u_i - F_i / K_ii, b_i),
///
/// one row of a block after the other, in the order in which they read each other, blocks side by side. Rows
/// end where their own rounding is, whatever the sizes of others. Between ranks it is Jacobi.
///
/// What it finds depends on the step and its first guess alone, not on earlier steps. The certificate decides
/// whether it is right.
class RowSweeps {
public:
  /// @param rows  must outlive this @note Collective, like all methods but `worthwhile`.
  RowSweeps(MPI_Comm comm, const BlockRows& rows, Degenerate degenerate);

  /// Blocks are small, diagonals positive, and sweeps contract well. The same on every rank.
  bool worthwhile() const { return sweeps_ > 0; }

  /// From a guess u to the solution u of the box VI of K u - b.
  void solve(Vec u, Vec b, Vec lower, Vec upper);

private:
  struct Trial {
    int sweeps = 0;  // none: it was not solved
    double last_move = 0.0;
  };
  void sweep_all(const BlockModel& model, int rounds, Vec u, Vec b, Vec lower, Vec upper);
  double contraction();
  Trial try_out(int rounds);

  MPI_Comm comm_;
  const BlockRows& rows_;
  double near_;                       // a bound, over the terms of the row: at it
  int sweeps_ = 0;                    // that an ordinary step takes
  int rounds_ = 1;                    // over the rows of a block, in each sweep
  double still_ = 0.0;                // who moves by less in a sweep, over the terms of the row, is there
  std::vector<unsigned char> moves_;  // by pack
};

}  // namespace sweepvi
