// The part of TomlValue that knows signals, vectors and matrices, and what goes with reading any document.

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>

#include "io/matrix_file.hpp"
#include "io/toml_table.hpp"
#include "sweepvi/error.hpp"

namespace sweepvi {

Signal TomlValue::signal() const {
  double phase_spread = 0.0;
  const Signal found = signal(phase_spread);
  if (is_table() && (*this)["phase_spread"])
    (*this)["phase_spread"].fail(
        "spreads the phase of a chain's force over its elements, where one signal is given for all of them; "
        "leave it out, and write the phase itself");
  return found;
}

Signal TomlValue::signal(double& phase_spread) const {
  if (is_table()) {
    const TomlValue offset = (*this)["offset"], amplitude = (*this)["amplitude"],
                    frequency = (*this)["frequency"], phase = (*this)["phase"],
                    spread = (*this)["phase_spread"];
    refuse_unknown();
    phase_spread = spread.number_or(0.0);
    return {offset.number_or(0.0), amplitude.number(), frequency.number(), phase.number_or(0.0)};
  }
  if (!is_number()) fail_kind("a number or {offset, amplitude, frequency, phase}");
  return {number(), 0.0, 0.0, 0.0};
}

template <class Read>
auto TomlValue::read_file(Read&& read) const -> decltype(read(std::string(), std::string())) {
  std::string file;
  std::string dataset;
  if (is_string()) {
    file = path();
  } else {
    const TomlValue file_key = (*this)["file"], dataset_key = (*this)["dataset"];
    refuse_unknown();
    file = file_key.path();
    dataset = dataset_key.string_or("");
  }
  if (elsewhere()) return {};
  std::string objection;
  std::optional<std::string> choice;
  try {
    if (!is_string() && dataset.empty()) choice = datasets_to_choose_from(file);
    if (is_string() && !file.ends_with(".mtx")) objection = why_no_matrix_file(file);
    if (objection.empty() && !choice) return read(file, dataset);
  } catch (const Error& error) {
    throw Error(error.code(), fmt::format("{}: {}: {}", where(), name_, error.what()));
  }
  if (choice) (*this)["dataset"].fail("is missing; expected a string" + *choice);
  fail(fmt::format(
      "= \"{}\"; expected a MatrixMarket file, \"name.mtx\", one of NumPy (.npy, .npz) or of PETSc's binary "
      "viewer, or {{file=\"name.h5\", dataset=\"/name\"}}; {}",
      string(), objection));
}

std::vector<double> TomlValue::read_numbers(bool infinity) const {
  if (names_file()) {
    auto values = read_file([infinity](const std::string& file, const std::string& dataset) {
      return read_vector_file(file, dataset, infinity);
    });
    for (std::size_t i = 0; i < values.size(); ++i)
      if (std::isnan(values[i]) || (std::isinf(values[i]) && !infinity))
        fail(fmt::format("has entry {} = {} in its file; expected {}", i, values[i],
                         infinity ? "numbers" : "finite numbers"));
    return values;
  }
  if (!is_array()) fail_kind("an array of numbers or a file");
  std::vector<double> values(size());
  for (std::size_t i = 0; i < values.size(); ++i) {
    const std::optional<double> plain = plain_number(i);
    values[i] = plain ? *plain : entry(i).checked(infinity);
  }
  return values;
}

std::vector<double> TomlValue::numbers() const {
  return read_numbers(false);
}
std::vector<double> TomlValue::numbers_or_infinity() const {
  return read_numbers(true);
}

std::vector<Signal> TomlValue::signals() const {
  return read_signals(false);
}
std::vector<Signal> TomlValue::signals_or_infinity() const {
  return read_signals(true);
}

std::vector<Signal> TomlValue::read_signals(bool infinity) const {
  std::vector<Signal> signals;
  if (names_file()) {
    for (const double value : read_numbers(infinity))
      signals.push_back({value, 0.0, 0.0, 0.0});
    return signals;
  }
  if (!is_array()) fail_kind("an array of numbers and signals, or a file");
  signals.reserve(size());
  for (std::size_t i = 0; i < size(); ++i) {
    const std::optional<double> plain = plain_number(i);
    if (plain) {
      signals.push_back({*plain, 0.0, 0.0, 0.0});
    } else if (const TomlValue signal = entry(i); infinity && signal.is_number()) {
      signals.push_back({signal.number_or_infinity(), 0.0, 0.0, 0.0});
    } else {
      signals.push_back(signal.signal());
    }
  }
  return signals;
}

SparseEntries TomlValue::matrix() const {
  if (names_file()) {
    auto entries = read_file(
        [](const std::string& file, const std::string& dataset) { return read_matrix_file(file, dataset); });
    for (const double value : entries.values)
      if (!std::isfinite(value))
        fail(fmt::format("has an entry {} in its file; expected finite numbers", value));
    return entries;
  }
  if (!is_array()) fail_kind("rows of numbers, [[1, 2], [3, 4]], or a file");
  SparseEntries entries;
  entries.row_starts.assign(1, 0);
  std::size_t columns = 0;
  for (std::size_t i = 0; i < size(); ++i) {
    const TomlValue row = entry(i);
    if (!row.is_array()) row.fail_kind("a row of numbers: a matrix is written [[1, 2], [3, 4]]");
    const std::vector<double> values = row.numbers();
    if (i == 0) columns = values.size();
    if (values.size() != columns)
      row.fail(fmt::format("has {} entries, but row 0 has {}; rows of a matrix have one length",
                           values.size(), columns));
    for (std::size_t j = 0; j < columns; ++j) {
      if (values[j] == 0.0) continue;
      entries.columns.push_back(static_cast<decltype(entries.columns)::value_type>(j));
      entries.values.push_back(values[j]);
    }
    entries.row_starts.push_back(
        static_cast<decltype(entries.row_starts)::value_type>(entries.values.size()));
  }
  entries.rows = static_cast<decltype(entries.rows)>(size());
  entries.cols = static_cast<decltype(entries.cols)>(columns);
  return entries;
}

namespace {

/// Edits, swapped neighbours included, cost 2; a change of case, or of - into _, 1.
int edit_distance(std::string_view a, std::string_view b) {
  const auto substitution = [](unsigned char x, unsigned char y) {
    if (x == y) return 0;
    const bool dashes = (x == '-' || x == '_') && (y == '-' || y == '_');
    return dashes || std::tolower(x) == std::tolower(y) ? 1 : 2;
  };
  const auto letter = [](std::string_view word, std::size_t i) {
    return static_cast<unsigned char>(word[i - 1]);
  };
  std::vector<int> before_last(b.size() + 1), last(b.size() + 1), row(b.size() + 1);
  for (std::size_t i = 0; i <= a.size(); ++i) {
    row[0] = 2 * static_cast<int>(i);
    for (std::size_t j = 1; j <= b.size(); ++j) {
      row[j] = row[j - 1] + 2;
      if (i == 0) continue;
      row[j] = std::min({row[j], last[j] + 2, last[j - 1] + substitution(letter(a, i), letter(b, j))});
      if (i > 1 && j > 1 && letter(a, i) == letter(b, j - 1) && letter(a, i - 1) == letter(b, j))
        row[j] = std::min(row[j], before_last[j - 2] + 2);
    }
    before_last = std::exchange(last, row);
  }
  return last[b.size()];
}

}  // namespace

std::string nearest_name(std::string_view name, const std::vector<std::string>& known) {
  return known.empty() ? ""
                       : *std::min_element(known.begin(), known.end(), [&](const auto& a, const auto& b) {
                           return edit_distance(name, a) < edit_distance(name, b);
                         });
}

std::string suggestion(std::string_view name, const std::vector<std::string>& known) {
  if (known.empty()) return "";
  const std::string nearest = nearest_name(name, known);
  const int length = static_cast<int>(std::max(name.size(), nearest.size()));
  // One edit per three letters, and something in common: farther names are no slip of the finger.
  if (edit_distance(name, nearest) <= 2 * ((length + 2) / 3) && edit_distance(name, nearest) < 2 * length)
    return fmt::format("; did you mean '{}'?", nearest);
  return fmt::format("; known: {}", fmt::join(known, ", "));
}

std::string read_text(const std::string& path) {
  constexpr std::size_t limit = 1U << 30U;  // MPI counts with int, and data of that size belong into files
  std::error_code ignored;
  if (std::filesystem::is_directory(path, ignored))
    throw InputError(fmt::format("{}: is a folder; expected a TOML file", path));
  errno = 0;
  std::ifstream file(path, std::ios::binary);
  if (!file) throw InputError(fmt::format("{}: cannot be opened: {}", path, std::strerror(errno)));
  std::string text;
  std::vector<char> block(1U << 16U);
  while (file.read(block.data(), static_cast<std::streamsize>(block.size())) || file.gcount() > 0) {
    text.append(block.data(), static_cast<std::size_t>(file.gcount()));
    if (text.size() > limit)
      throw InputError(
          fmt::format("{}: is longer than 1 GiB; keep large matrices in files of their own", path));
  }
  if (file.bad()) throw InputError(fmt::format("{}: cannot be read: {}", path, std::strerror(errno)));
  return text;
}

std::string read_shared_text(MPI_Comm comm, const std::string& path) {
  std::string text;
  int rank = 0;
  MPI_Comm_rank(comm, &rank);
  agreed(comm, [&] {
    if (rank == 0) text = read_text(path);
  });
  int length = static_cast<int>(text.size());
  MPI_Bcast(&length, 1, MPI_INT, 0, comm);
  text.resize(static_cast<std::size_t>(length));
  MPI_Bcast(text.data(), length, MPI_CHAR, 0, comm);
  return text;
}

}  // namespace sweepvi
