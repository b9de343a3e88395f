#pragma once

#include <cstddef>
#include <cstdint>

namespace sweepvi {

/// K by small blocks of unknowns (BlockRows), as the kernels read it.
struct BlockModel {
  /// A row of a block, and what it reads of others of its block: entries up to `end`, from where those of the
  /// row before end.
  struct Row {
    std::int32_t row, end;
    double diagonal, inverse;  // 1 / diagonal
  };
  struct Entry {
    std::int32_t column;  // in the block
    double value;
  };
  /// Blocks whose own rows are equal, and in which the same rows read others.
  struct Kind {
    std::int32_t size;                  // unknowns
    std::int32_t rows, entries;         // where they begin; rows in an order in which they read each other
    std::int32_t readers, readers_end;  // rows that read others
  };
  /// What a block reads of others, reader by reader: those of the j-th end at ends[j].
  struct FarEntry {
    std::ptrdiff_t offset;  // column less the first unknown of the block
    double value;
  };
  struct Reading {
    std::int32_t entries, ends;  // where they begin
  };
  /// Blocks of one kind that stand side by side.
  struct Run {
    std::ptrdiff_t first, block;  // unknown, block
    std::ptrdiff_t pack;          // of blocks that are computed side by side
    std::int32_t count;           // blocks
    std::int32_t kind;
    std::int32_t reading;  // of all of them, which then reads no ghosts; below 0: each its own
  };

  const Kind* kinds;
  const Row* rows;
  const Entry* entries;
  const std::int32_t* readers;  // rows in the block
  const std::int32_t* reading;  // of each block
  const Reading* readings;
  const std::int32_t* ends;
  const FarEntry* far;
  std::ptrdiff_t count;  // unknowns; columns from here on are ghosts
};

/// A sweep of projected Gauss-Seidel over the blocks of a run.
struct BlockSweep {
  double* u = nullptr;
  const double *others = nullptr, *b = nullptr, *lower = nullptr, *upper = nullptr;
  int rounds = 1;                  // over the rows of a block
  unsigned char* moves = nullptr;  // by pack: whether it is to be swept; then, whether something of it moved
  double near = 0.0;               // that close to a bound, over the terms of its row: at it
  double still = 0.0;              // by more than that, over the terms of its row
  unsigned char moved = 0;         // any. Null: all are swept, and nobody watches
};

/// F = K u - b and its terms, and what rows make of u.
struct BlockJudge {
  const double *u = nullptr, *others = nullptr, *lower = nullptr, *upper = nullptr, *b = nullptr,
               *b_terms = nullptr;
  double *f = nullptr, *terms = nullptr;
  double worst = 0.0;       // RowRatios
  double not_finite = 0.0;  // or NaN
  bool by_distance = false, outside = false;
};

struct BlockKernels {
  static constexpr int largest = 16;  ///< unknowns of a block
  static constexpr int together = 8;  ///< blocks of a pack; those left over in a run are packs of their own
  void (*sweep)(const BlockModel&, const BlockModel::Run&, BlockSweep&);
  void (*judge)(const BlockModel&, const BlockModel::Run&, BlockJudge&);
};

/// Those for the processor we are on. Their results are the same to the bit.
const BlockKernels& block_kernels();

namespace detail {
extern const BlockKernels plain_block_kernels;
extern const BlockKernels avx2_block_kernels;  ///< only where SWEEPVI_AVX2 is defined
}  // namespace detail

}  // namespace sweepvi
