#include "app/study_table.hpp"

#include "io/printable.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

namespace sweepvi::app {

namespace {

using Number = std::optional<double>;

/// A number of a row, under the name that CSV and JSON have for it.
struct Entry {
  const char* name;
  Number value;
};

/// Everything but texts, in the order of the CSV file.
std::vector<Entry> entries(const StudyRow& row) {
  const bool done = row.failure.empty();
  const auto real = [&](double value) { return done ? Number(value) : std::nullopt; };
  const auto count = [&](auto value) { return real(static_cast<double>(value)); };
  const Comparison& found = row.found;
  const bool events = done && found.events_known;
  return {{"h", row.h},
          {"tolerance", row.tolerance},
          {"final", real(found.errors.final)},
          {"final_order", row.final_order},
          {"hausdorff", real(found.graphs.value)},
          {"hausdorff_order", row.hausdorff_order},
          {"sup", done ? found.errors.sup : std::nullopt},
          {"sup_left_out", real(found.errors.left_out)},
          {"by_component", done ? found.errors.relative : std::nullopt},
          {"l1", real(found.errors.l1)},
          {"events", events && found.events.matched > 0 ? Number(found.events.largest) : std::nullopt},
          {"events_unmatched",
           events ? count(found.events.unmatched_a + found.events.unmatched_b) : std::nullopt},
          {"seconds", real(row.seconds)},
          {"seconds_min", real(row.seconds_min)},
          {"seconds_max", real(row.seconds_max)},
          {"steps", count(row.steps)},
          {"steps_in_parts", count(row.steps_in_parts)},
          {"linear_solves", count(row.linear_solves)},
          {"newton_iterations", count(row.newton_iterations)},
          {"matmults_per_step", real(row.matmults_per_step)}};
}

Number order(double coarse, double fine, double h_coarse, double h_fine) {
  const double order = std::log(coarse / fine) / std::log(h_coarse / h_fine);
  return coarse > 0.0 && fine > 0.0 && h_coarse != h_fine ? Number(order) : std::nullopt;
}

std::string quoted(const std::string& text) {
  std::string result = "\"";
  for (const char c : text)
    result += c == '"' ? std::string("\"\"") : std::string(1, c == '\n' ? ' ' : c);
  return result + '"';
}

const char* status(const StudyRow& row) {
  return !row.failure.empty() ? "failed" : row.certified ? "done" : "done, not certified";
}

std::string text_of(const Number& value, const char* format) {
  return value ? fmt::format(fmt::runtime(format), *value) : "-";
}

std::vector<std::string> cells(const StudyRow& row, bool several_settings, bool tolerances) {
  std::vector<std::string> line = {row.run.scheme};
  if (several_settings) line.push_back(printable(row.run.setting.name));
  line.push_back(fmt::format("{:.3g}", row.h));
  if (tolerances) line.push_back(text_of(row.tolerance, "{:.0e}"));
  if (!row.failure.empty()) return line;
  const Comparison& found = row.found;
  const bool events = found.events_known && found.events.matched > 0;
  line.push_back(fmt::format("{:.3e}", found.errors.final));
  line.push_back(text_of(row.final_order, "{:.2f}"));
  line.push_back(fmt::format("{:.3e}", found.graphs.value));
  line.push_back(text_of(row.hausdorff_order, "{:.2f}"));
  line.push_back(text_of(found.errors.sup, "{:.3e}"));
  line.push_back(fmt::format("{:.3e}", found.errors.l1));
  line.push_back(text_of(events ? Number(found.events.largest) : std::nullopt, "{:.1e}"));
  const std::size_t alone = found.events.unmatched_a + found.events.unmatched_b;
  if (found.events_known && alone > 0) line.back() += fmt::format(" +{}", alone);
  line.push_back(fmt::format("{:.3g}", row.seconds));
  line.push_back(fmt::format("{:.3g}..{:.3g}", row.seconds_min, row.seconds_max));
  line.push_back(fmt::format("{}", row.steps));
  if (!row.certified) line.back() += " (not certified)";
  if (row.steps_in_parts > 0) line.back() += fmt::format(" ({} in parts)", row.steps_in_parts);
  line.push_back(fmt::format("{}", row.linear_solves));
  line.push_back(fmt::format("{}", row.newton_iterations));
  line.push_back(fmt::format("{:.0f}", row.matmults_per_step));
  return line;
}

}  // namespace

void find_orders(std::vector<StudyRow>& rows) {
  for (std::size_t i = 1; i < rows.size(); ++i) {
    const StudyRow& last = rows[i - 1];
    StudyRow& row = rows[i];
    const bool alike = last.run.scheme == row.run.scheme && last.run.setting.name == row.run.setting.name;
    const bool both = last.failure.empty() && row.failure.empty();
    if (!alike || !both || row.tolerance) continue;  // the step of hybrid is only that of its rows
    row.final_order = order(last.found.errors.final, row.found.errors.final, last.h, row.h);
    row.hausdorff_order = order(last.found.graphs.value, row.found.graphs.value, last.h, row.h);
  }
}

std::string table_text(const std::vector<StudyRow>& rows, bool several_settings) {
  const bool tolerances =
      std::any_of(rows.begin(), rows.end(), [](const StudyRow& row) { return row.tolerance.has_value(); });
  std::vector<std::string> head = {"scheme"};
  if (several_settings) head.emplace_back("setting");
  head.emplace_back("h [s]");
  if (tolerances) head.emplace_back("tolerance");
  for (const char* name : {"final", "order", "Hausdorff", "order", "sup", "L1", "events [s]", "seconds",
                           "min..max", "steps", "solves", "Newton", "MatMults/step"})
    head.emplace_back(name);
  std::vector<std::vector<std::string>> lines = {head};
  for (const StudyRow& row : rows)
    lines.push_back(cells(row, several_settings, tolerances));
  std::vector<std::size_t> width(head.size(), 0);
  for (const std::vector<std::string>& line : lines)
    for (std::size_t i = 0; i < line.size(); ++i)
      width[i] = std::max(width[i], line[i].size());

  const std::size_t names = several_settings ? 2 : 1;
  std::string text;
  for (std::size_t k = 0; k < lines.size(); ++k) {
    std::string line;
    for (std::size_t i = 0; i < lines[k].size(); ++i)
      line += fmt::format(fmt::runtime(i < names ? "{:<{}}  " : "{:>{}}  "), lines[k][i], width[i]);
    if (k > 0 && !rows[k - 1].failure.empty()) line += "failed: " + rows[k - 1].failure;
    text += line.substr(0, line.find_last_not_of(' ') + 1) + "\n";
  }
  return text;
}

std::string csv_text(const std::vector<StudyRow>& rows) {
  std::string text = "scheme,setting,options,status";
  for (const Entry& entry : entries({}))
    text += fmt::format(",{}", entry.name);
  text += ",failure\n";
  for (const StudyRow& row : rows) {
    text += fmt::format("{},{},{},{}", row.run.scheme, quoted(row.run.setting.name),
                        quoted(row.run.setting.words()), status(row));
    for (const Entry& entry : entries(row))
      text += entry.value ? fmt::format(",{}", *entry.value) : ",";
    text += fmt::format(",{}\n", quoted(row.failure));
  }
  return text;
}

std::string rows_json(const std::vector<StudyRow>& rows) {
  nlohmann::ordered_json json = nlohmann::ordered_json::array();
  for (const StudyRow& row : rows) {
    nlohmann::ordered_json one = {{"scheme", row.run.scheme},
                                  {"setting", row.run.setting.name},
                                  {"options", row.run.setting.words()},
                                  {"status", status(row)}};
    for (const Entry& entry : entries(row))
      one[entry.name] = entry.value ? nlohmann::ordered_json(*entry.value) : nlohmann::ordered_json(nullptr);
    one["failure"] = nullptr;
    if (!row.failure.empty()) one["failure"] = row.failure;
    json.push_back(std::move(one));
  }
  return json.dump();
}

}  // namespace sweepvi::app
