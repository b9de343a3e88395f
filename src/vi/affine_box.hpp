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
  Eigen::VectorXd u;
  int pivots = 0;
};

/// Solves it by Lemke's method: unknowns without bounds are eliminated first, then the smallest artificial
/// variable z_0 >= 0 that makes the starting point a solution is driven to zero, one complementary pivot at a
/// time; lexicographic ratios, so that degenerate problems cannot cycle. Costs O(n^2) per pivot, usually O(n)
/// pivots.
///
/// Where all unknowns that are left have two bounds a solution is found whatever M is; with one-sided bounds
/// where M is copositive-plus and a solution exists (semidefinite matrices), or P. Otherwise, and where the
/// block of the unknowns without bounds is singular, the outcome may be `solved == false`.
/// Sources: C. E. Lemke, Management Science 11 (1965) 681-689; for boxes M. Cao and M. C. Ferris, Math. Oper.
/// Res. 21 (1996) 44-64; the lexicographic rule in R. W. Cottle, J.-S. Pang, R. E. Stone, The Linear
/// Complementarity Problem, 1992, section 4.9.
AffineBoxSolution solve_affine_box(const AffineBox& problem);

}  // namespace sweepvi
