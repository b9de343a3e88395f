#pragma once

#include <limits>
#include <memory>
#include <vector>

#include "sweepvi/dvi.hpp"
#include "sweepvi/petsc.hpp"
#include "sweepvi/time_grid.hpp"

namespace sweepvi {

class FiniteDifferences;

/// A nonlinear system in zero-dynamics form, written by its user:
///
///     z_{a,i}' = z_{a,i+1},  i < r_a,       z_{a,r}' = a_a(t, z, xi) + m_a(t, z, xi) lambda_a,
///     xi' = q(t, z, xi),                    0 <= z_{a,1} <= wmax_a,
///
/// with m_a > 0. The state u holds z and xi in any order, distributed over the ranks as the user likes, each
/// constraint on one rank with all its levels. Source: Acary & Brogliato (AB), eq. (1)-(4) in the coordinates
/// of (25).
///
/// Where a_b or q read levels z_{a,j}, j >= 2, of a constraint a, its impacts jump them too; how is found
/// from the Jacobian at the start of the step (the linear system's d_{a,i}). That is exact where they are
/// read linearly; a product of the distributions themselves has no meaning.
class ZdSystem {
public:
  struct Constraint {
    std::vector<PetscInt> levels;  ///< local index in u of z_{a,1}, ..., z_{a,r}; their number is r_a >= 1
    double wmax = std::numeric_limits<double>::infinity();  ///< > 0
  };

  virtual ~ZdSystem() = default;

  /// The constraints this rank owns. @note Not collective.
  virtual std::vector<Constraint> constraints() const = 0;
  /// u at the start; its layout is that of all vectors. @note Collective.
  virtual Vector initial_state() const = 0;
  /// Fills a_a on rows (a, r) and q on rows of xi; rows of levels below r are not read. @note Collective.
  virtual void rates(double t, Vec u, Vec rates) const = 0;
  /// m_a for each owned constraint, 1 where nothing is said. @note Collective.
  virtual void gains(double t, Vec u, std::vector<double>& m) const;
  /// A matrix (AIJ) with the sparsity pattern of d rates / du; its values do not matter. @note Collective.
  virtual Matrix pattern() const = 0;
  /// Fills d rates / du, within the pattern, and returns true; or returns false to have it found by finite
  /// differences. Rows of levels below r are not read. @note Collective.
  virtual bool jacobian(double t, Vec u, Mat jacobian) const;
};

/// d rates / du of a ZdSystem: its own, or finite differences along the colours of its pattern
/// (-mat_coloring_type, -mat_fd_*). All methods are collective.
class ZdJacobian {
public:
  explicit ZdJacobian(const ZdSystem& system);
  ~ZdJacobian();
  ZdJacobian(const ZdJacobian&) = delete;
  ZdJacobian& operator=(const ZdJacobian&) = delete;

  Mat evaluate(double t, Vec u);            ///< valid until the next call
  Mat finite_differences(double t, Vec u);  ///< likewise
  /// Largest |J - finite differences| of the rows that are read, over the largest entry of its row (or 1).
  /// About 1e-7 for a right Jacobian of well-scaled rates.
  double error(double t, Vec u);

private:
  const ZdSystem& system_;
  Matrix jacobian_;
  double t_ = 0.0;  // of the differences
  std::unique_ptr<FiniteDifferences> differences_;
};

/// Discretises `system` by HOMSP on `grid`: F = J^{-1} [u - u_k - h theta f(t_{k+1}, u) - h (1-theta) f(t_k,
/// u_k)], box on z, J the jumps that measures cause. x() is u. `system` must outlive the result.
/// @param theta  as for make_linear_dvi
/// @throws Error (bad_input) on every rank if levels or pattern make no sense, m_a <= 0 at the start, or
/// theta is outside (0, 1]
/// @note Collective.
std::unique_ptr<ConstrainedDvi> make_zd_dvi(const ZdSystem& system, const TimeGrid& grid, double theta = 1.0);

}  // namespace sweepvi
