#pragma once

#include <memory>
#include <string>

#include "sweepvi/dvi.hpp"
#include "sweepvi/linear_system.hpp"
#include "sweepvi/relative_degree.hpp"
#include "sweepvi/scheme.hpp"
#include "sweepvi/time_grid.hpp"

namespace sweepvi {

/// Which of the two forms of the same box VI a linear system is solved in.
enum class Form {
  box_on_z,    ///< unknowns are the outputs and other states; the outputs' rows read the measures
  primal_dual  ///< unknowns are the states and one multiplier per level
};
const char* name_of(Form form);

/// Why a system cannot be solved as a box on z; empty if it can. @param h  of the steps [s]; 0: states that
/// are 0 at the start do not count for the condition of the coordinates @note Collective.
std::string against_box_on_z(const LinearSystem& system, const RelativeDegree& relative_degree, Scheme scheme,
                             double h = 0.0);

/// The form to solve in: what -sweepvi_form asks for, else box_on_z where it fits (no extra unknowns).
///
/// box_on_z needs the scheme homsp, degrees >= 1, inputs that are not shared (M diagonal), and outputs from
/// which the states follow by local substitution, constraint and states on one rank (`distribute` sees to
/// that); and coordinates that amplify the rounding of no state by more than 1e6.
/// @throws Error (bad_input) on every rank if the form asked for does not fit, with the reason.
/// @note Collective on the system's communicator.
Form choose_form(const LinearSystem& system, const RelativeDegree& relative_degree, Scheme scheme,
                 double h = 0.0);

/// Discretises `system` on `grid` by homsp, zd_euler or naive_euler. `system` and `relative_degree` must
/// outlive the result.
/// @param theta  homsp: weight of t_{k+1} in A x + f, the rest stands at t_k; measures and bounds stay at
/// t_{k+1}. The paper has 1. With 1/2 the error is O(h^2) in free flight, in contact, and across
/// impacts that end in contact.
/// @throws Error (bad_input) if theta is outside (0, 1], or not 1 with another scheme
/// @note Collective on the system's communicator.
std::unique_ptr<ConstrainedDvi> make_linear_dvi(const LinearSystem& system,
                                                const RelativeDegree& relative_degree, Scheme scheme,
                                                Form form, const TimeGrid& grid, double theta = 1.0);

}  // namespace sweepvi
