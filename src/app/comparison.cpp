#include "app/comparison.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "sweepvi/error.hpp"

namespace sweepvi::app {

namespace {

std::string blocks_of(const Recorded& file) {
  if (!file.elements) return "all elements";
  return fmt::format(
      "{} (/element)",
      fmt::join(file.elements->begin(),
                file.elements->begin() + std::min<std::ptrdiff_t>(std::ssize(*file.elements), 10), ", "));
}

}  // namespace

void check_alike(const Recorded& a, const Recorded& b) {
  if (a.columns != b.columns)
    throw InputError(
        fmt::format("{} has states of {} numbers, {} of {}; only runs with states alike can be "
                    "compared",
                    a.path, a.columns, b.path, b.columns));
  if (a.run && b.run && a.elements != b.elements)
    throw InputError(fmt::format("{} holds {}, {} holds {}; record the same output.blocks in both", a.path,
                                 blocks_of(a), b.path, blocks_of(b)));
  const std::vector<double>&s = a.trajectory->t(), &t = b.trajectory->t();
  if (std::max(s.front(), t.front()) > std::min(s.back(), t.back()))
    throw InputError(
        fmt::format("{} is from {:g} s to {:g} s, {} from {:g} s to {:g} s: they have no time in "
                    "common",
                    a.path, s.front(), s.back(), b.path, t.front(), t.back()));
}

namespace {

std::vector<EventTime> times_of(const Recorded& file) {
  std::vector<EventTime> times;
  if (file.events)
    for (const Event& event : *file.events)
      times.push_back({event.t, event.constraint, event.level, event.kind == Event::Kind::impact});
  return times;
}

std::vector<double> difference(const std::optional<MeasureSums>& a, const std::optional<MeasureSums>& b) {
  if (!a || !b || a->levels != b->levels || a->sums.size() != b->sums.size()) return {};
  std::vector<double> largest(a->levels, 0.0);
  for (std::size_t i = 0; i < a->sums.size(); ++i)
    largest[i % a->levels] = std::max(largest[i % a->levels], std::abs(a->sums[i] - b->sums[i]));
  return largest;
}

/// To three digits, unless the user asks for something else. Where the distance is small a second look is
/// needed, for which the first one says how close.
GraphDistance graph_distance(MPI_Comm comm, Trajectory& a, Trajectory& b, double largest,
                             const std::optional<double>& tolerance) {
  constexpr double digits = 1e-3, coarse = 1e-6, rounding = 1e-14;
  if (tolerance) return filled_graph_distance(comm, a, b, *tolerance);
  const double size = largest > 0.0 ? largest : 1.0;
  const GraphDistance first = filled_graph_distance(comm, a, b, coarse * size);
  const double wanted = std::max(digits * first.value, rounding * size);
  return wanted < first.tolerance ? filled_graph_distance(comm, a, b, wanted) : first;
}

}  // namespace

Comparison measure(MPI_Comm comm, const Recorded& a, const Recorded& b, double largest,
                   const std::optional<double>& tolerance) {
  Comparison found;
  found.largest = largest;
  found.events = compare_events(times_of(a), times_of(b));
  found.events_known = a.events && b.events;
  found.measures = difference(a.measures, b.measures);
  try {
    found.errors = trajectory_error(comm, *a.trajectory, *b.trajectory, found.events.spans);
    found.graphs = graph_distance(comm, *a.trajectory, *b.trajectory, largest, tolerance);
  } catch (const Error& error) {
    // All rows have been read once: this is the disk, perhaps on this rank alone, and others wait for it.
    throw Error(ExitCode::internal, fmt::format("{}; it could be read before", error.what()));
  }
  return found;
}

}  // namespace sweepvi::app
