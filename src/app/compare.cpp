#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "app/comparison.hpp"
#include "app/file_head.hpp"
#include "app/options.hpp"
#include "app/summary.hpp"
#include "app/verbs.hpp"
#include "io/printable.hpp"
#include "io/recorded.hpp"

namespace sweepvi::app {

namespace {

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
  json["by_component"] = {{"value", nullptr}, {"component", nullptr}};
  if (found.errors.relative)
    json["by_component"] = {{"value", *found.errors.relative}, {"component", found.worst_component}};
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
    fmt::print("{}: {}, {} rows from {:g} s to {:g} s\n", name, printable(file->path),
               file->trajectory->rows(), file->trajectory->t().front(), file->trajectory->t().back());
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
  line("by component", found.errors.relative,
       fmt::format("largest |x_A - x_B| of a component, over its own largest |x|{}",
                   found.errors.relative ? fmt::format("; component {}", found.worst_component) : ""));
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
  Comparison found = measure(comm, a, b, largest, line.tolerance);
  found.worst_component = static_cast<std::int64_t>(found.errors.relative_component);
  if (!line.components.empty()) found.worst_component = line.components[found.errors.relative_component];
  const std::vector<std::string> unused = report_unused_options(comm);
  if (line.summary)
    write_text(comm, *line.summary, json_text(a, b, found, ranks, MPI_Wtime() - begin, unused));
  if (rank == 0) print(a, b, found);
  return ExitCode::done;
}

}  // namespace sweepvi::app
