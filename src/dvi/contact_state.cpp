#include "dvi/contact_state.hpp"

#include <algorithm>
#include <utility>

namespace sweepvi {

double reach_of(Detection detection) {
  switch (detection) {
    case Detection::predicted:
      return 1.0;
    case Detection::midpoint:
      return 0.5;
    case Detection::current:
      return 0.0;
  }
  return 0.0;
}

void ContactState::start(std::vector<double> gaps, std::vector<double> velocities, Vec restitution) {
  gap = std::move(gaps);
  velocity = std::move(velocities);
  {
    const ReadArray values(restitution);
    e.assign(values.data(), values.data() + values.size());
  }
  level.assign(size(), 0);
  mu.assign(2 * size(), 0.0);
  side.assign(size(), Side::none);
  contact.assign(size(), 0);
  for (std::size_t a = 0; a < size(); ++a)
    contact[a] = gap[a] <= 0.0 && velocity[a] == 0.0 ? 1 : 0;
}

void ContactState::detect(const std::vector<double>& tested, Detection detection) {
  const bool strict = detection == Detection::current;
  for (std::size_t a = 0; a < size(); ++a) {
    const bool reached = strict ? tested[a] < 0.0 : tested[a] <= 0.0;
    level[a] = reached ? 2 : 1;
    side[a] = reached ? Side::lower : Side::none;
  }
  events.clear();
}

void ContactState::take_impulse(std::size_t a, bool holds, double impulse) {
  const auto number = static_cast<PetscInt>(a);
  mu[2 * a + 1] = impulse;
  if (holds && contact[a] == 0) events.push_back({number, Side::lower, 2, true, impulse});
  if (!holds && contact[a] != 0) events.push_back({number, Side::lower, 2, false, 0.0});
  contact[a] = holds ? 1 : 0;
}

double ContactState::penetration(MPI_Comm comm) const {
  double worst = 0.0;
  for (const double g : gap)
    worst = std::max(worst, -g);
  MPI_Allreduce(MPI_IN_PLACE, &worst, 1, MPI_DOUBLE, MPI_MAX, comm);
  return worst;
}

PetscInt ContactState::active() const {
  return static_cast<PetscInt>(std::count(contact.begin(), contact.end(), 1));
}

void ContactState::visit(StateVisitor& visitor) {
  visitor.visit("gap", Belongs::constraint, gap);
  visitor.visit("gap velocity", Belongs::constraint, velocity);
  visitor.visit("level", Belongs::constraint, level);
  visitor.visit("contact", Belongs::constraint, contact);
  visitor.visit("mu", Belongs::constraint, mu, 2);
  visitor.visit("side", Belongs::constraint, side);
  if (visitor.replaces()) events.clear();
}

}  // namespace sweepvi
