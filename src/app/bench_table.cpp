#include "app/bench_table.hpp"

#include "io/printable.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <nlohmann/json.hpp>
#include <numeric>

namespace sweepvi::app {

namespace {

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const std::size_t half = values.size() / 2;
  return values.size() % 2 == 1 ? values[half] : 0.5 * (values[half - 1] + values[half]);
}

template <class T>
T least(const std::vector<T>& values) {
  return *std::min_element(values.begin(), values.end());
}
template <class T>
T most(const std::vector<T>& values) {
  return *std::max_element(values.begin(), values.end());
}

double mean(const std::vector<std::int64_t>& values) {
  return static_cast<double>(std::accumulate(values.begin(), values.end(), std::int64_t{0})) /
         static_cast<double>(values.size());
}

double matmults_per_step(const BenchRow& row) {
  return median(row.seconds) / median(row.matmult);
}

const char* status(const BenchRow& row) {
  if (!row.failure.empty()) return "failed";
  return row.stopped ? "stopped" : row.certified ? "done" : "done, not certified";
}

/// A line of the table: what it is, and how a setting's number is written.
struct Line {
  const char* name;
  std::function<std::string(const BenchRow&)> text;
};

std::string number(double value) {
  return fmt::format("{:.3g}", value);
}

std::vector<Line> lines(const std::vector<BenchRow>& rows) {
  const auto per_step = [](std::int64_t BenchRow::*count) {
    return [count](const BenchRow& row) {
      return number(static_cast<double>(row.*count) / static_cast<double>(row.steps()));
    };
  };
  std::vector<Line> table = {
      {"seconds per step, median", [](const BenchRow& row) { return number(median(row.seconds)); }},
      {"  least", [](const BenchRow& row) { return number(least(row.seconds)); }},
      {"  most", [](const BenchRow& row) { return number(most(row.seconds)); }},
      {"seconds per MatMult", [](const BenchRow& row) { return number(median(row.matmult)); }},
      {"MatMults per step", [](const BenchRow& row) { return number(matmults_per_step(row)); }}};
  if (rows.size() > 1) {
    const bool comparable = rows.front().done();
    const double first = comparable ? median(rows.front().seconds) : 0.0;
    table.push_back({"  times the first", [=](const BenchRow& row) {
                       return comparable ? number(median(row.seconds) / first) : "-";
                     }});
    table.push_back({"states differ by", [](const BenchRow& row) {
                       return row.difference ? fmt::format("{:.1e}", *row.difference) : "-";
                     }});
  }
  const std::vector<Line> more = {
      {"guessed by", [](const BenchRow& row) { return row.predictor; }},
      {"linear solves per step", per_step(&BenchRow::linear_solves)},
      {"factorizations per step", per_step(&BenchRow::factorizations)},
      {"MUMPS's flops in the last", [](const BenchRow& row) { return number(row.mumps_flops); }},
      {"Newton iterations per step", per_step(&BenchRow::newton_iterations)},
      {"predictor hits per step", per_step(&BenchRow::predictor_hits)},
      {"contacts changed per step", [](const BenchRow& row) { return number(mean(row.changes)); }},
      {"  least", [](const BenchRow& row) { return fmt::format("{}", least(row.changes)); }},
      {"closed contacts", [](const BenchRow& row) { return fmt::format("{:.0f}", row.contacts); }},
      {"worst certificate ratio", [](const BenchRow& row) { return fmt::format("{:.1e}", row.worst_ratio); }},
      {"worst penetration", [](const BenchRow& row) { return number(row.penetration); }},
      {"peak memory of a rank [MB]",
       [](const BenchRow& row) {
         return fmt::format("{:.0f}", 1e-6 * static_cast<double>(row.peak_rss_bytes));
       }},
      {"bytes per unknown", [](const BenchRow& row) { return fmt::format("{:.0f}", row.bytes_per_unknown); }},
      {"seconds of set-up", [](const BenchRow& row) { return number(median(row.setup)); }},
      {"seconds of warm-up", [](const BenchRow& row) { return number(median(row.warmup)); }}};
  table.insert(table.end(), more.begin(), more.end());
  if (std::any_of(rows.begin(), rows.end(), [](const BenchRow& row) { return row.stopped; }))
    table.push_back({"timed steps until it was stopped", [](const BenchRow& row) {
                       return row.stopped ? fmt::format("{}", row.steps()) : "all";
                     }});
  return table;
}

}  // namespace

std::string table_text(const std::vector<BenchRow>& rows) {
  std::vector<std::vector<std::string>> cells;
  if (rows.size() > 1) {
    cells.push_back({""});
    for (const BenchRow& row : rows)
      cells.back().push_back(printable(row.setting.name));
  }
  if (std::any_of(rows.begin(), rows.end(), [](const BenchRow& row) { return row.done(); }))
    for (const Line& line : lines(rows)) {
      cells.push_back({line.name});
      for (const BenchRow& row : rows)
        cells.back().push_back(row.done() ? line.text(row) : status(row));
    }
  std::vector<std::size_t> width(rows.size() + 1, 0);
  for (const std::vector<std::string>& line : cells)
    for (std::size_t i = 0; i < line.size(); ++i)
      width[i] = std::max(width[i], line[i].size());
  std::string text;
  for (const std::vector<std::string>& line : cells) {
    text += fmt::format("{:<{}}", line.front(), width.front());
    for (std::size_t i = 1; i < line.size(); ++i)
      text += fmt::format("  {:>{}}", line[i], width[i]);
    text += '\n';
  }
  for (const BenchRow& row : rows)
    if (!row.failure.empty())
      text += fmt::format("{} failed: {}\n", printable(row.setting.name), printable(row.failure));
  return text;
}

std::string row_json(const BenchRow& row) {
  nlohmann::ordered_json json;
  json["setting"] = row.setting.name;
  json["options"] = row.setting.words();
  json["status"] = status(row);
  json["failure"] =
      row.failure.empty() ? nlohmann::ordered_json(nullptr) : nlohmann::ordered_json(row.failure);
  json["steps"] = row.steps();
  const auto put = [&](const char* name, const auto& value) {  // a setting without steps has no numbers
    json[name] = row.done() ? nlohmann::ordered_json(value()) : nlohmann::ordered_json(nullptr);
  };
  put("h", [&] { return row.h; });
  put("seconds_setup", [&] { return median(row.setup); });
  put("seconds_warmup", [&] { return median(row.warmup); });
  put("seconds_stepping", [&] { return std::accumulate(row.seconds.begin(), row.seconds.end(), 0.0); });
  put("seconds_per_step", [&] { return median(row.seconds); });
  put("seconds_least", [&] { return least(row.seconds); });
  put("seconds_most", [&] { return most(row.seconds); });
  put("matmult_seconds", [&] { return median(row.matmult); });
  put("matmults_per_step", [&] { return matmults_per_step(row); });
  put("form", [&] { return row.form; });
  put("unknowns", [&] { return row.unknowns; });
  put("constraints", [&] { return row.constraints; });
  put("jacobian_nonzeros", [&] { return row.jacobian_nonzeros; });
  put("edge_cut", [&] { return row.edge_cut; });
  put("snes_type", [&] { return row.snes_type; });
  put("predictor", [&] { return row.predictor; });
  put("snes_iterations", [&] { return row.newton_iterations; });
  put("predictor_hits", [&] { return row.predictor_hits; });
  put("factorizations", [&] { return row.factorizations; });
  put("linear_solves", [&] { return row.linear_solves; });
  put("mumps_flops", [&] { return row.mumps_flops; });
  put("active_changes", [&] {
    return std::count_if(row.changes.begin(), row.changes.end(), [](std::int64_t n) { return n > 0; });
  });
  put("contact_changes", [&] { return mean(row.changes); });
  put("contact_changes_least", [&] { return least(row.changes); });
  put("closed_contacts", [&] { return row.contacts; });
  for (std::size_t i = 0; i < row.rungs.size(); ++i)
    json["rungs"][StepSolver::rung_names[i]] = row.rungs[i];
  put("max_residual", [&] { return row.worst_ratio; });
  put("max_penetration", [&] { return row.penetration; });
  put("states_differ", [&] {
    return row.difference ? nlohmann::ordered_json(*row.difference) : nlohmann::ordered_json(nullptr);
  });
  put("peak_rss_bytes", [&] { return row.peak_rss_bytes; });
  put("bytes_per_unknown", [&] { return row.bytes_per_unknown; });
  return json.dump();
}

}  // namespace sweepvi::app
