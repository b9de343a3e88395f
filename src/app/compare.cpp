#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "app/file_head.hpp"
#include "app/options.hpp"
#include "app/summary.hpp"
#include "app/verbs.hpp"
#include "io/recorded.hpp"
#include "sweepvi/filled_graph.hpp"
#include "sweepvi/trajectory_error.hpp"

namespace sweepvi::app {

namespace {

/// All that is said about two runs.
struct Comparison {
  double largest = 0.0;  // |x| of both
  GraphDistance graphs;
  TrajectoryError errors;
  EventErrors events;
  bool events_known = false;     // by both
  std::vector<double> measures;  // by level: largest difference of a constraint's sums; empty: unknown
};

std::string blocks_of(const Recorded& file) {
  if (!file.elements) return "all elements";
  return fmt::format(
      "{} (/element)",
      fmt::join(file.elements->begin(),
                file.elements->begin() + std::min<std::ptrdiff_t>(std::ssize(*file.elements), 10), ", "));
}

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

nlohmann::ordered_json about(const Recorded& file) {
  const std::vector<double>& t = file.trajectory->t();
  return {{"file", file.path}, {"rows", t.size()}, {"start", t.front()}, {"end", t.back()}};
}

std::string json_text(const Recorded& a, const Recorded& b, const Comparison& found, int ranks,
                      double seconds, const std::vector<std::string>& unused) {
  nlohmann::ordered_json json;
  json["exit"] = 0;
  json["status"] = "done";
  json["a"] = about(a);
  json["b"] = about(b);
  json["components"] = a.trajectory->components();
  json["largest_entry"] = found.largest;
  json["hausdorff"] = {{"value", found.graphs.value},
                       {"tolerance", found.graphs.tolerance},
                       {"t", found.graphs.t},
                       {"of", found.graphs.first ? "a" : "b"}};
  json["start"] = found.errors.start;
  json["end"] = found.errors.end;
  if (found.errors.sup)
    json["sup"] = {
        {"value", *found.errors.sup}, {"t", found.errors.sup_t}, {"left_out", found.errors.left_out}};
  else
    json["sup"] = {{"value", nullptr}, {"t", nullptr}, {"left_out", found.errors.left_out}};
  json["l1"] = found.errors.l1;
  json["final"] = found.errors.final;
  json["events"] = nullptr;
  if (found.events_known) {
    json["events"] = {{"matched", found.events.matched},
                      {"unmatched_a", found.events.unmatched_a},
                      {"unmatched_b", found.events.unmatched_b},
                      {"largest_difference", nullptr},
                      {"t", nullptr}};
    if (found.events.matched > 0) {
      json["events"]["largest_difference"] = found.events.largest;
      json["events"]["t"] = found.events.t;
    }
  }
  json["measures"] = nullptr;
  if (!found.measures.empty()) json["measures"] = found.measures;
  json["ranks"] = ranks;
  json["seconds_total"] = seconds;
  json["unused_options"] = unused;
  return json.dump(2) + "\n";
}

std::string events_text(const EventErrors& events) {
  std::string text = fmt::format("{} pairs of events", events.matched);
  if (events.matched > 0)
    text = "largest difference, s, of " + text + fmt::format("; at t = {:g} s", events.t);
  return text + fmt::format("; without a partner: {} of A, {} of B", events.unmatched_a, events.unmatched_b);
}

void print(const Recorded& a, const Recorded& b, const Comparison& found) {
  for (const auto& [name, file] : {std::pair{"A", &a}, {"B", &b}})
    fmt::print("{}: {}, {} rows from {:g} s to {:g} s\n", name, file->path, file->trajectory->rows(),
               file->trajectory->t().front(), file->trajectory->t().back());
  fmt::print("{} of {} components; largest |x| {:g}; at equal times: from {:g} s to {:g} s\n\n",
             a.trajectory->components(), a.columns, found.largest, found.errors.start, found.errors.end);
  const auto line = [](const std::string& name, const std::optional<double>& value, const std::string& text) {
    fmt::print("{:<20}  {:>11}  {}\n", name, value ? fmt::format("{:.5g}", *value) : "-", text);
  };
  const GraphDistance& graphs = found.graphs;
  line("Hausdorff distance", graphs.value,
       fmt::format(
           "of the filled graphs, d = max(|t - s|, ||x - y||_2), at most {:.2g} more; {} at t = {:g} s",
           graphs.tolerance, graphs.first ? "A" : "B", graphs.t));
  line("sup error", found.errors.sup,
       fmt::format("largest ||x_A - x_B||_2 away from events{}; {:.3g} % of the time left out",
                   found.errors.sup ? fmt::format(", at t = {:g} s", found.errors.sup_t) : "",
                   100.0 * found.errors.left_out));
  line("L1 error", found.errors.l1, "integral of ||x_A - x_B||_2 dt");
  line("final error", found.errors.final, fmt::format("||x_A - x_B||_2 at t = {:g} s", found.errors.end));
  if (found.events_known)
    line("event times", found.events.matched > 0 ? std::optional(found.events.largest) : std::nullopt,
         events_text(found.events));
  else
    line("event times", std::nullopt, "not in both files");
  for (std::size_t i = 0; i < found.measures.size(); ++i)
    line(fmt::format("measures, level {}", i + 1), found.measures[i],
         i == 0 ? "largest difference of a constraint's sum of /mu over the run" : "the same");
  if (found.measures.empty()) line("measures", std::nullopt, "not alike in both files");
}

}  // namespace

ExitCode compare(MPI_Comm comm, const CommandLine& line) {
  const double begin = MPI_Wtime();
  int rank = 0, ranks = 1;
  MPI_Comm_rank(comm, &rank);
  MPI_Comm_size(comm, &ranks);
  if (line.summary) {
    for (const std::string& file : {line.scene, line.other})
      check_distinct(comm, {{"a file to compare", file}, {"--summary", *line.summary}});
    check_writable(comm, *line.summary, true);
  }
  const Recorded a = read_recorded(comm, line.scene, line.components);
  const Recorded b = read_recorded(comm, line.other, line.components);
  check_alike(a, b);
  const double largest = std::max(largest_entry(comm, *a.trajectory), largest_entry(comm, *b.trajectory));
  const Comparison found = measure(comm, a, b, largest, line.tolerance);
  const std::vector<std::string> unused = report_unused_options(comm);
  if (line.summary)
    write_text(comm, *line.summary, json_text(a, b, found, ranks, MPI_Wtime() - begin, unused));
  if (rank == 0) print(a, b, found);
  return ExitCode::done;
}

}  // namespace sweepvi::app
