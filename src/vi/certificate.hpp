#pragma once

#include "sweepvi/dvi.hpp"
#include "sweepvi/step_solver.hpp"
#include "vi/natural_residual.hpp"

namespace sweepvi {

/// Certifies points of a step's VI, row by row:
///
///     |natural residual|_i  <=  rtol * (sum of the absolute values of the terms of row i)    for all i.
///
/// Where a row passes only because u_i is close to its bound, close is a matter of units: then the distance d
/// counts as what it changes in the rows that read u_i, d * sum_j |dF_j/du_i| / terms_j, if that is more. So
/// an impulse of 1e-13 is not zero where a mass of 1e-13 gets it.
///
/// A row without bounds whose unknowns all vanish in exact arithmetic consists of residue; only there, where
/// it fails otherwise, a tenth of the terms of the unknowns it reads counts as its own.
///
/// A natural residual below the range of numbers (negligible_residual, 5e-314) is none.
///
/// What passes is judged against the data of the step, too: data_test.hpp.
///
/// What is not finite - u, F or terms - certifies nothing: an overflown sum of terms would excuse any
/// residual.
class Certificate {
public:
  Certificate(Dvi& problem, const CertificateOptions& options);

  /// Worst ratio of the rows at u; infinity where numbers are not finite. `f` becomes F(u). @note Collective.
  double worst_ratio(Vec u, Vec lower, Vec upper, Vec f);
  /// The same of what u settles to, which it becomes.
  double settled_ratio(Vec u, Vec lower, Vec upper, Vec f);

  /// The terms of the rows of the point judged last.
  Vec terms() const { return terms_.get(); }
  /// Whether all of u was in its intervals when it was last judged, on all ranks.
  bool inside() const { return inside_; }

private:
  double judge(Vec u, Vec lower, Vec upper, Vec f, const RowRatios& rows);
  double ratio(Vec u, Vec lower, Vec upper, Vec f, const RowRatios& rows);
  double weighted_ratio(Vec u, Vec lower, Vec upper, Vec f);
  void weigh(Vec u);
  bool spread_once();
  void add_spread(Vec lower, Vec upper);

  Dvi& problem_;
  const CertificateOptions& options_;
  Vector terms_, spread_, own_;
  Vector inverse_, weights_;  // of terms; of distances. From the first point that needs them
  Matrix jacobian_;           // likewise
  bool inside_ = false;
};

}  // namespace sweepvi
