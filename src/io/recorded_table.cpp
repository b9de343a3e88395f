// A trajectory in comma-separated numbers.
#include <cmath>
#include <fstream>
#include <string_view>

#include "io/decimal.hpp"
#include "io/recorded.hpp"
#include "parallel/memory.hpp"
#include "sweepvi/error.hpp"

namespace sweepvi {

namespace {

std::string_view trimmed(std::string_view text) {
  const std::size_t first = text.find_first_not_of(" \t\r");
  return first == std::string_view::npos ? ""
                                         : text.substr(first, text.find_last_not_of(" \t\r") - first + 1);
}

std::vector<std::string_view> cells(std::string_view line) {
  std::vector<std::string_view> found;
  for (std::size_t comma = 0; comma != std::string_view::npos; line.remove_prefix(comma + 1)) {
    comma = line.find(',');
    found.push_back(trimmed(line.substr(0, comma)));
    if (comma == std::string_view::npos) break;
  }
  return found;
}

double number(std::string_view cell, const std::string& where) {
  const std::optional<double> value = decimal(cell);
  if (!value || !std::isfinite(*value))
    throw InputError(where + "'" + std::string(cell) + "' is not a finite number");
  return *value;
}

}  // namespace

Recorded read_table(const std::string& path, const std::vector<std::int64_t>& columns) {
  std::ifstream file(path);
  if (!file) throw InputError(path + " cannot be read; check its permissions");
  std::string line;
  std::getline(file, line);
  const std::vector<std::string_view> head = cells(line);
  if (head.front() != "t" || head.size() < 2)
    throw InputError(path + ":1: a table of a trajectory begins with a line 't,name,...', found '" +
                     line.substr(0, 60) + "'");
  const std::size_t width = head.size() - 1;
  check_columns(path, columns, width);
  std::vector<double> t, x;
  for (std::size_t number_of_line = 2; std::getline(file, line); ++number_of_line) {
    if (trimmed(line).empty()) continue;
    const std::string where = path + ":" + std::to_string(number_of_line) + ": ";
    const std::vector<std::string_view> row = cells(line);
    if (row.size() != width + 1)
      throw InputError(where + "expected " + std::to_string(width + 1) + " numbers, as in line 1, found " +
                       std::to_string(row.size()));
    if (x.capacity() == x.size())  // the vector will double
      require_memory(16.0 * static_cast<double>(x.size()), path + ": its numbers take");
    const double time = number(row[0], where);
    if (!t.empty() && time < t.back())
      throw InputError(where + "the time decreases, from " + std::to_string(t.back()) + " s to " +
                       std::to_string(time) + " s");
    t.push_back(time);
    if (columns.empty())
      for (std::size_t i = 1; i <= width; ++i)
        x.push_back(number(row[i], where));
    for (const std::int64_t column : columns)
      x.push_back(number(row[static_cast<std::size_t>(column) + 1], where));
  }
  if (t.empty()) throw InputError(path + " has no rows; a trajectory has one at least");
  Recorded recorded;
  recorded.trajectory = std::make_unique<StoredTrajectory>(std::move(t), std::move(x));
  recorded.columns = width;
  return recorded;
}

}  // namespace sweepvi
