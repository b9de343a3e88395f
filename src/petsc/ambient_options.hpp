#pragma once

#include <string>

namespace sweepvi {

/// Options that make PETSc load code, start other programs or read more options from files: what nobody
/// should have put into a process without being asked. They work on the command line only.
/// @param text  options as in PETSC_OPTIONS
/// @return the first such option in it, with its value where that is what is wrong; empty: there is none
std::string loads_code(const std::string& text);

/// Takes out of the environment what PETSc would read there unasked, before PetscInitialize().
/// @param confined  nothing of it may stay, not even PETSC_OPTIONS
/// @throws Error (bad_input) if PETSC_OPTIONS has one of the options above
void clean_petsc_environment(bool confined);

}  // namespace sweepvi
