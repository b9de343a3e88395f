#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "sweepvi/dvi.hpp"
#include "vi/row_data.hpp"
#include "vi/twofold.hpp"

namespace sweepvi {

/// Solves the affine box VI of a step to more digits than double precision has, from a point that is
/// certified row by row: u = hi + lo, residuals K u + q in twofold arithmetic, corrections
///
///     J c = -(K u + q)     J: K with identity rows where u is at a bound
///
/// by a factorization in double precision; sets of unknowns at bounds change by the signs of residuals that
/// rounding no longer hides. Corrections contract, or it is given up: where u runs away its terms grow, and
/// relative to those any residual shrinks. It is solved where each row's natural residual, with what twofold
/// arithmetic rounds in it, 1e-31 T, is at most rtol D (RowData). Rows without such data of their own - far
/// from those that drive them - are as near 0 as that arithmetic tells, rho = 1e-29 T, if that is nothing to
/// what data d make of u:
///
///     |K| |J^-1 (s rho)|  <=  rtol |K| |J^-1 (s d)|    s: random signs; in each row that d reaches,
///
/// in rows at bounds |K J^-1 (s d) - s d| instead, and with rho. Along a null direction of J, J^-1 is almost
/// z y' / sigma, y'K = 0 = K z, and the test says |y|'rho <= rtol |y|'d: it is in nobody's units, and holds
/// for no y that proves the rows unsolvable by more than rtol |y|'d.
///
/// A singular J (repeated rows that agree, say) gets a small multiple of each row's entries on its diagonal;
/// the residual still contracts where a solution exists. Where there is none, no u makes it small: for every
/// d >= 0 with K'd <= 0, d'(K u + q) <= q'd < 0.
/// Source: iterative refinement, N. J. Higham, Accuracy and Stability of Numerical Algorithms (2002), ch. 12.
class Refinement {
public:
  explicit Refinement(Dvi& problem);
  Refinement(const Refinement&) = delete;
  Refinement& operator=(const Refinement&) = delete;

  /// Of the step that the problem has begun; K is that at u, and D that of u. @note Collective, as all
  /// methods.
  /// @param data  size of the data of each row, d
  void take(Vec u, Vec lower, Vec upper, Vec data);
  /// Whether |natural residual| <= rtol D in all rows at u, with f = F(u).
  bool explained(Vec f, double rtol);
  /// Whether a solution is near. Where it differs from u by more than rtol of the terms of some row, u
  /// becomes it, up to rounding, and is inside its bounds. Of a nonlinear step, whether one Newton step stays
  /// there, or its derivative is singular and tells nothing.
  bool solve(Vec u, double rtol);
  /// Whether u has changed.
  bool moved() const { return moved_; }
  /// Makes it u anyway.
  void move(Vec u) const;

  /// F of the solution that `solve` has found, rounded once.
  Vec residual() const { return f_.get(); }
  /// How far an unknown may be off: what `solve` has corrected, and what a change of each term of each row by
  /// eps makes of it, in random directions. Nothing where the rows of its active set do not determine it.
  std::optional<Vector> error();

private:
  enum Place : signed char { at_lower = -1, between = 0, at_upper = 1 };
  struct Excess {
    double data = 0.0, terms = 0.0;  // worst residual over what is allowed by the one or the other
    bool changed = false;            // some unknown has come to a bound or left it
  };
  bool take_affine(Vec u);
  bool iterate(double rtol, double shift);
  bool driven_by_data(double rtol);
  bool respond(Vec size, int probe, Vec most_so_far);
  bool nonlinear_near(Vec u);
  void start(Vec u);
  Excess evaluate(double rtol);
  void weigh(double rtol);
  void place(bool first);
  bool factor(double shift);
  bool correct();
  double size_of_step(bool all = false) const;
  double most(double value) const;

  Dvi& problem_;
  MPI_Comm comm_;
  Matrix K_, abs_K_, J_;
  std::optional<RowData> rows_;
  std::uint64_t version_ = 0;
  LinearSolver solver_;
  Vec lower_ = nullptr, upper_ = nullptr;
  Vector from_, own_, q_, data_, terms_, hi_, lo_, f_, allowed_, weights_, right_, step_;
  std::vector<Place> place_;
  bool affine_ = false, factored_ = false, determined_ = false, moved_ = false;
};

}  // namespace sweepvi
