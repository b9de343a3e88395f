#include "dvi/catching_up.hpp"

#include <algorithm>

namespace sweepvi {

CatchingUp::CatchingUp(const SweepingSystem& system, const TimeGrid& grid) : system_(system), h_(grid.h()) {}

void CatchingUp::allocate(std::size_t constraints) {
  w_.assign(constraints, 0.0);
  mu_.assign(constraints, 0.0);
  level_.assign(constraints, 0);
  side_.assign(constraints, Side::none);
  old_side_ = side_;
}

void CatchingUp::advance(const std::vector<Side>& new_side) {
  events_.clear();
  for (std::size_t a = 0; a < side_.size(); ++a) {
    const auto number = static_cast<PetscInt>(a);
    if (side_[a] != Side::none && new_side[a] != side_[a])
      events_.push_back({number, side_[a], 1, false, 0.0});
    if (new_side[a] != Side::none && (new_side[a] != side_[a] || started_outside_[a] != 0))
      events_.push_back({number, new_side[a], 1, true, mu_[a]});
  }
  std::fill(level_.begin(), level_.end(), 1);
  started_outside_.assign(side_.size(), 0);
  old_side_ = side_;
  side_ = new_side;
}

void CatchingUp::start(const std::vector<Side>& side) {
  side_ = old_side_ = side;
  started_outside_.assign(side.size(), 0);
  for (std::size_t a = 0; a < side.size(); ++a)
    started_outside_[a] = w_[a] < 0.0 ? 1 : 0;
}

double CatchingUp::penetration() const {
  double worst = 0.0;
  for (const double w : w_)
    worst = std::max(worst, -w);
  MPI_Allreduce(MPI_IN_PLACE, &worst, 1, MPI_DOUBLE, MPI_MAX, comm());
  return worst;
}

PetscInt CatchingUp::active() const {
  return static_cast<PetscInt>(
      std::count_if(side_.begin(), side_.end(), [](Side side) { return side != Side::none; }));
}

void CatchingUp::visit(StateVisitor& visitor) {
  visitor.visit("u", Belongs::state, x());
  visitor.visit("w", Belongs::constraint, w_);
  visitor.visit("mu", Belongs::constraint, mu_);
  visitor.visit("level", Belongs::constraint, level_);
  visitor.visit("side", Belongs::constraint, side_);
  visitor.visit("old side", Belongs::constraint, old_side_);
  visitor.visit("started outside", Belongs::constraint, started_outside_);
  if (visitor.replaces()) events_.clear();
}

std::unique_ptr<ConstrainedDvi> make_sweeping_dvi(const SweepingSystem& system, const TimeGrid& grid) {
  if (system.is_box()) return std::make_unique<CatchingUpBox>(system, grid);
  return std::make_unique<CatchingUpPolyhedron>(system, grid);
}

}  // namespace sweepvi
