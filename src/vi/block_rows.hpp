#pragma once

#include <vector>

#include "petsc/affine_rows.hpp"
#include "sweepvi/dvi.hpp"
#include "vi/block_kernels.hpp"

namespace sweepvi {

/// Rows of K by small blocks of unknowns, as the elements of a chain are: what a block reads of itself, which
/// blocks of one kind share, and what of others. Blocks of one kind that stand side by side are computed side
/// by side.
class BlockRows {
public:
  using Run = BlockModel::Run;
  using Kind = BlockModel::Kind;

  BlockRows() = default;
  /// @param rows   must outlive this
  /// @param block  of each of this rank's unknowns; those of a block side by side
  BlockRows(const AffineRows& rows, const std::vector<PetscInt>& block);

  /// There are blocks, all of them small; else there is but `judge`. May differ between ranks.
  bool small() const { return small_; }
  const AffineRows& rows() const { return *affine_; }
  const std::vector<Run>& runs() const { return runs_; }
  const std::vector<Kind>& kinds() const { return kinds_; }
  BlockModel model() const;
  /// Of each kind, row by row.
  const std::vector<std::vector<double>>& matrices() const { return matrices_; }
  const std::vector<BlockModel::Entry>& entries() const { return entries_; }
  const std::vector<BlockModel::FarEntry>& far() const { return far_; }
  std::size_t packs() const { return static_cast<std::size_t>(packs_); }
  /// Smallest K_ii. HUGE_VAL: there are no rows.
  double smallest_diagonal() const;

  /// f = K u - b and terms = |K| |u| + b_terms, and what the rows make of u in [lower, upper].
  /// @note Collective.
  RowRatios judge(Vec u, Vec lower, Vec upper, Vec b, Vec b_terms, Vec f, Vec terms) const;

private:
  void add_kind(int size, const std::vector<double>& own, const std::vector<std::int32_t>& readers);
  void find_runs(const std::vector<std::int32_t>& kind_of, const std::vector<char>& reads_ghosts);

  const AffineRows* affine_ = nullptr;
  bool small_ = false;
  std::vector<Kind> kinds_;
  std::vector<std::vector<double>> matrices_;  // row by row, of each kind
  std::vector<BlockModel::Row> rows_;
  std::vector<BlockModel::Entry> entries_;
  std::vector<std::int32_t> readers_;
  std::vector<std::int32_t> reading_;
  std::vector<BlockModel::Reading> readings_;
  std::vector<std::int32_t> ends_;
  std::vector<BlockModel::FarEntry> far_;
  std::vector<Run> runs_;
  PetscInt count_ = 0;  // unknowns
  std::ptrdiff_t packs_ = 0;
};

}  // namespace sweepvi
