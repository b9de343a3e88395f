#include "sweepvi/linear_dvi.hpp"

#include <algorithm>

#include "dvi/box_on_z.hpp"
#include "dvi/primal_dual.hpp"

namespace sweepvi {

const char* name_of(Scheme scheme) {
  switch (scheme) {
    case Scheme::homsp:
      return "homsp";
    case Scheme::zd_euler:
      return "zd-euler";
    case Scheme::naive_euler:
      return "naive-euler";
  }
  return "";
}

const char* name_of(Form form) {
  return form == Form::box_on_z ? "box on z" : "primal-dual";
}

Form choose_form(Scheme scheme, const RelativeDegree& relative_degree) {
  return scheme == Scheme::homsp && relative_degree.outputs_are_states ? Form::box_on_z : Form::primal_dual;
}

std::unique_ptr<ConstrainedDvi> make_linear_dvi(const LinearSystem& system,
                                                const RelativeDegree& relative_degree, Scheme scheme,
                                                Form form, const TimeGrid& grid) {
  if (form == Form::box_on_z) return std::make_unique<BoxOnZ>(system, relative_degree, grid.start, grid.h());
  return std::make_unique<PrimalDual>(system, relative_degree, scheme, grid.start, grid.h());
}

}  // namespace sweepvi
