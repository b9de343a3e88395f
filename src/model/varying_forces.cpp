#include "model/varying_forces.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace sweepvi {

VaryingForces::VaryingForces(const Forcing& forcing, PetscInt rows) : rows_(rows) {
  bool in_order = static_cast<PetscInt>(forcing.varying.size()) == rows;
  for (const Forcing::Entry& entry : forcing.varying) {
    in_order = in_order && entry.local == static_cast<PetscInt>(row_.size());
    row_.push_back(entry.local);
    offset_.push_back(entry.signal.offset);
    sine_.push_back(entry.signal.amplitude * entry.sine);
    cosine_.push_back(entry.signal.amplitude * entry.cosine);
    if (tones_.empty() || tones_.back().frequency != entry.signal.frequency)
      tones_.push_back({entry.signal.frequency, 0});
    tones_.back().end = row_.size();
  }
  if (in_order) row_ = {};
}

// Many entries share a frequency: sin(a + phase) = sin(a) cos(phase) + cos(a) sin(phase).
void VaryingForces::find(double* y, double t_1, double factor_1, double t_2, double factor_2) const {
  const double factor = factor_1 + factor_2;
  const bool in_order = row_.empty() && !offset_.empty();
  if (!in_order) std::fill_n(y, rows_, 0.0);
  std::size_t begin = 0;
  for (const Tone& tone : tones_) {
    const double omega = 2.0 * std::numbers::pi * tone.frequency;
    const double sine = factor_1 * std::sin(omega * t_1) + factor_2 * std::sin(omega * t_2);
    const double cosine = factor_1 * std::cos(omega * t_1) + factor_2 * std::cos(omega * t_2);
    const auto value = [&](std::size_t k) {
      return factor * offset_[k] + (sine * cosine_[k] + cosine * sine_[k]);
    };
    if (in_order)
      for (std::size_t k = begin; k < tone.end; ++k)
        y[k] = value(k);
    else
      for (std::size_t k = begin; k < tone.end; ++k)
        y[row_[k]] += value(k);
    begin = tone.end;
  }
}

}  // namespace sweepvi
