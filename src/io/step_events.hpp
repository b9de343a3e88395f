#pragma once

#include <vector>

#include "io/table_file.hpp"
#include "sweepvi/dvi.hpp"

namespace sweepvi {

/// The events of a step that ended at t [s], in the scene's numbers.
/// @param numbers  scene number of each constraint this rank owns
inline std::vector<Event> events_of(const std::vector<StepEvent>& step, const std::vector<PetscInt>& numbers,
                                    double t) {
  std::vector<Event> events;
  events.reserve(step.size());
  for (const StepEvent& event : step)
    events.push_back({t, numbers[static_cast<std::size_t>(event.constraint)], event.level,
                      event.impact ? Event::Kind::impact : Event::Kind::liftoff, event.impulse});
  return events;
}

}  // namespace sweepvi
