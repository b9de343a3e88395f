#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <cmath>
#include <memory>
#include <optional>
#include <string_view>
#include <utility>
#include <vector>

#include "io/byte_source.hpp"
#include "io/compressed.hpp"
#include "io/decimal.hpp"
#include "io/matrix_file.hpp"
#include "io/printable.hpp"
#include "parallel/memory.hpp"
#include "sweepvi/error.hpp"

namespace sweepvi {
namespace {

enum class Symmetry { general, symmetric, skew };

struct Banner {
  bool coordinate = true;
  bool pattern = false;
  bool integer = false;
  Symmetry symmetry = Symmetry::general;
};

/// A number as Fortran writes it, too: 1.5D+03, 1.5d3, 1.5Q3, and 1.5+103 or 1.5-103, which is how an
/// exponent of three digits comes out of a field made for two.
std::optional<double> number_of(std::string_view word) {
  if (const std::optional<double> value = decimal(word)) return value;
  const auto digit = [&](std::size_t i) { return std::isdigit(static_cast<unsigned char>(word[i])) != 0; };
  std::string text(word);
  if (const std::size_t letter = word.find_first_of("dDqQ"); letter != std::string_view::npos) {
    text[letter] = 'e';
  } else {
    const std::size_t sign = word.find_first_of("+-", 1);
    if (sign == std::string_view::npos || word.size() != sign + 4 ||
        (!digit(sign - 1) && word[sign - 1] != '.'))
      return std::nullopt;
    text.insert(sign, "e");
  }
  return decimal(text);
}

/// Goes through the file word by word, and knows on which line it is. Only the line is in memory.
class Scanner {
public:
  explicit Scanner(FileSource& source) : source_(source) {}

  [[noreturn]] void refuse(const std::string& message) const {
    throw InputError(source_.name() + ":" + std::to_string(line_number_) + ": " + message);
  }

  /// Moves to the next line that says something; comments and blank lines do not. False at the end of the
  /// file, which then counts as the line after the last.
  bool next_line() {
    std::string_view first;
    do {
      const std::optional<std::string_view> line = raw_line();
      if (!line) {
        rest_ = {};
        if (!at_end_) ++line_number_;
        at_end_ = true;
        return false;
      }
      ++line_number_;
      line_ = rest_ = *line;
      if (line_number_ == 1) skip_byte_order_mark();
      first = peek();
    } while (first.empty() || (lines_ > 0 && is_comment(first)));
    ++lines_;
    return true;
  }

  /// The next word of this line, empty at its end.
  std::string_view word() {
    const std::string_view found = peek();
    if (lines_ > 1 && is_comment(found)) return {};
    rest_.remove_prefix(found.size());
    return found;
  }

  bool line_has_more() {
    const std::string_view next = peek();
    return !next.empty() && !is_comment(next);
  }
  std::string quoted_line() const {
    const std::size_t end = line_.find_last_not_of(" \t\r");
    return in_quotes(line_.substr(0, end == std::string_view::npos ? 0 : end + 1));
  }

  std::int64_t whole(std::string_view what) {
    const std::string_view found = word();
    std::int64_t value = 0;
    const auto [end, code] = std::from_chars(found.data(), found.data() + found.size(), value);
    if (found.empty() || code != std::errc() || end != found.data() + found.size())
      refuse(std::string(what) + " should be a whole number, found " +
             (found.empty() ? "nothing" : in_quotes(found)));
    return value;
  }

  double number(bool integer) {
    const std::string_view found = word();
    const std::optional<double> value = number_of(found);
    if (!value) refuse("a value should be a number, found " + (found.empty() ? "nothing" : in_quotes(found)));
    if (!std::isfinite(*value)) refuse("a value should be a finite number, found " + in_quotes(found));
    if (integer && *value != std::trunc(*value))
      refuse("the first line says integer, found " + in_quotes(found) + "; say real");
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
  /// It and the rest of its line say nothing; the first line, which begins like one, does.
  static bool is_comment(std::string_view word) { return word.starts_with('%'); }

  void skip_byte_order_mark() {
    constexpr std::string_view utf8 = "\xef\xbb\xbf";
    if (rest_.starts_with("\xff\xfe") || rest_.starts_with("\xfe\xff"))
      refuse("the text is encoded in UTF-16; save it as UTF-8 or ASCII");
    if (rest_.starts_with(utf8)) rest_.remove_prefix(utf8.size());
    line_ = rest_;
  }

  /// The next line without its end; none at the end of the file. Valid until the next call.
  std::optional<std::string_view> raw_line() {
    std::size_t searched = position_;
    while (true) {
      const std::size_t end = text_.find('\n', searched);
      if (end != std::string::npos || (ended_ && position_ < text_.size())) {
        const std::size_t last = std::min(end, text_.size());
        const std::string_view line = std::string_view(text_).substr(position_, last - position_);
        position_ = std::min(last + 1, text_.size());
        return line;
      }
      if (ended_) return std::nullopt;
      searched = text_.size() - position_;
      text_.erase(0, std::exchange(position_, 0));
      constexpr std::size_t window = std::size_t{1} << 18U;
      constexpr std::size_t longest_line = std::size_t{1} << 26U;  // what gzip unpacks to may have no end
      if (text_.size() >= longest_line) {
        ++line_number_;
        refuse("the line has 64 MiB and more; this is no MatrixMarket file");
      }
      const std::size_t more = std::max(window, text_.size());  // a long line is not searched again and again
      require_memory(double(text_.size() + more), source_.name() + ": a line takes");
      text_.resize(searched + more);
      const std::size_t read = source_.read(text_.data() + searched, more);
      text_.resize(searched + read);
      ended_ = read < more;
    }
  }

  FileSource& source_;
  std::string text_;
  std::size_t position_ = 0;
  bool ended_ = false;
  std::size_t line_number_ = 0, lines_ = 0;  // lines_: those that say something
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
                (word.empty() ? "is missing" : in_quotes(word) + " is not supported") +
                "; expected one of: " + list);
  };
  one_of(object, "object", {"matrix"});
  one_of(format, "format", {"coordinate", "array"});
  one_of(field, "field", {"real", "double", "integer", "unsigned-integer", "pattern"});
  one_of(symmetry, "symmetry", {"general", "symmetric", "skew-symmetric"});
  if (field == "pattern" && format == "array") scan.refuse("a pattern has no array form; say coordinate");
  if (field == "pattern" && symmetry == "skew-symmetric")
    scan.refuse("a pattern cannot be skew-symmetric; say real and give the values");
  return {.coordinate = format == "coordinate",
          .pattern = field == "pattern",
          .integer = field.ends_with("integer"),
          .symmetry = symmetry == "general"     ? Symmetry::general
                      : symmetry == "symmetric" ? Symmetry::symmetric
                                                : Symmetry::skew};
}

/// Complains about a pair (i, j), (j, i) that is given on both sides of the diagonal: whether its two values
/// are one or to be summed, a symmetric file does not say.
void refuse_both_triangles(const Scanner& scan, const Triplets& entries) {
  std::vector<std::size_t> order;
  for (std::size_t k = 0; k < entries.value.size(); ++k)
    if (entries.row[k] != entries.column[k]) order.push_back(k);
  const auto pair = [&](std::size_t k) { return std::minmax(entries.row[k], entries.column[k]); };
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return pair(a) < pair(b); });
  for (std::size_t n = 1; n < order.size(); ++n) {
    const std::size_t a = order[n - 1], b = order[n];
    if (entries.row[a] == entries.column[b] && entries.column[a] == entries.row[b])
      scan.refuse("the first line says the matrix is symmetric or skew-symmetric, and entry (" +
                  std::to_string(entries.row[a] + 1) + ", " + std::to_string(entries.column[a] + 1) +
                  ") is given on both sides of the diagonal; leave one triangle out, or say general");
  }
}

Triplets read_coordinate(Scanner& scan, const Banner& banner, std::int64_t rows, std::int64_t cols,
                         std::int64_t count, std::uint64_t bytes) {
  const std::string form = banner.pattern ? "ROW COLUMN" : "ROW COLUMN VALUE";
  Triplets entries;
  // What the file claims is not yet what it holds: an entry takes 4 characters at least.
  entries.reserve(std::size_t(std::min(std::uint64_t(count), bytes / 4 + 1)));
  bool lower = false, upper = false;
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
    lower = lower || i > j;
    upper = upper || i < j;
    if (banner.symmetry == Symmetry::skew && i == j) {
      if (value == 0) continue;
      scan.refuse(
          "entry (" + std::to_string(i) + ", " + std::to_string(j) + ") = " + std::to_string(value) +
          " lies on the diagonal, which is 0 in a skew-symmetric matrix; leave it out, or say general");
    }
    entries.add(i - 1, j - 1, value);
  }
  if (read < count)
    scan.refuse("the file ends after " + std::to_string(read) + " of " + std::to_string(count) + " entries");
  if (banner.symmetry != Symmetry::general && lower && upper) refuse_both_triangles(scan, entries);
  return entries;
}

/// Column by column; of a symmetric matrix from the diagonal on, of a skew-symmetric one below it, or, as
/// some programs do, from the diagonal on with its zeros: the number of values tells.
Triplets read_array(Scanner& scan, const Banner& banner, std::int64_t rows, std::int64_t cols) {
  const bool skew = banner.symmetry == Symmetry::skew;
  std::int64_t read = 0;
  bool more = scan.next_line();
  const auto next = [&](std::int64_t i, std::int64_t j) {
    if (!more)
      scan.refuse("the file ends after " + std::to_string(read) + " values, before entry (" +
                  std::to_string(i + 1) + ", " + std::to_string(j + 1) + ")");
    const double value = scan.number(banner.integer);
    if (!scan.line_has_more()) more = scan.next_line();
    ++read;
    return value;
  };
  Triplets entries;
  if (skew) {
    std::vector<double> values;
    const std::int64_t below = rows * (rows - 1) / 2, with_diagonal = below + rows;
    while (more && read < with_diagonal) {
      if (values.size() == values.capacity())
        require_memory(16.0 * double(values.size()), "the values of a matrix take");
      values.push_back(next(0, 0));
    }
    if (read != below && read != with_diagonal)
      scan.refuse("the file ends after " + std::to_string(read) + " values; a skew-symmetric matrix of " +
                  std::to_string(rows) + " rows has " + std::to_string(below) + " below its diagonal");
    std::size_t k = 0;
    for (std::int64_t j = 0; j < cols; ++j)
      for (std::int64_t i = read == below ? j + 1 : j; i < rows; ++i, ++k) {
        if (values[k] == 0) continue;
        if (i == j)
          scan.refuse("entry (" + std::to_string(i + 1) + ", " + std::to_string(j + 1) +
                      ") = " + std::to_string(values[k]) +
                      " lies on the diagonal, which is 0 in a skew-symmetric matrix");
        entries.add(i, j, values[k]);
      }
  } else {
    for (std::int64_t j = 0; j < cols; ++j)
      for (std::int64_t i = banner.symmetry == Symmetry::general ? 0 : j; i < rows; ++i) {
        const double value = next(i, j);
        if (value != 0) entries.add(i, j, value);
      }
  }
  if (more) scan.refuse("found more values than the " + std::to_string(read) + " of the announced size");
  return entries;
}

}  // namespace

SparseEntries read_matrix_market(FileSource& source) {
  Scanner scan(source);
  const Banner banner = read_banner(scan);
  if (!scan.next_line())
    scan.refuse(banner.coordinate ? "the file ends before the size, ROWS COLUMNS ENTRIES"
                                  : "the file ends before the size, ROWS COLUMNS");
  const std::int64_t rows = scan.whole("the number of rows"), cols = scan.whole("the number of columns");
  const std::int64_t count = banner.coordinate ? scan.whole("the number of entries") : 0;
  scan.end_of_line(banner.coordinate ? "the size, ROWS COLUMNS ENTRIES" : "the size, ROWS COLUMNS");
  if (rows < 1 || cols < 1 || rows > most_entries || cols > most_entries)
    scan.refuse("the size is " + std::to_string(rows) + " x " + std::to_string(cols) +
                "; expected 1 to 2147483647 rows and columns");
  if (count < 0) scan.refuse("the number of entries is " + std::to_string(count) + ", it cannot be negative");
  if (count > most_entries)
    scan.refuse("the number of entries is " + std::to_string(count) + "; expected at most 2147483647");
  if (banner.symmetry != Symmetry::general && rows != cols)
    scan.refuse("the first line says the matrix is symmetric or skew-symmetric, but its size is " +
                std::to_string(rows) + " x " + std::to_string(cols) + "; it should be square");
  require_memory(8.0 * double(rows), source.name() + ": a matrix of " + std::to_string(rows) + " rows takes");
  const Triplets entries = banner.coordinate
                               ? read_coordinate(scan, banner, rows, cols, count, source.bytes_on_disk())
                               : read_array(scan, banner, rows, cols);
  const int mirror = banner.symmetry == Symmetry::general ? 0 : banner.symmetry == Symmetry::skew ? -1 : 1;
  SparseEntries matrix = compress(entries, rows, cols, mirror, source.name());
  if (std::ssize(matrix.values) > most_entries)
    throw InputError(source.name() + ": the matrix has " + std::to_string(matrix.values.size()) +
                     " entries, those on both sides of the diagonal counted; expected at most 2147483647");
  for (const double value : matrix.values)
    if (!std::isfinite(value))
      throw InputError(source.name() + ": entries of one place sum to more than a number can hold");
  return matrix;
}

}  // namespace sweepvi
