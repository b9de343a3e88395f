#pragma once

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

protected:
  LevelDvi(MPI_Comm comm, double h) : comm_(comm), h_(h) {}

  MPI_Comm comm_;
  double h_;  // [s]
  LevelState levels_;
  Vector u_, x_;  // unknowns; scene coordinates
};

}  // namespace sweepvi
