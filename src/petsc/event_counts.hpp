#pragma once

#include <cstdint>

namespace sweepvi {

/// Has this process's PETSc events counted from here on. PETSc's own log does that where the user asked for
/// one; elsewhere events are counted and not timed: in a small scene, reading the clock at each of them costs
/// more than a third of a step. To be called again when options were added, of which -log_view may be one.
void count_events();

/// How often an event has begun on this rank: "KSPSolve". 0 if there is none of that name.
std::int64_t event_count(const char* name);

}  // namespace sweepvi
