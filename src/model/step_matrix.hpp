#pragma once

#include <string>

#include "sweepvi/lagrangian.hpp"

namespace sweepvi {

/// "coordinates 0, 3", by the scene's numbers. @note Collective.
std::string coordinates_text(const LagrangianSystem& system, const std::vector<PetscInt>& rows);

/// Looks at I - s h A for 0 < s < 1, `h` the step times theta: it must not become singular on the way to the
/// step that is asked for, as else a step has another solution than the motion (at s = 1 itself no step can
/// be solved, and it is taken in parts). It is singular where A has the real eigenvalue 1 / (s h). Known
/// where no Gershgorin disc of A reaches as far, else from the eigenvalues of matrices of up to 400 rows; of
/// larger ones where the symmetric part of I - h A is definite, and from the real eigenvalues at the edge of
/// the spectrum that Arnoldi's method finds.
/// @param name  of A, for messages   @return what was found, for `check`
/// @throws Error (bad_input) on every rank, with the largest step that works. @note Collective.
std::string check_first_order_step(Mat A, double h, double theta, const std::string& name);

}  // namespace sweepvi
