#pragma once

#include "sweepvi/petsc.hpp"

namespace sweepvi {

/// Our default for linear systems, before the options database: one LU solve by MUMPS, on several ranks by
/// the PC type "gathered" (petsc/gathered_lu.hpp), because parallel MUMPS gives other bits in every run. With
/// -pc_type lu the default package is MUMPS, too. Puts MUMPS's settings (see the source) into the options
/// database unless they are there.
void default_to_mumps(KSP ksp);

/// These defaults, then the options database, with failures as results (petsc/guarded_setup.hpp).
/// @note Collective.
void configure(KSP ksp);

/// @throws Error (bad_input) if the package chosen for an LU cannot factor `matrix`: it would only show in
/// the first step @note Collective.
void check_factorization(PC pc, Mat matrix);
/// Why the preconditioner of a failed solve could not be built; PC_NOERROR if it could. To be asked before
/// `recover`, the same on every rank. @note Collective.
PCFailedReason failed_reason(KSP ksp);

/// After a failed solve: empties the solver, because MUMPS's factor object does not recover (PETSc 3.18:
/// INFOG(1) = -3 at the next solve). Operators must be set again.
/// @return true if MUMPS had run out of workspace and now gets more, so that it is worth trying again. Rows
/// of multipliers have no diagonal: where many constraints touch, MUMPS delays more pivots than it foresees.
/// @note Collective.
bool recover(KSP ksp);

/// Floating-point operations of the solver's last factorization, as MUMPS counts them (RINFOG(3)); 0 if it
/// has none, or not by MUMPS. @note Collective.
double mumps_flops(KSP ksp);

/// Solves `matrix` `solution` = `right` with a solver whose operator `matrix` is, trying again where
/// `recover` helps. @return false if that fails; the solver is then empty and will factor anew.
/// @throws Error (bad_input) if the preconditioner chosen cannot be used like that @note Collective.
bool solve(KSP ksp, Mat matrix, Vec right, Vec solution);

}  // namespace sweepvi
