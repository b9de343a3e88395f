#include "dvi/level_state.hpp"

#include <algorithm>

namespace sweepvi {

void LevelState::allocate(const std::vector<int>& levels_of_constraint, int columns_of_mu, Vec wmax) {
  const std::size_t count = levels_of_constraint.size();
  first.assign(1, 0);
  for (const int levels : levels_of_constraint)
    first.push_back(first.back() + levels);
  z.assign(static_cast<std::size_t>(first.back()), 0.0);
  level.assign(count, 0);
  mu_levels = std::max(columns_of_mu, 1);
  mu.assign(count * static_cast<std::size_t>(mu_levels), 0.0);
  mu_shift.assign(count, 0);
  w.assign(count, 0.0);
  side.assign(count, Side::none);
  upper.assign(count, PETSC_INFINITY);
  if (wmax == nullptr) return;
  const ReadArray walls(wmax);
  for (std::size_t a = 0; a < count; ++a)
    upper[a] = std::min(walls[static_cast<PetscInt>(a)], PETSC_INFINITY);
}

void LevelState::apply_level_rule() {
  for (std::size_t a = 0; a < constraints(); ++a) {
    side[a] = side_of(a, z[at(a, 1)]);
    int r_star = 1;
    if (side[a] != Side::none) {
      while (r_star < levels(a) && (r_star == 1 || sign(side[a]) * z[at(a, r_star)] <= 0.0))
        ++r_star;
    }
    level[a] = r_star;
  }
}

void LevelState::advance(std::vector<double>& z_new) {
  events.clear();
  for (std::size_t a = 0; a < constraints(); ++a) {
    const auto number = static_cast<PetscInt>(a);
    const Side old_side = side[a];
    const Side new_side = side_of(a, z_new[at(a, 1)]);
    const double z1 = z[at(a, 1)];
    const bool violated = z1 < 0.0 || z1 > upper[a];  // such data are projected
    if (violated || (new_side != Side::none && new_side != old_side))
      events.push_back({number, new_side != Side::none ? new_side : old_side, 1, true, measure(a, 1)});
    for (int i = 2; i <= level[a]; ++i) {
      const double impulse = measure(a, i);
      if (sign(old_side) * z[at(a, i)] < 0.0 && sign(old_side) * impulse > 0.0)
        events.push_back({number, old_side, i, true, impulse});
    }
    if (old_side != Side::none && new_side != old_side)
      events.push_back({number, old_side, level[a], false, 0.0});
  }
  z.swap(z_new);
}

double LevelState::penetration(MPI_Comm comm) const {
  double worst = 0.0;
  for (std::size_t a = 0; a < constraints(); ++a)
    worst = std::max({worst, -w[a], w[a] - upper[a]});
  MPI_Allreduce(MPI_IN_PLACE, &worst, 1, MPI_DOUBLE, MPI_MAX, comm);
  return worst;
}

PetscInt LevelState::active() const {
  PetscInt count = 0;
  for (std::size_t a = 0; a < constraints(); ++a)
    count += side_of(a, z[at(a, 1)]) != Side::none ? 1 : 0;
  return count;
}

void LevelState::visit(StateVisitor& visitor) {
  visit_outputs(visitor, "z", z);
  visitor.visit("mu", Belongs::constraint, mu, static_cast<std::size_t>(mu_levels));
  visitor.visit("w", Belongs::constraint, w);
  visitor.visit("level", Belongs::constraint, level);
  visitor.visit("side", Belongs::constraint, side);
  if (visitor.replaces()) events.clear();
}

void LevelState::visit_outputs(StateVisitor& visitor, const char* name, std::span<double> values) const {
  const auto width = static_cast<std::size_t>(mu_levels);
  std::vector<double> padded(constraints() * width, 0.0);
  const auto each = [&](auto&& act) {
    for (std::size_t a = 0; a < constraints(); ++a)
      for (int i = 1; i <= levels(a); ++i)
        act(padded[a * width + static_cast<std::size_t>(i - 1)], values[at(a, i)]);
  };
  each([](double& to, double from) { to = from; });
  visitor.visit(name, Belongs::constraint, padded, width);
  each([](double from, double& to) { to = from; });
}

}  // namespace sweepvi
