#include "dvi/contact_state.hpp"

#include <algorithm>
#include <cmath>
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

template <class Gap>
void ContactState::detect_by(Gap&& gap_of, Detection detection) {
  const bool strict = detection == Detection::current;
  for (std::size_t a = 0; a < size(); ++a) {
    const double tested = gap_of(a);
    const bool reached = strict ? tested < 0.0 : tested <= 0.0;
    level[a] = reached ? 2 : 1;
    side[a] = reached ? Side::lower : Side::none;
  }
  events.clear();
}

void ContactState::detect(const std::vector<double>& tested, Detection detection) {
  detect_by([&](std::size_t a) { return tested[a]; }, detection);
}

void ContactState::detect(double ahead, Detection detection) {
  detect_by([&](std::size_t a) { return gap[a] + ahead * velocity[a]; }, detection);
}

void ContactState::change_contact(std::size_t a, bool holds, double impulse) {
  events.push_back({static_cast<PetscInt>(a), Side::lower, 2, holds, holds ? impulse : 0.0});
  contact[a] = holds ? 1 : 0;
}

void ContactState::change_contacts(std::span<const std::int32_t> changed) {
  for (const std::int32_t constraint : changed) {
    const auto a = static_cast<std::size_t>(constraint);
    change_contact(a, contact[a] == 0, impulse(a));
  }
}

double ContactState::depth() const {
  double worst = deepest.value_or(0.0);
  if (!deepest)
    for (const double g : gap)
      worst = std::max(worst, -g);
  return worst;
}

double ContactState::speed() const {
  double worst = fastest.value_or(0.0);
  if (!fastest)
    for (const double v : velocity)
      worst = std::max(worst, std::abs(v));
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
  if (!visitor.replaces()) return;
  events.clear();
  deepest.reset();
  fastest.reset();
}

}  // namespace sweepvi
