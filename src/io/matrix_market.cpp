#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <optional>
#include <string_view>

#include "io/decimal.hpp"
#include "io/matrix_file.hpp"
#include "parallel/memory.hpp"
#include "sweepvi/error.hpp"

namespace sweepvi {
namespace {

constexpr std::int64_t most = std::numeric_limits<std::int32_t>::max();  // of rows, of columns, of entries

enum class Symmetry { general, symmetric, skew };

struct Banner {
  bool coordinate = true;
  bool pattern = false;
  bool integer = false;
  Symmetry symmetry = Symmetry::general;
};

std::string read_whole(const std::string& path) {
  std::error_code error;
  if (!std::filesystem::exists(path, error)) throw InputError(path + ": there is no such file");
  if (std::filesystem::is_directory(path, error))
    throw InputError(path + " is a folder; a MatrixMarket file is needed");
  std::ifstream file(path, std::ios::binary);
  if (!file) throw InputError(path + ": the file cannot be opened; check its permissions");
  const std::uintmax_t bytes = std::filesystem::file_size(path, error);
  if (error) throw InputError(path + " is not a file with a length; a MatrixMarket file is needed");
  require_memory(double(bytes), path + " takes");
  std::string text(std::size_t(bytes), '\0');
  file.read(text.data(), std::streamsize(text.size()));
  if (file.bad() || std::size_t(file.gcount()) != text.size())
    throw InputError(path + ": the file cannot be read");
  return text;
}

/// Goes through the file word by word, and knows on which line it is.
class Scanner {
public:
  explicit Scanner(const std::string& path) : path_(path), text_(read_whole(path)) {}

  [[noreturn]] void refuse(const std::string& message) const {
    throw InputError(path_ + ":" + std::to_string(line_number_) + ": " + message);
  }

  /// Moves to the next line that says something; comments and blank lines do not. False at the end of the
  /// file, which then counts as the line after the last.
  bool next_line() {
    do {
      if (position_ >= text_.size()) {
        rest_ = {};
        if (!at_end_) ++line_number_;
        at_end_ = true;
        return false;
      }
      const std::size_t end = std::min(text_.find('\n', position_), text_.size());
      rest_ = std::string_view(text_).substr(position_, end - position_);
      position_ = end + 1;
      ++line_number_;
      line_ = rest_;
    } while (peek().empty() || (rest_[0] == '%' && line_number_ > 1));
    return true;
  }

  /// The next word of this line, empty at its end.
  std::string_view word() {
    const std::string_view found = peek();
    rest_.remove_prefix(found.size());
    return found;
  }

  bool line_has_more() { return !peek().empty(); }
  std::size_t size() const { return text_.size(); }
  std::string quoted(std::string_view word) const {
    return "'" + std::string(word.substr(0, 40)) + (word.size() > 40 ? "..." : "") + "'";
  }
  std::string quoted_line() const {
    const std::size_t end = line_.find_last_not_of(" \t\r");
    return quoted(line_.substr(0, end == std::string_view::npos ? 0 : end + 1));
  }

  std::int64_t whole(std::string_view what) {
    const std::string_view found = word();
    std::int64_t value = 0;
    const auto [end, code] = std::from_chars(found.data(), found.data() + found.size(), value);
    if (found.empty() || code != std::errc() || end != found.data() + found.size())
      refuse(std::string(what) + " should be a whole number, found " +
             (found.empty() ? "nothing" : quoted(found)));
    return value;
  }

  double number(bool integer) {
    const std::string_view found = word();
    const std::optional<double> value = decimal(found);
    if (!value) refuse("a value should be a number, found " + (found.empty() ? "nothing" : quoted(found)));
    if (!std::isfinite(*value)) refuse("a value should be a finite number, found " + quoted(found));
    if (integer && *value != std::trunc(*value))
      refuse("the first line says integer, found " + quoted(found) + "; say real");
    return *value;
  }

  void end_of_line(std::string_view expected) {
    if (line_has_more()) refuse("found " + quoted_line() + ", expected " + std::string(expected));
  }

private:
  std::string_view peek() {
    rest_.remove_prefix(std::min(rest_.find_first_not_of(" \t\r\f\v"), rest_.size()));
    return rest_.substr(0, rest_.find_first_of(" \t\r\f\v"));
  }

  std::string path_;
  std::string text_;
  std::size_t position_ = 0;
  std::size_t line_number_ = 0;
  bool at_end_ = false;
  std::string_view line_;
  std::string_view rest_;
};

std::string lower_case(std::string_view word) {
  std::string result(word);
  for (char& c : result)
    c = char(std::tolower(static_cast<unsigned char>(c)));
  return result;
}

Banner read_banner(Scanner& scan) {
  const bool any = scan.next_line();
  std::array<std::string, 5> words;
  for (std::string& word : words)
    word = lower_case(scan.word());
  const auto& [mark, object, format, field, symmetry] = words;
  if (!any || mark != "%%matrixmarket")
    scan.refuse("this is no MatrixMarket file: it should begin with '%%MatrixMarket matrix', found " +
                (any ? scan.quoted_line() : "nothing"));
  scan.end_of_line("five words: %%MatrixMarket matrix FORMAT FIELD SYMMETRY");

  const auto one_of = [&](const std::string& word, std::string_view what,
                          std::initializer_list<std::string_view> known) {
    std::string list;
    for (const std::string_view candidate : known) {
      if (word == candidate) return;
      list += (list.empty() ? "" : ", ") + std::string(candidate);
    }
    scan.refuse("the " + std::string(what) + " " +
                (word.empty() ? "is missing" : scan.quoted(word) + " is not supported") +
                "; expected one of: " + list);
  };
  one_of(object, "object", {"matrix"});
  one_of(format, "format", {"coordinate", "array"});
  one_of(field, "field", {"real", "integer", "pattern"});
  one_of(symmetry, "symmetry", {"general", "symmetric", "skew-symmetric"});
  if (field == "pattern" && format == "array") scan.refuse("a pattern has no array form; say coordinate");
  if (field == "pattern" && symmetry == "skew-symmetric")
    scan.refuse("a pattern cannot be skew-symmetric; say real and give the values");
  return {.coordinate = format == "coordinate",
          .pattern = field == "pattern",
          .integer = field == "integer",
          .symmetry = symmetry == "general"     ? Symmetry::general
                      : symmetry == "symmetric" ? Symmetry::symmetric
                                                : Symmetry::skew};
}

/// Entries in the order of the file, each symmetric pair as one.
struct Triplets {
  std::vector<std::int32_t> row, column;
  std::vector<double> value;

  void reserve(std::size_t count) {
    row.reserve(count);
    column.reserve(count);
    value.reserve(count);
  }
  void add(std::int64_t i, std::int64_t j, double v) {
    row.push_back(std::int32_t(i));
    column.push_back(std::int32_t(j));
    value.push_back(v);
  }
};

Triplets read_coordinate(Scanner& scan, const Banner& banner, std::int64_t rows, std::int64_t cols,
                         std::int64_t count) {
  const std::string form = banner.pattern ? "ROW COLUMN" : "ROW COLUMN VALUE";
  Triplets entries;
  // What the file claims is not yet what it holds: an entry takes 4 characters at least.
  entries.reserve(std::size_t(std::min(count, std::int64_t(scan.size() / 4 + 1))));
  std::int64_t read = 0;
  for (; scan.next_line(); ++read) {
    if (read == count) scan.refuse("found more entries than the " + std::to_string(count) + " announced");
    const std::int64_t i = scan.whole("the row");
    if (i < 1 || i > rows)
      scan.refuse("row " + std::to_string(i) + " is outside 1 ... " + std::to_string(rows));
    const std::int64_t j = scan.whole("the column");
    if (j < 1 || j > cols)
      scan.refuse("column " + std::to_string(j) + " is outside 1 ... " + std::to_string(cols));
    const double value = banner.pattern ? 1.0 : scan.number(banner.integer);
    scan.end_of_line(form);
    if (banner.symmetry != Symmetry::general && i < j)
      scan.refuse("entry (" + std::to_string(i) + ", " + std::to_string(j) +
                  ") lies above the diagonal; a symmetric "
                  "file holds the lower triangle only. Leave it out, or say general");
    if (banner.symmetry == Symmetry::skew && i == j)
      scan.refuse("entry (" + std::to_string(i) + ", " + std::to_string(j) +
                  ") lies on the diagonal, which is 0 in a "
                  "skew-symmetric matrix and not in the file; leave it out, or say general");
    entries.add(i - 1, j - 1, value);
  }
  if (read < count)
    scan.refuse("the file ends after " + std::to_string(read) + " of " + std::to_string(count) + " entries");
  return entries;
}

Triplets read_array(Scanner& scan, const Banner& banner, std::int64_t rows, std::int64_t cols) {
  Triplets entries;
  bool more = scan.next_line();
  std::int64_t read = 0;
  for (std::int64_t j = 0; j < cols; ++j) {  // column by column
    const std::int64_t first = banner.symmetry == Symmetry::general ? 0
                               : banner.symmetry == Symmetry::skew  ? j + 1
                                                                    : j;
    for (std::int64_t i = first; i < rows; ++i, ++read) {
      if (!more)
        scan.refuse("the file ends after " + std::to_string(read) + " values, before entry (" +
                    std::to_string(i + 1) + ", " + std::to_string(j + 1) + ")");
      const double value = scan.number(banner.integer);
      if (value != 0) entries.add(i, j, value);
      if (!scan.line_has_more()) more = scan.next_line();
    }
  }
  if (more) scan.refuse("found more values than the " + std::to_string(read) + " of the announced size");
  return entries;
}

SparseEntries compress(const Triplets& entries, Symmetry symmetry, std::int64_t rows, std::int64_t cols) {
  const bool mirrored = symmetry != Symmetry::general;
  const double sign = symmetry == Symmetry::skew ? -1 : 1;
  SparseEntries matrix{rows, cols, std::vector<std::int64_t>(std::size_t(rows) + 1, 0), {}, {}};
  std::vector<std::int64_t>& starts = matrix.row_starts;
  const auto each = [&](auto&& use) {
    for (std::size_t k = 0; k < entries.value.size(); ++k) {
      const std::int32_t i = entries.row[k], j = entries.column[k];
      use(i, j, entries.value[k]);
      if (mirrored && i != j) use(j, i, sign * entries.value[k]);
    }
  };
  each([&](std::int32_t i, std::int32_t, double) { ++starts[std::size_t(i) + 1]; });
  for (std::size_t i = 0; i < std::size_t(rows); ++i)
    starts[i + 1] += starts[i];
  matrix.columns.resize(std::size_t(starts.back()));
  matrix.values.resize(std::size_t(starts.back()));
  // starts[i] walks through row i, and ends up where row i + 1 began.
  each([&](std::int32_t i, std::int32_t j, double value) {
    const auto place = std::size_t(starts[std::size_t(i)]++);
    matrix.columns[place] = j;
    matrix.values[place] = value;
  });
  std::copy_backward(starts.begin(), starts.end() - 1, starts.end());
  starts.front() = 0;
  sort_rows(matrix);
  return matrix;
}

}  // namespace

SparseEntries read_matrix_market(const std::string& path) {
  Scanner scan(path);
  const Banner banner = read_banner(scan);
  if (!scan.next_line())
    scan.refuse(banner.coordinate ? "the file ends before the size, ROWS COLUMNS ENTRIES"
                                  : "the file ends before the size, ROWS COLUMNS");
  const std::int64_t rows = scan.whole("the number of rows"), cols = scan.whole("the number of columns");
  const std::int64_t count = banner.coordinate ? scan.whole("the number of entries") : 0;
  scan.end_of_line(banner.coordinate ? "the size, ROWS COLUMNS ENTRIES" : "the size, ROWS COLUMNS");
  if (rows < 1 || cols < 1 || rows > most || cols > most)
    scan.refuse("the size is " + std::to_string(rows) + " x " + std::to_string(cols) +
                "; expected 1 to 2147483647 rows and columns");
  if (count < 0) scan.refuse("the number of entries is " + std::to_string(count) + ", it cannot be negative");
  if (count > most)
    scan.refuse("the number of entries is " + std::to_string(count) + "; expected at most 2147483647");
  if (banner.symmetry != Symmetry::general && rows != cols)
    scan.refuse("the first line says the matrix is symmetric or skew-symmetric, but its size is " +
                std::to_string(rows) + " x " + std::to_string(cols) + "; it should be square");
  require_memory(8.0 * double(rows), path + ": a matrix of " + std::to_string(rows) + " rows takes");
  const Triplets entries = banner.coordinate ? read_coordinate(scan, banner, rows, cols, count)
                                             : read_array(scan, banner, rows, cols);
  SparseEntries matrix = compress(entries, banner.symmetry, rows, cols);
  if (std::ssize(matrix.values) > most)
    throw InputError(path + ": the matrix has " + std::to_string(matrix.values.size()) +
                     " entries, those above the diagonal included; expected at most 2147483647");
  for (const double value : matrix.values)
    if (!std::isfinite(value))
      throw InputError(path + ": entries of one place sum to more than a number can hold");
  return matrix;
}

std::vector<double> read_matrix_market_vector(const std::string& path) {
  const SparseEntries matrix = read_matrix_market(path);
  if (matrix.rows != 1 && matrix.cols != 1)
    throw InputError(path + ": a vector is expected here, and the file holds a " +
                     std::to_string(matrix.rows) + " x " + std::to_string(matrix.cols) +
                     " matrix; give it one column or one row");
  const std::int64_t length = std::max(matrix.rows, matrix.cols);
  require_memory(8.0 * double(length), path + ": a vector of length " + std::to_string(length) + " takes");
  std::vector<double> vector(std::size_t(length), 0.0);
  for (std::size_t i = 0; i < std::size_t(matrix.rows); ++i)
    for (auto k = std::size_t(matrix.row_starts[i]); k < std::size_t(matrix.row_starts[i + 1]); ++k)
      vector[std::max(i, std::size_t(matrix.columns[k]))] = matrix.values[k];
  return vector;
}

}  // namespace sweepvi
