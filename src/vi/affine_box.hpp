#pragma once

#include <Eigen/Core>

namespace sweepvi {

/// An affine box VI with dense data: find u in [l, b] with
///
///     F_i >= 0 where u_i = l_i,   F_i <= 0 where u_i = b_i,   F_i = 0 between,      F = M u + q.
///
/// Absent bounds are infinite (HUGE_VAL or PETSC_INFINITY and beyond).
struct AffineBox {
  Eigen::MatrixXd M;
  Eigen::VectorXd q, lower, upper;
};

/// What came of it.
struct AffineBoxSolution {
  bool solved = false;
  bool ray = false;  ///< not solved: Lemke's method ended in a secondary ray
  Eigen::VectorXd u;
  int pivots = 0;
};

/// Solves it by Lemke's method (src/vi/lemke.hpp), block by block where a numbering makes M block triangular.
/// Unknowns without bounds are eliminated first, or, where their block is singular, written as differences.
/// The bases found are solved again, by factorizations and refinement.
///
/// Where all unknowns that are left have two bounds a solution is found whatever M is; with one-sided bounds
/// where M is copositive-plus and a solution exists (semidefinite matrices), or P. Otherwise the outcome may
/// be `solved == false`. Data that are not finite: not solved.
/// Source: for boxes M. Cao and M. C. Ferris, Math. Oper. Res. 21 (1996) 44-64.
AffineBoxSolution solve_affine_box(const AffineBox& box);

/// Tries harder, for very small problems of any matrix: Lemke's method from other starts (covering vectors),
/// then, if there are at most 2^14 ways to say which unknowns are at which bound, each of them; a singular
/// system among them as a linear least-squares problem in the box, which finds a solution if there is one.
AffineBoxSolution search_affine_box(const AffineBox& box);

}  // namespace sweepvi
