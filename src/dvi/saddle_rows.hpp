#pragma once

#include <vector>

#include "petsc/affine_rows.hpp"

namespace sweepvi {

/// This rank's rows of a matrix K = [J -E; G H] on unknowns (x, nu), for what a primal-dual step asks of it:
/// values and terms in one pass, in which the multipliers of a row count together or one by one. All methods
/// that take vectors (in the layout of the unknowns) are collective.
class SaddleRows {
public:
  SaddleRows() = default;
  /// @param states  this rank's; its multipliers follow them @note Collective.
  SaddleRows(Mat K, PetscInt states);

  const AffineRows& rows() const { return rows_; }

  /// f = K u - b. known = |K| |x| + b_terms, and of the multipliers: in rows of x, |E nu|; in the others,
  /// |H| |nu|. pushed = |E| |nu| - |E nu|, 0 in rows of multipliers.
  void evaluate(Vec u, Vec b, Vec b_terms, Vec f, Vec known, Vec pushed) const;
  /// f = K u - b in rows of multipliers; the others are left alone.
  void outputs(Vec u, Vec b, Vec f) const;

  enum class Part { states, multipliers, all };
  /// result_i = sum over states j of min(|K_ij|, most) terms_j, in the rows asked for.
  void read_states(Vec terms, double most, Part part, Vec result) const;
  /// x += K nu with the multipliers of `nu`.
  void add_pushes(Vec nu, Vec x) const;

private:
  struct Range {
    PetscInt first, last;
  };
  Range range(Part part) const;
  template <class Visit>
  void visit(Vec u, Visit&& visit) const;

  AffineRows rows_;
  PetscInt states_ = 0, count_ = 0;
  // Rows with entries of states first: [starts[i], middle[i]) of states, [middle[i], starts[i+1]) of
  // multipliers.
  std::vector<PetscInt> starts_{0}, middle_, columns_;
  std::vector<double> values_;
};

}  // namespace sweepvi
