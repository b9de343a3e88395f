#pragma once

#include <mpi.h>

#include <string>

namespace sweepvi {

/// What -sweepvi_form asks for, "auto" if nothing; not checked. @note Collective.
std::string asked_form(MPI_Comm comm);

}  // namespace sweepvi
