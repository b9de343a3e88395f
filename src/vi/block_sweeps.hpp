#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "petsc/affine_rows.hpp"
#include "sweepvi/dvi.hpp"

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
  /// @param block  of each of this rank's unknowns; those of a block side by side
  /// @param rows   must outlive this @note Collective, like all methods but `worthwhile`.
  BlockSweeps(MPI_Comm comm, const AffineRows& rows, const std::vector<PetscInt>& block,
              Degenerate degenerate);

  /// Blocks are small and sweeps contract. The same on every rank.
  bool worthwhile() const { return rate_ <= 0.2; }

  /// From the guess u to the solution of the box VI of K u - b.
  /// @return false if a block has no solution that was found. The same on every rank.
  bool solve(Vec u, Vec b, Vec lower, Vec upper);

  /// Takes from the last solution what F = K u - b there says it is off by, up to coupling.
  void refine(Vec u, Vec f);

private:
  using Mask = std::uint32_t;
  struct Pattern {
    Mask active;
    std::vector<double> inverse;  // row by row, columns of inactive rows; of active ones: what a bound does
  };
  struct Kind {  // of blocks with the same entries
    int size = 0;
    std::vector<double> matrix;
    std::vector<Pattern> patterns;
  };
  struct Block {
    PetscInt first;  // unknown
    std::int32_t kind;
    std::int32_t rows;  // first of its reading rows
  };
  struct ReadingRow {
    std::int32_t row;      // in its block
    std::int32_t entries;  // first of its entries
  };
  struct Entry {
    PetscInt column;
    double value;
  };

  bool solve_scalars(Vec u, Vec b, Vec lower, Vec upper);
  double scalar_sweep(const double* u, const double* b, const double* lower, const double* upper,
                      const double* others, double* next) const;
  void find_scalars();
  void forget_blocks();
  bool find_blocks(const AffineRows& rows, const std::vector<PetscInt>& block);
  double contraction();
  const double* inverse_of(Kind& kind, Mask active);
  bool first_sweep(double* u, const double* b, const double* lower, const double* upper,
                   const double* others);
  double next_sweep(double* u, const double* others);
  const double* solve_block(Kind& kind, const double* right, const double* lower, const double* upper,
                            double* u, Mask& active);
  std::pair<double, double> read(std::int32_t row, const double* u, const double* others) const;

  MPI_Comm comm_;
  const AffineRows& rows_;
  double slack_;                          // of degenerate rows, over their terms
  double rate_ = 0.0;                     // contraction of a sweep
  PetscInt count_ = 0;                    // unknowns
  bool scalars_ = false;                  // each unknown is a block, on all ranks: projected Jacobi
  std::vector<double> inverse_diagonal_;  // then
  std::vector<Kind> kinds_;
  std::vector<Block> blocks_;        // and one more behind the last
  std::vector<ReadingRow> reading_;  // likewise
  std::vector<Entry> entries_;
  std::vector<double> read_;             // by each reading row; where there are scalars: the next u
  std::vector<const double*> inverses_;  // of each block's set
  std::vector<Mask> active_;
};

}  // namespace sweepvi
