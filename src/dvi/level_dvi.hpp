#pragma once

#include <string>
#include <utility>
#include <vector>

#include "dvi/level_state.hpp"

namespace sweepvi {

/// What all processes with levels share: the state, its outputs and levels, and reading them.
class LevelDvi : public ConstrainedDvi {
public:
  MPI_Comm comm() const final { return comm_; }
  Vec state() const final { return u_.get(); }
  double penetration() const final { return levels_.penetration(comm()); }
  PetscInt active() const final { return levels_.active(); }
  Vec x() const override { return x_.get(); }
  const std::vector<double>& w() const final { return levels_.w; }
  const std::vector<double>& z() const override { return levels_.z; }
  const std::vector<double>& mu() const final { return levels_.mu; }
  int mu_levels() const final { return levels_.mu_levels; }
  const std::vector<int>& level() const final { return levels_.level; }
  const std::vector<Side>& side() const final { return levels_.side; }
  const std::vector<StepEvent>& events() const final { return levels_.events; }
  void tell(std::vector<StepEvent> events) final { levels_.events = std::move(events); }
  /// Not where two walls are closer than an output is known that stands at one of them.
  bool admissible(Vec u) final;
  std::string refusal() final { return refusal_; }

protected:
  LevelDvi(MPI_Comm comm, double h) : comm_(comm), h_(h) {}

  /// Two walls that `settle` could not tell apart, on this rank; wmax = 0: none.
  struct Crowded {
    PetscInt constraint = 0;  ///< scene number
    double wmax = 0.0, known_to = 0.0;
  };
  /// How messages number an owned constraint.
  virtual PetscInt number_of(std::size_t a) const = 0;
  /// Call from `settle` for an output of level 1 that stands at a wall. @param known_to  how far around it
  void stands_at_wall(std::size_t a, double known_to) {
    if (levels_.upper[a] <= 2.0 * known_to) crowded_ = {number_of(a), levels_.upper[a], known_to};
  }

  bool two_sided_ = false;  // some constraint of some rank may have an upper wall
  Crowded crowded_;
  std::string refusal_;
  MPI_Comm comm_;
  double h_;  // [s]
  LevelState levels_;
  Vector u_, x_;  // unknowns; scene coordinates
};

}  // namespace sweepvi
