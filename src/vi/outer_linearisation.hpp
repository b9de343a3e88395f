#pragma once

#include <functional>
#include <string>

#include "sweepvi/dvi.hpp"

namespace sweepvi {

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
  static constexpr PetscInt largest = 100;  ///< unknowns
  static constexpr PetscInt most_iterations = 100;

  /// @throws Error (bad_input) if the problem has more than `largest` unknowns @note Collective.
  explicit OuterLinearisation(Dvi& problem);

  enum class Outcome { converged, stagnated, limit, no_affine_solution, overflow };
  struct Result {
    PetscInt iterations = 0;  ///< affine VIs solved
    Outcome outcome = Outcome::limit;
  };

  /// Certificate ratio of the point that u settles to.
  using Ratio = std::function<double(Vec u)>;

  /// Iterates from `u` until `ratio` is at most `target`, or below `stagnation` without getting better.
  /// @note Collective.
  Result iterate(Vec u, Vec lower, Vec upper, double target, double stagnation, const Ratio& ratio);

private:
  bool advance(Vec u, Vec lower, Vec upper);

  Dvi& problem_;
  Matrix jacobian_;
  Vector f_;
};

const char* name_of(OuterLinearisation::Outcome outcome);

}  // namespace sweepvi
