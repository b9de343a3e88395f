#pragma once

#include <petscsys.h>

#include <Eigen/Core>
#include <vector>

#include "vi/affine_box.hpp"

namespace sweepvi {

using Indices = std::vector<Eigen::Index>;

inline bool has_lower(const AffineBox& box, Eigen::Index i) {
  return box.lower[i] > PETSC_NINFINITY;
}
inline bool has_upper(const AffineBox& box, Eigen::Index i) {
  return box.upper[i] < PETSC_INFINITY;
}

/// 2^exponent v, exact unless it leaves the range of numbers.
Eigen::VectorXd scaled_by(const Eigen::VectorXd& v, int exponent);

/// The same VI with rows and columns of M scaled, by powers of two, to entries of size 1.
struct Equilibrated {
  explicit Equilibrated(const AffineBox& given);
  Eigen::VectorXd unscaled(const Eigen::VectorXd& u) const { return columns.cwiseProduct(u); }

  AffineBox box;
  Eigen::VectorXd columns;  ///< u of the given problem = columns * u of this one
};

/// Groups of unknowns such that the rows of each read only its own and those of groups before it (strongly
/// connected components of the pattern, R. Tarjan, SIAM J. Comput. 1 (1972) 146-160).
std::vector<Indices> triangular_blocks(const Eigen::MatrixXd& M);

/// The VI of some unknowns, the others being as in u.
AffineBox part_of(const AffineBox& box, const Indices& unknowns, const Eigen::VectorXd& u);

/// u(inside) such that their rows vanish, the others staying as they are: LU, or least squares where that is
/// singular, and refinement with residuals in extended precision.
void solve_inside(const AffineBox& box, const Indices& inside, Eigen::VectorXd& u);

/// Worst natural residual over the terms of its row.
double violation(const AffineBox& box, const Eigen::VectorXd& u);
inline constexpr double solved_to = 1e-11;  ///< a violation that counts as none: rounding of a bad basis

/// The best of all choices of who is at which bound, if that is a solution.
AffineBoxSolution enumerate_affine_box(const AffineBox& box);

}  // namespace sweepvi
