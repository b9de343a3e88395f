#include "io/numpy_array.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <limits>
#include <type_traits>

#include "io/compressed.hpp"
#include "io/printable.hpp"
#include "parallel/memory.hpp"
#include "sweepvi/error.hpp"

namespace sweepvi {
namespace {

/// The head of an array is a Python dictionary:
/// {'descr': '<f8', 'fortran_order': False, 'shape': (3, 4), }
class Dictionary {
public:
  explicit Dictionary(std::string_view text) : text_(text) {}

  bool take(char c) {
    blanks();
    if (!text_.starts_with(c)) return false;
    text_.remove_prefix(1);
    return true;
  }
  bool take(std::string_view word) {
    blanks();
    if (!text_.starts_with(word)) return false;
    text_.remove_prefix(word.size());
    return true;
  }
  /// 'text' or "text".
  bool take_text(std::string& to) {
    blanks();
    if (text_.empty() || (text_[0] != '\'' && text_[0] != '"')) return false;
    const std::size_t end = text_.find(text_[0], 1);
    if (end == std::string_view::npos) return false;
    to = text_.substr(1, end - 1);
    text_.remove_prefix(end + 1);
    return true;
  }
  bool take_number(std::uint64_t& to) {
    blanks();
    const auto [end, code] = std::from_chars(text_.data(), text_.data() + text_.size(), to);
    if (code != std::errc()) return false;
    text_.remove_prefix(std::size_t(end - text_.data()));
    take('L');  // Python 2's long
    return true;
  }
  bool ended() {
    blanks();
    return text_.empty();
  }

private:
  void blanks() { text_.remove_prefix(std::min(text_.find_first_not_of(" \t\r\n"), text_.size())); }
  std::string_view text_;
};

/// IEEE 754 binary16.
double half(std::uint64_t bits) {
  const double sign = (bits & 0x8000U) != 0 ? -1.0 : 1.0;
  const int exponent = int(bits >> 10U & 0x1fU);
  const auto fraction = double(bits & 0x3ffU);
  if (exponent == 0x1f) return fraction == 0 ? sign * HUGE_VAL : std::numeric_limits<double>::quiet_NaN();
  return sign * (exponent == 0 ? std::ldexp(fraction, -24) : std::ldexp(fraction + 1024.0, exponent - 25));
}

}  // namespace

void NumpyArray::refuse(const std::string& what) const {
  throw InputError(source_.name() + ": " + what);
}

std::string NumpyArray::shape_text() const {
  return fmt::format("({}{})", fmt::join(shape_, ", "), shape_.size() == 1 ? "," : "");
}

std::uint64_t NumpyArray::size() const {
  std::uint64_t product = 1;
  for (const std::uint64_t extent : shape_)
    product *= extent;
  return product;
}

NumpyArray::NumpyArray(ByteSource& source, std::uint64_t length) : source_(source) {
  std::array<unsigned char, 12> mark{};
  source_.exactly(mark.data(), 8, "the head of a NumPy array");
  if (std::string_view(reinterpret_cast<const char*>(mark.data()), 6) != "\x93NUMPY")
    refuse("this is no NumPy array: its first bytes should be \\x93NUMPY");
  const int version = mark[6];
  if (version < 1 || version > 3)
    refuse("the NumPy array has format version " + std::to_string(version) + "; expected 1 to 3");
  const std::size_t width = version == 1 ? 2 : 4;
  source_.exactly(mark.data() + 8, width, "the head of a NumPy array");
  std::size_t size = 0;
  for (std::size_t i = width; i > 0; --i)
    size = size << 8U | mark[7 + i];
  constexpr std::size_t most = 100'000;  // NumPy itself takes 10,000
  if (size > most) refuse("the head of the NumPy array has " + std::to_string(size) + " bytes, too many");
  std::string head(size, '\0');
  source_.exactly(head.data(), head.size(), "the head of a NumPy array");
  read_head(head);

  double bytes = double(width_);
  for (const std::uint64_t extent : shape_)
    bytes *= double(extent);
  const std::uint64_t before = 8 + width + size;
  if (double(before) + bytes != double(length))
    refuse(
        fmt::format("the NumPy array has shape {} of {} bytes each, which is {:.0f} bytes, and {} bytes "
                    "follow its head: the file is cut off or damaged, or holds more than one array",
                    shape_text(), width_, bytes, length - std::min(length, before)));
}

void NumpyArray::read_head(const std::string& head) {
  Dictionary text(head);
  std::string key, type;
  bool has_type = false, has_order = false, has_shape = false, good = text.take('{');
  while (good && !text.take('}')) {
    good = text.take_text(key) && text.take(':');
    if (good && key == "descr") {
      if (!text.take_text(type))
        refuse("the NumPy array has numbers of several parts (a structured type); expected plain numbers");
      has_type = true;
    } else if (good && key == "fortran_order") {
      fortran_ = text.take("True");
      good = has_order = fortran_ || text.take("False");
    } else if (good && key == "shape") {
      good = has_shape = text.take('(');
      while (good && !text.take(')')) {
        std::uint64_t extent = 0;
        good = text.take_number(extent) && shape_.size() < 64;
        shape_.push_back(extent);
        if (!text.take(',')) {
          good = good && text.take(')');
          break;
        }
      }
    } else {
      good = false;
    }
    if (good && !text.take(',')) {
      good = text.take('}');
      break;
    }
  }
  if (!good || !text.ended() || !has_type || !has_order || !has_shape)
    refuse("the head of the NumPy array makes no sense, found " + in_quotes(head, 100));
  const char order = type.empty() ? '?' : type[0];
  if (order == '<' || order == '>' || order == '|' || order == '=') type.erase(0, 1);
  big_endian_ = order == '>';
  type_ = type;
  const std::string_view digits = std::string_view(type_).substr(std::min<std::size_t>(1, type_.size()));
  const auto [end, code] = std::from_chars(digits.data(), digits.data() + digits.size(), width_);
  if (type_.empty() || code != std::errc() || end != digits.data() + digits.size() || width_ < 1 ||
      width_ > 10'000 || type_[0] == 'O')
    refuse(
        "the NumPy array has type " + in_quotes(type) + "; expected real numbers, integers or truth values" +
        (type.starts_with("O") ? ". It was pickled: convert it with astype(float) before it is saved" : ""));
  if (type_[0] == 'U') width_ *= 4;
}

void NumpyArray::expect_numbers(bool whole) const {
  const char kind = type_[0];
  const bool integer = (kind == 'i' || kind == 'u') && std::has_single_bit(width_) && width_ <= 8;
  const bool real = kind == 'f' && (width_ == 2 || width_ == 4 || width_ == 8);
  const bool truth = kind == 'b' && width_ == 1;
  if (whole ? integer : integer || real || truth) return;
  refuse("the NumPy array has type " + in_quotes(type_) + (kind == 'c' ? " (complex)" : "") +
         (whole ? "; expected whole numbers"
                : "; expected real numbers of at most 8 bytes, integers or truth values"));
}

template <class To>
To NumpyArray::number(const unsigned char* bytes) const {
  std::uint64_t bits = 0;
  for (std::uint64_t i = 0; i < width_; ++i)
    bits = bits << 8U | bytes[big_endian_ ? i : width_ - 1 - i];
  switch (type_[0]) {
    case 'f':
      if (width_ == 2) return To(half(bits));
      return To(width_ == 4 ? double(std::bit_cast<float>(std::uint32_t(bits)))
                            : std::bit_cast<double>(bits));
    case 'i': {
      const auto unused = unsigned(64 - 8 * width_);
      return To(std::int64_t(bits << unused) >> unused);
    }
    default:
      if constexpr (std::is_integral_v<To>)
        if (bits > std::uint64_t(std::numeric_limits<To>::max()))
          refuse("found " + std::to_string(bits) + ", which is too large");
      return To(bits);
  }
}

template <class To>
void NumpyArray::numbers(To* to, std::size_t count) {
  std::array<unsigned char, 1U << 16U> bytes;
  while (count > 0) {
    const std::size_t block = std::min(count, bytes.size() / width_);
    source_.exactly(bytes.data(), block * width_, "its numbers");
    for (std::size_t i = 0; i < block; ++i)
      *to++ = number<To>(bytes.data() + i * width_);
    count -= block;
  }
}

/// What was packed is checked there.
void NumpyArray::expect_end() {
  char next = 0;
  if (source_.read(&next, 1) != 0) refuse("more bytes follow the NumPy array");
}

std::vector<double> NumpyArray::reals(bool infinity) {
  expect_numbers(false);
  require_memory(8.0 * double(size()), source_.name() + ": shape " + shape_text() + " takes");
  std::vector<double> values(size());
  numbers(values.data(), values.size());
  expect_end();
  if (!infinity) check_finite(values.data(), values.size(), source_.name());
  return values;
}

std::vector<std::int64_t> NumpyArray::integers() {
  expect_numbers(true);
  require_memory(8.0 * double(size()), source_.name() + ": shape " + shape_text() + " takes");
  std::vector<std::int64_t> values(size());
  numbers(values.data(), values.size());
  expect_end();
  return values;
}

SparseEntries NumpyArray::matrix() {
  expect_numbers(false);
  if (shape_.size() != 2)
    refuse("the NumPy array has shape " + shape_text() + "; a matrix with two axes is expected here");
  const std::uint64_t rows = shape_[fortran_ ? 1 : 0], cols = shape_[fortran_ ? 0 : 1];
  DenseRows dense(rows, cols, fortran_, source_.name());
  std::vector<double> block(dense.block_rows() * cols);
  for (std::uint64_t first = 0; first < rows; first += dense.block_rows()) {
    const std::uint64_t count = std::min(dense.block_rows(), rows - first);
    numbers(block.data(), count * cols);
    dense.append(block.data(), count);
  }
  expect_end();
  return dense.finish();
}

std::vector<double> NumpyArray::vector(bool infinity) {
  const bool flat = shape_.size() == 1 || (shape_.size() == 2 && std::min(shape_[0], shape_[1]) == 1);
  if (!flat) refuse("the NumPy array has shape " + shape_text() + "; a vector is expected here");
  check_size(source_.name(), size(), 1);
  return reals(infinity);
}

std::string NumpyArray::text() {
  constexpr std::uint64_t most = 400;
  const char kind = type_[0];
  if (size() != 1 || width_ > most || (kind != 'S' && kind != 'U'))
    refuse("the NumPy array has type " + in_quotes(type_) + " and shape " + shape_text() +
           "; expected one short text");
  std::string bytes(width_, '\0');
  source_.exactly(bytes.data(), bytes.size(), "its text");
  expect_end();
  std::erase(bytes, '\0');  // also three of the four bytes of a letter
  return bytes;
}

}  // namespace sweepvi
