#include "dvi/form_option.hpp"

#include <array>

#include "sweepvi/petsc.hpp"

namespace sweepvi {

std::string asked_form(MPI_Comm comm) {
  std::array<char, 64> form{"auto"};
  const auto read = [&]() -> PetscErrorCode {
    PetscFunctionBeginUser;
    PetscOptionsBegin(comm, nullptr, "sweepvi: form of the box VI", "sweepvi");
    PetscCall(PetscOptionsString(
        "-sweepvi_form", "Unknowns of a step: auto | box-on-z (homsp) | box-on-v (moreau-jean) | primal-dual",
        "Form", form.data(), form.data(), form.size(), nullptr));
    PetscOptionsEnd();
    PetscFunctionReturn(static_cast<PetscErrorCode>(0));  // an enumeration in newer PETSc
  };
  check_options(read());
  return form.data();
}

}  // namespace sweepvi
