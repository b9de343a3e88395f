#pragma once

#include <Eigen/Core>
#include <functional>
#include <string>

#include "sweepvi/dvi.hpp"
#include "sweepvi/step_solver.hpp"

namespace sweepvi {

/// How an affine VI is solved: by Lemke's method, or for very small ones by all means.
enum class AffineMethod { lemke, enumeration };

/// Outer linearisation of a step's VI (Josephy and Newton's method): the next iterate is the solution of the
/// affine box VI
///
///     F(u_i) + F'(u_i) (u - u_i),      l <= u <= b,
///
/// exactly, by pivoting (src/vi/affine_box.hpp), whole, and with no regard to what F makes of it: there is no
/// merit function and no line search. Near a solution it converges quadratically; from afar nothing holds it
/// back. Small problems only: the data are gathered on rank 0, dense.
/// Source: O. Huber and H. Oza (HO), section V.A, who advise against it; N. H. Josephy, Newton's method for
/// generalized equations, 1979.
class OuterLinearisation {
public:
  static constexpr PetscInt largest = 1000;          ///< unknowns
  static constexpr PetscInt largest_searched = 100;  ///< for AffineMethod::enumeration
  static constexpr PetscInt most_iterations = 100;

  /// @throws Error (bad_input) if the problem has more than `largest` unknowns @note Collective.
  explicit OuterLinearisation(Dvi& problem);

  struct Result {
    PetscInt iterations = 0;  ///< affine VIs solved
    std::string reason;       ///< in the manner of SNES: OUTER_CONVERGED, ...
  };

  /// Certificate ratio of the point that u settles to.
  using Ratio = std::function<double(Vec u)>;

  /// Iterates from `u` until `ratio` is at most the target, or below stagnation without getting better.
  /// @note Collective.
  Result iterate(Vec u, Vec lower, Vec upper, const CertificateOptions& options, const Ratio& ratio,
                 AffineMethod method);

private:
  enum class Affine : int { solved, ray, none };
  Affine advance(Vec u, Vec lower, Vec upper, AffineMethod method);

  Dvi& problem_;
  Matrix jacobian_;
  Vector f_;
  Eigen::MatrixXd last_;   // rank 0: matrix of the last affine VI
  bool repeated_ = false;  // and the one before had the same
};

}  // namespace sweepvi
