#pragma once

#include <vector>

#include "sweepvi/dvi.hpp"

namespace sweepvi {

/// The box VI of a step, linearised and scaled: with u = C v and positive diagonal R, C,
///
///     G(v) = R F(C v) = A v + q,      l <= v <= b,
///
/// whose matrix A = R F'(C v_0) C has entries of size at most 1, and nearly 1 in each row and column (D.
/// Ruiz, A scaling algorithm to equilibrate both rows and columns norms in matrices, RAL-TR-2001-034).
/// Positive factors leave the solutions as they are. Where F is affine, nothing is lost by the linearisation.
///
/// `regularisation` says how rows may be regularised: A + rho diag(s), s_i = +1 or -1, stays monotone where A
/// is so after scaling of its rows, by positive factors for rows of bounded unknowns, by any for the others,
/// which are equations G_i = 0 and may be written with either sign. s_i = 1 where v_i is bounded; else the
/// sign of the diagonal; else, with a zero diagonal, the sign for which A_ij A_ji s_i s_j < 0 holds with
/// those already known, as it must in a monotone matrix.
class ScaledVi {
public:
  /// @note Collective, as all methods are.
  explicit ScaledVi(Dvi& problem);
  ScaledVi(const ScaledVi&) = delete;
  ScaledVi& operator=(const ScaledVi&) = delete;

  /// Linearises at u, in the box [lower, upper].
  void linearise(Vec u, Vec lower, Vec upper);

  /// g = A v + q.
  void residual(Vec v, Vec g) const { check(MatMultAdd(matrix(), v, q(), g)); }
  void to_scaled(Vec u, Vec v) const { check(VecPointwiseDivide(v, u, column_.get())); }
  void from_scaled(Vec v, Vec u) const { check(VecPointwiseMult(u, v, column_.get())); }

  Mat matrix() const { return matrix_.get(); }  ///< A, all of its diagonal stored
  Vec q() const { return q_.get(); }
  Vec lower() const { return lower_.get(); }                           ///< PETSC_NINFINITY: none
  Vec upper() const { return upper_.get(); }                           ///< PETSC_INFINITY: none
  const std::vector<double>& regularisation() const { return sign_; }  ///< s, of this rank's rows

private:
  void equilibrate();
  void choose_signs();

  Dvi& problem_;
  Matrix matrix_;
  Vector q_, lower_, upper_, row_, column_, work_;
  std::vector<double> sign_;
};

}  // namespace sweepvi
