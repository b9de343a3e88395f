// Which event of one run is which of the other.
#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>

#include "sweepvi/trajectory_error.hpp"

namespace sweepvi {

namespace {

using Times = std::vector<double>;

/// Times of events of one kind, in order.
std::map<std::tuple<std::int64_t, bool, int>, Times> sorted(const std::vector<EventTime>& events) {
  std::map<std::tuple<std::int64_t, bool, int>, Times> kinds;
  for (const EventTime& event : events)  // a lift-off is from all levels
    kinds[{event.constraint, event.impact, event.impact ? event.level : 0}].push_back(event.t);
  for (auto& [kind, times] : kinds)
    std::sort(times.begin(), times.end());
  return kinds;
}

/// For each of the fewer the one of the more that it is paired with. least[s] is the least sum of differences
/// for the first i of the fewer and at most i + s of the more.
std::vector<std::size_t> pairs(const Times& few, const Times& many) {
  constexpr double most = 1e8;
  const std::size_t spare = many.size() - few.size();
  std::vector<std::size_t> partner(few.size());
  if (static_cast<double>(few.size()) * static_cast<double>(spare + 1) > most || spare == 0) {
    for (std::size_t i = 0; i < few.size(); ++i)
      partner[i] = i;
    return partner;
  }
  std::vector<double> least(spare + 1, 0.0);
  std::vector<bool> skipped(few.size() * (spare + 1));  // the last of them is left over
  for (std::size_t i = 0; i < few.size(); ++i) {
    for (std::size_t s = 0; s <= spare; ++s) {
      least[s] += std::abs(few[i] - many[i + s]);
      if (s > 0 && least[s - 1] <= least[s]) {
        least[s] = least[s - 1];
        skipped[i * (spare + 1) + s] = true;
      }
    }
  }
  std::size_t s = spare;
  for (std::size_t i = few.size(); i-- > 0;) {
    while (skipped[i * (spare + 1) + s])
      --s;
    partner[i] = i + s;
  }
  return partner;
}

}  // namespace

EventErrors compare_events(const std::vector<EventTime>& a, const std::vector<EventTime>& b) {
  const auto kinds_a = sorted(a);
  auto kinds_b = sorted(b);
  for (const auto& [kind, times] : kinds_a)
    kinds_b[kind];  // so that all kinds are there
  EventErrors errors;
  for (const auto& [kind, of_b] : kinds_b) {
    const auto at = kinds_a.find(kind);
    const Times of_a = at == kinds_a.end() ? Times{} : at->second;
    const bool fewer = of_a.size() <= of_b.size();  // in the first
    const Times &few = fewer ? of_a : of_b, &many = fewer ? of_b : of_a;
    (fewer ? errors.unmatched_b : errors.unmatched_a) += many.size() - few.size();
    errors.matched += few.size();
    const std::vector<std::size_t> partner = pairs(few, many);
    std::size_t left = 0;  // of the more
    for (std::size_t i = 0; i <= few.size(); ++i) {
      for (const std::size_t next = i < few.size() ? partner[i] : many.size(); left < next; ++left)
        errors.spans.push_back({many[left], many[left]});
      if (i == few.size()) break;
      const auto [first, last] = std::minmax(few[i], many[left++]);
      errors.spans.push_back({first, last});
      if (last - first <= errors.largest) continue;
      errors.largest = last - first;
      errors.t = fewer ? few[i] : many[left - 1];
    }
  }
  std::sort(errors.spans.begin(), errors.spans.end(),
            [](const TimeSpan& p, const TimeSpan& q) { return p.first < q.first; });
  return errors;
}

}  // namespace sweepvi
