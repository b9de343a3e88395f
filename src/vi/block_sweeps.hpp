#pragma once

#include <cstdint>
#include <vector>

#include "sweepvi/dvi.hpp"
#include "vi/block_rows.hpp"
#include "vi/small_box.hpp"

namespace sweepvi {

/// Solves an affine step whose unknowns fall into small blocks that read each other weakly: the elements of a
/// chain, coupled through h times a spring in a few rows. Each block is a box VI of its own, solved exactly
/// by its active set with the inverse of that set's matrix; equal blocks share those inverses. Sweeps over
/// the blocks then contract like the coupling (h^3 for a jerk chain), and from the second on only the change
/// of what a block reads is carried through: Gauss-Seidel on a rank, Jacobi between ranks.
///
/// What it finds depends on the step and its first guess alone, not on earlier steps. The certificate decides
/// whether it is right; an active set may change after the first sweep, or coupling be too strong.
class BlockSweeps {
public:
  /// @param rows  must outlive this @note Collective, like all methods but `worthwhile`.
  BlockSweeps(MPI_Comm comm, const BlockRows& rows, Degenerate degenerate);

  /// Blocks are small and sweeps contract. The same on every rank.
  bool worthwhile() const { return rate_ <= 0.2; }

  /// From a guess to the solution u of the box VI of K u - b. @param guess  may be u
  /// @return false if a block has no solution that was found. The same on every rank.
  bool solve(Vec guess, Vec u, Vec b, Vec lower, Vec upper);

  /// Takes from the last solution what F = K u - b there says it is off by, up to coupling.
  void refine(Vec u, Vec f);

private:
  struct Block {
    std::size_t number;
    const BlockRows::Kind* kind;
  };

  void forget_blocks();
  void make_boxes();
  double contraction();
  bool first_sweep(const double* guess, double* u, const double* b, const double* lower, const double* upper,
                   const double* others);
  double next_sweep(double* u, const double* b, const double* others);
  double sweep_and_check(double* u, const double* b, const double* lower, const double* upper,
                         const double* others);
  template <class After>
  double carry_on(double* u, const double* b, const double* others, After&& after);
  bool set_holds(const SmallBox& box, std::size_t block, const double* right, const double* lower,
                 const double* upper, const double* u) const;
  void find_right(const Block& block, const SmallBox& box, const double* b, const double* read,
                  double* right) const;
  template <class Visit>
  void each_block(Visit&& visit);
  template <class Visit>
  void each_reading_row(const Block& block, Visit&& visit) const;

  MPI_Comm comm_;
  const AffineRows& rows_;
  const BlockRows& blocks_;
  double slack_;                         // of degenerate rows, over their terms
  double rate_ = 0.0;                    // contraction of a sweep
  PetscInt count_ = 0;                   // unknowns
  std::vector<SmallBox> boxes_;          // of each kind of blocks
  std::vector<double> read_;             // by each reading row of each block
  std::vector<const double*> inverses_;  // of each block's set
  std::vector<SmallBox::Mask> active_, bounded_;
};

}  // namespace sweepvi
