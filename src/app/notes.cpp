#include "app/notes.hpp"

#include <fmt/format.h>

#include <cmath>

#include "app/summary.hpp"
#include "io/unresolved_signals.hpp"

namespace sweepvi::app {

namespace {

// Rounding of (end - start) / K is no other step.
constexpr double same_step = 1e-9;

}  // namespace

std::vector<Note> notes_before(const TimeSpec& time) {
  std::vector<Note> notes;
  if (time.unresolved_signals > 0)
    notes.push_back(
        {"unresolved_signal", time.unresolved_signals,
         fmt::format("{} signal{} of up to {:.6g} Hz {} not resolved by steps of {:.6g} s: {:.3g} periods in "
                     "a step, where {:g} would do",
                     time.unresolved_signals, time.unresolved_signals == 1 ? "" : "s", time.fastest_signal,
                     time.unresolved_signals == 1 ? "is" : "are", time.step, time.fastest_signal * time.step,
                     most_periods_in_step)});
  return notes;
}

std::vector<Note> notes_of(const TimeSpec& time, const Summary& summary) {
  std::vector<Note> notes = notes_before(time);
  const bool hybrid = time.scheme == Scheme::hybrid;
  if (std::abs(time.step - time.asked_step) > same_step * time.asked_step)
    notes.push_back({"step_adjusted", 1,
                     fmt::format("time.step = {:.6g} s does not divide the run: {} of {:.6g} s instead",
                                 time.asked_step, hybrid ? "rows" : "steps", time.step)});
  if (const std::int64_t parted = summary.rungs[static_cast<std::size_t>(Rung::smaller_step)]; parted > 0)
    notes.push_back(
        {"smaller_step", parted,
         fmt::format("{} of {} steps could only be solved in parts, {} at most: there the trajectory is that "
                     "of smaller steps (-sweepvi_halvings 0 forbids it)",
                     parted, summary.steps, summary.most_parts)});
  if (summary.hybrid && summary.hybrid->closed > 0)
    notes.push_back(
        {"accumulation_ended", summary.hybrid->closed,
         fmt::format("{} accumulations of impacts ended by contact, where flights were below the tolerance",
                     summary.hybrid->closed)});
  if (summary.hybrid && !(summary.hybrid->relative_error <= time.tolerance))
    notes.push_back({"tolerance_missed", 1,
                     fmt::format("the estimated error of a component, {:.2g} of its size, is above the "
                                 "tolerance, {:.2g}: the motion has made that "
                                 "of rounding",
                                 summary.hybrid->relative_error, time.tolerance)});
  return notes;
}

std::string lines_of(const std::vector<Note>& notes) {
  std::string lines;
  for (const Note& note : notes)
    lines += (lines.empty() ? "" : "\n") + note.text;
  return lines;
}

}  // namespace sweepvi::app
