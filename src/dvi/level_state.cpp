#include "dvi/level_state.hpp"

#include <algorithm>

namespace sweepvi {

void LevelState::allocate(const std::vector<int>& levels_of_constraint, int columns_of_mu) {
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
}

void LevelState::apply_level_rule() {
  for (std::size_t a = 0; a < constraints(); ++a) {
    int r_star = 1;
    while (r_star < levels(a) && z[at(a, r_star)] <= 0.0)
      ++r_star;
    level[a] = r_star;
  }
}

void LevelState::advance(const std::vector<double>& z_new) {
  events.clear();
  for (std::size_t a = 0; a < constraints(); ++a) {
    const bool was_closed = z[at(a, 1)] <= 0.0;
    const bool is_closed = z_new[at(a, 1)] <= 0.0;
    for (int i = 1; i <= level[a]; ++i) {
      const double impulse = measure(a, i);
      const bool jumped = i == 1 ? !was_closed && is_closed : z[at(a, i)] < 0.0 && impulse > 0.0;
      const bool pushed_in = i == 1 && z[at(a, 1)] < 0.0;  // data that violate the constraint are projected
      if (jumped || pushed_in) events.push_back({static_cast<PetscInt>(a), i, true, impulse});
    }
    if (was_closed && !is_closed) events.push_back({static_cast<PetscInt>(a), level[a], false, 0.0});
  }
  z = z_new;
}

double LevelState::penetration(MPI_Comm comm) const {
  double worst = 0.0;
  for (std::size_t a = 0; a < constraints(); ++a)
    worst = std::max(worst, -w[a]);
  MPI_Allreduce(MPI_IN_PLACE, &worst, 1, MPI_DOUBLE, MPI_MAX, comm);
  return worst;
}

PetscInt LevelState::active() const {
  PetscInt count = 0;
  for (std::size_t a = 0; a < constraints(); ++a)
    count += z[at(a, 1)] <= 0.0 ? 1 : 0;
  return count;
}

}  // namespace sweepvi
