#pragma once

#include "sweepvi/petsc.hpp"

namespace sweepvi {

/// |A| with no entry above `most`: along which residue is passed on from the unknowns that a row reads
/// (Dvi::spread_terms). A stiff coefficient must not multiply it: in a few sweeps it would grow beyond all
/// terms of the step, and excuse whatever a row is off by.
Matrix absolute_up_to(Mat A, double most);

}  // namespace sweepvi
