#pragma once

#include <exception>
#include <functional>

#include "sweepvi/petsc.hpp"

namespace sweepvi {

/// The Jacobian of a square function by finite differences, one evaluation for each colour of its pattern
/// (-mat_coloring_type, -mat_fd_*). All members are collective.
class FiniteDifferences {
public:
  using Function = std::function<void(Vec u, Vec values)>;

  /// @param pattern  where the Jacobian has entries; the values do not matter
  FiniteDifferences(Mat pattern, Function function);
  ~FiniteDifferences();
  FiniteDifferences(const FiniteDifferences&) = delete;
  FiniteDifferences& operator=(const FiniteDifferences&) = delete;

  /// The Jacobian at u, valid until the next call. It may have more entries than the pattern.
  Mat evaluate(Vec u);

private:
  static PetscErrorCode call(void*, Vec u, Vec values, void* self);

  Function function_;
  Matrix jacobian_;
  MatFDColoring colours_ = nullptr;
  std::exception_ptr parked_;
};

}  // namespace sweepvi
