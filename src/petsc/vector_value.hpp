#pragma once

#include <petsc/private/petscimpl.h>

#include "sweepvi/petsc.hpp"

namespace sweepvi {

/// A vector and its value, to see whether it is still the same: PETSc counts changes.
struct VectorValue {
  VectorValue() = default;
  explicit VectorValue(Vec vector) {
    const auto object = reinterpret_cast<PetscObject>(vector);
    check(PetscObjectGetId(object, &id));
    check(PetscObjectStateGet(object, &state));
  }
  bool operator==(const VectorValue&) const = default;
  PetscObjectId id = -1;
  PetscObjectState state = -1;
};

}  // namespace sweepvi
