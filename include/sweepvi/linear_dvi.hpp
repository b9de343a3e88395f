#pragma once

#include <memory>

#include "sweepvi/dvi.hpp"
#include "sweepvi/linear_system.hpp"
#include "sweepvi/relative_degree.hpp"
#include "sweepvi/time_grid.hpp"

namespace sweepvi {

/// How a linear system is discretised.
enum class Scheme {
  homsp,       ///< higher order Moreau sweeping process, AB (34)-(45)
  zd_euler,    ///< backward Euler on the zero-dynamics form, AB (63); shown because it fails for r > 1
  naive_euler  ///< backward Euler on x, AB (47); shown because it fails for r > 1
};
const char* name_of(Scheme scheme);

/// Which of the two forms of the same box VI a linear system is solved in.
enum class Form {
  box_on_z,    ///< unknowns are the states; the outputs among them are bounded, their rows read the measures
  primal_dual  ///< unknowns are the states and one multiplier per level
};
const char* name_of(Form form);

/// The cheapest form that fits: box_on_z where all outputs are states of their own (no extra unknowns).
Form choose_form(Scheme scheme, const RelativeDegree& relative_degree);

/// Discretises `system` on `grid`. `system` and `relative_degree` must outlive the result.
/// @note Collective on the system's communicator.
std::unique_ptr<ConstrainedDvi> make_linear_dvi(const LinearSystem& system,
                                                const RelativeDegree& relative_degree, Scheme scheme,
                                                Form form, const TimeGrid& grid);

}  // namespace sweepvi
