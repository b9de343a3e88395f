#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "sweepvi/dvi.hpp"
#include "sweepvi/step_solver.hpp"
#include "vi/refinement.hpp"

namespace sweepvi {

/// The second half of the certificate. The first (certificate.hpp) compares residuals with the terms of their
/// rows, which far out along a null direction of dF/du are larger than any residual: there every problem
/// seems solved, those without a solution, too. This half compares with the data:
///
///     |natural residual of u + c|_i  <=  rtol D_i    for all i,
///
/// D_i as RowData has it: what F_i consists of at the point of the box next to 0 (|q_i|, the terms that the
/// process knew at t_k, finite bounds), and what that explains of the terms of the row. Residuals count with
/// what their evaluation may round, 8 eps T_i. c = 0 first; where that does not do - in stiff rows, whose
/// terms honestly cancel, rounding of u alone leaves more - c is what Refinement finds: no more than rounding
/// in u, unless u was far off.
///
/// Where it judges an affine step, u + c solves a problem whose q differs by rtol D: so a problem that d >= 0
/// with dF'd <= 0 and q'd < -rtol D'd proves unsolvable does not pass. It does not tell whether there are
/// other solutions; of a nonlinear step it only asks whether one Newton step stays near, and nothing where
/// the derivative is singular there.
///
/// Two kinds of steps need no second look, and get none: one whose K is strictly diagonally dominant (it has
/// a solution whatever its data are, and u is bounded by them), and one of a run in which rows have terms of
/// the size that they had in the steps before, which then count as data: what was known at t_k; rows that
/// have grown (a first contact) are judged by what the unknowns of others explain of them.
class DataTest {
public:
  DataTest(Dvi& problem, const CertificateOptions& options);

  enum class Verdict {
    holds,    ///< for u, or for u + c where c is rounding
    refined,  ///< for u + c, rounded, which u has become
    fails     ///< u runs away, as far as can be seen
  };
  /// @param u  a point of the step that is certified row by row, with `ratio`  @param f  F(u)
  /// @param terms  of its rows
  /// @note Collective.
  Verdict judge(Vec u, Vec f, Vec terms, double ratio, Vec lower, Vec upper);

  /// See StepSolver::refine. @note Collective.
  std::optional<ErrorEstimate> refine(Vec u, Vec f, Vec lower, Vec upper);

private:
  bool dominant();
  bool as_before(Vec u, Vec f, Vec terms, double ratio, Vec lower, Vec upper);
  bool explained_by_others(Vec u, Vec f, Vec terms, Vec lower, Vec upper) const;
  Verdict look_again(Vec u, Vec f, Vec terms, Vec lower, Vec upper);
  bool doubtful(Vec u, Vec f, Vec terms, Vec data, Vec lower, Vec upper);
  void find_data(Vec lower, Vec upper);
  Refinement& refinement();

  Dvi& problem_;
  const CertificateOptions& options_;
  Vector data_, origin_;
  Vector before_;                           // terms of rows in the steps before; 0: none yet
  std::vector<PetscInt> grown_;             // rows whose terms are not of that size any more
  std::unique_ptr<Refinement> refinement_;  // from the first point in doubt
  const AffineRows* looked_at_ = nullptr;
  std::uint64_t version_ = 0;  // of the Jacobian that dominant_ is for
  bool dominant_ = false;
};

}  // namespace sweepvi
