#pragma once

#include <petscsys.h>

#include <string>

namespace sweepvi {

/// PETSc's own words on the error that was raised last, with this code.
std::string petsc_text(PetscErrorCode code);

}  // namespace sweepvi
