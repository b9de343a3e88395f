#include "sweepvi/linear_dvi.hpp"

#include <fmt/format.h>

#include <string>

#include "dvi/box_on_z.hpp"
#include "dvi/coordinate_condition.hpp"
#include "dvi/form_option.hpp"
#include "dvi/primal_dual.hpp"
#include "petsc/sparse.hpp"

namespace sweepvi {

const char* name_of(Form form) {
  return form == Form::box_on_z ? "box on z" : "primal-dual";
}

std::string against_box_on_z(const LinearSystem& system, const RelativeDegree& relative_degree, Scheme scheme,
                             double h) {
  if (scheme != Scheme::homsp) return std::string("the scheme is ") + name_of(scheme) + ", not homsp";
  if (relative_degree.lowest < 1) return "some constraint has relative degree 0";
  if (!relative_degree.has_pivots)
    return "the Markov matrix is not diagonal, or states do not follow from the outputs by local "
           "substitution";
  const LocalRange states = row_range(system.A.get());
  int away = 0;
  for (const PetscInt pivot : relative_degree.pivot)
    if (!states.contains(pivot)) away = 1;
  MPI_Allreduce(MPI_IN_PLACE, &away, 1, MPI_INT, MPI_LOR, system.comm());
  if (away != 0) return "a constraint and the states it reads are on different ranks";
  const double condition = coordinate_condition(system, relative_degree, h);
  if (condition <= most_amplified) return "";
  return fmt::format("the change to outputs as coordinates amplifies rounding {:.1e} times", condition);
}

Form choose_form(const LinearSystem& system, const RelativeDegree& relative_degree, Scheme scheme, double h) {
  const std::string asked = asked_form(system.comm());
  const std::string obstacle = against_box_on_z(system, relative_degree, scheme, h);
  if (asked == "primal-dual") return Form::primal_dual;
  if (asked == "auto") return obstacle.empty() ? Form::box_on_z : Form::primal_dual;
  if (asked != "box-on-z")
    throw InputError("-sweepvi_form is '" + asked + "'; expected auto, box-on-z or primal-dual");
  if (!obstacle.empty())
    throw InputError("-sweepvi_form box-on-z does not fit: " + obstacle + "; use primal-dual");
  return Form::box_on_z;
}

std::unique_ptr<ConstrainedDvi> make_linear_dvi(const LinearSystem& system,
                                                const RelativeDegree& relative_degree, Scheme scheme,
                                                Form form, const TimeGrid& grid, double theta) {
  require_weight("theta of homsp", theta);
  if (theta != 1.0 && scheme != Scheme::homsp)
    throw InputError(std::string("theta < 1 goes with the scheme homsp, not with ") + name_of(scheme));
  if (form == Form::box_on_z)
    return std::make_unique<BoxOnZ>(system, relative_degree, grid.start, grid.h(), theta);
  return std::make_unique<PrimalDual>(system, relative_degree, scheme, grid.start, grid.h(), theta);
}

}  // namespace sweepvi
