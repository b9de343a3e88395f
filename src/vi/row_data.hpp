#pragma once

#include <vector>

#include "petsc/affine_rows.hpp"

namespace sweepvi {

/// A vector with the entries of other ranks that rows of K read.
class WithGhosts {
public:
  /// @note Collective.
  WithGhosts(const AffineRows& rows, Vec vector) : count_(rows.size()), own_(vector) {
    const double* ghosts = rows.ghosts(vector);
    if (ghosts != nullptr) others_.assign(ghosts, ghosts + rows.ghost_count());
  }
  /// Of a column as AffineRows counts them.
  double operator[](PetscInt column) const {
    return column < count_ ? own_[column] : others_[static_cast<std::size_t>(column - count_)];
  }

private:
  PetscInt count_;
  ReadArray own_;
  std::vector<double> others_;
};

/// Which part of the terms of a row comes from data, directly or through the unknowns that the row reads. Row
/// i of F(u) = K u + q has the terms T_i = d_i + sum_j |K_ij u_j|, d_i the size of its own data (|q_i|, with
/// what the process knew at t_k). With phi_j the part of u_j that data explain,
///
///     phi_i = (d_i + 0.98 sum_{j != i} |K_ij u_j| phi_j) / (d_i + sum_{j != i} |K_ij u_j|),
///     phi_j = 1 where u_j is within a finite bound,
///     D_i   = d_i + 1e-3 (phi_i T_i - d_i),
///
/// from phi = 0 upwards, by a few Gauss-Seidel sweeps, from rows with large terms to those with small ones
/// first: phi_i is the probability that a walk along what rows read ends in data. In a stiff or growing
/// system that data drive, D is 1e-3 of T or more, in fronts that move into parts at rest, too. Along a null
/// direction of K, in which u can be of any size, D stays of the size of the data.
///
/// An unknown that vanishes in exact arithmetic counts as 1e-3 of what its own row consists of, divided by
/// the sum of its entries.
class RowData {
public:
  /// @note Collective, as `evaluate`.
  explicit RowData(Mat K) : rows_(K) {}
  /// Of what comes through unknowns counts as data: theirs is rounding.
  static constexpr double indirect = 1e-3;

  const AffineRows& rows() const { return rows_; }

  /// @param own  d
  /// @param data  becomes D @param terms  becomes T
  void evaluate(Vec u, Vec lower, Vec upper, Vec own, Vec data, Vec terms) const {
    evaluate(rows_, u, lower, upper, own, data, terms);
  }
  static void evaluate(const AffineRows& rows, Vec u, Vec lower, Vec upper, Vec own, Vec data, Vec terms);

private:
  AffineRows rows_;
};

}  // namespace sweepvi
