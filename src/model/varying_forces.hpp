#pragma once

#include <cstddef>
#include <vector>

#include "sweepvi/linear_system.hpp"

namespace sweepvi {

/// The entries of a Forcing that vary, packed: a chain in which each mass has a phase of its own goes through
/// all of them in each step.
class VaryingForces {
public:
  VaryingForces() = default;
  /// @param rows  of this rank
  VaryingForces(const Forcing& forcing, PetscInt rows);

  /// y = factor_1 f(t_1) + factor_2 f(t_2) in all rows of this rank, 0 where nothing varies. @note Not
  /// collective.
  void find(double* y, double t_1, double factor_1, double t_2, double factor_2) const;

private:
  /// Entries of one frequency, up to `end`.
  struct Tone {
    double frequency;
    std::size_t end;
  };
  std::vector<Tone> tones_;
  std::vector<double> offset_, sine_, cosine_;  // by entry; amplitude times sin(phase) and cos(phase)
  std::vector<PetscInt> row_;                   // empty: all rows, in their order
  PetscInt rows_ = 0;
};

}  // namespace sweepvi
