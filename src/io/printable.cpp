#include "io/printable.hpp"

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdio>

namespace sweepvi {

namespace {

struct Character {
  char32_t code = 0;
  std::size_t bytes = 1;
  bool valid = false;
};

/// The first character (RFC 3629: no overlong forms, no surrogates, nothing above U+10FFFF).
Character first_of(std::string_view text) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const unsigned char lead = byte(0);
  if (lead < 0x80) return {lead, 1, true};
  const std::size_t bytes = lead >= 0xf0 ? 4 : lead >= 0xe0 ? 3 : 2;
  if (lead < 0xc2 || lead > 0xf4 || text.size() < bytes) return {};
  char32_t code = lead & (0x7fU >> bytes);
  for (std::size_t i = 1; i < bytes; ++i) {
    if ((byte(i) & 0xc0U) != 0x80) return {};
    code = (code << 6U) | (byte(i) & 0x3fU);
  }
  const bool overlong = code < (bytes == 4 ? 0x10000U : bytes == 3 ? 0x800U : 0x80U);
  const bool valid = !overlong && code <= 0x10ffff && (code < 0xd800 || code > 0xdfff);
  return valid ? Character{code, bytes, true} : Character{};
}

/// What is not seen where it stands: ranges of code points.
bool is_hidden(char32_t code) {
  struct Range {
    char32_t first, last;
  };
  static constexpr std::array ranges = {
      Range{0x00, 0x1f},     Range{0x7f, 0x9f},       Range{0xad, 0xad},     Range{0x34f, 0x34f},
      Range{0x61c, 0x61c},   Range{0x115f, 0x1160},   Range{0x180e, 0x180e}, Range{0x200b, 0x200f},
      Range{0x2028, 0x202e}, Range{0x2060, 0x206f},   Range{0x3164, 0x3164}, Range{0xe000, 0xf8ff},
      Range{0xfe00, 0xfe0f}, Range{0xfeff, 0xfeff},   Range{0xffa0, 0xffa0}, Range{0xfff9, 0xfffb},
      Range{0xfffe, 0xffff}, Range{0xe0000, 0x10ffff}};
  return std::any_of(ranges.begin(), ranges.end(),
                     [&](const Range& range) { return code >= range.first && code <= range.last; });
}

std::string escaped(const char* format, std::uint32_t number) {
  std::array<char, 16> text{};
  std::snprintf(text.data(), text.size(), format, number);
  return text.data();
}

std::string with_escapes(std::string_view text, std::string_view kept) {
  std::string result;
  result.reserve(text.size());
  while (!text.empty()) {
    const Character character = first_of(text);
    if (!character.valid)
      result += escaped("\\x%02x", static_cast<unsigned char>(text[0]));
    else if (!is_hidden(character.code) || (character.bytes == 1 && kept.find(text[0]) != kept.npos))
      result += text.substr(0, character.bytes);
    else if (character.code == '\n')
      result += "\\n";
    else if (character.code == '\r')
      result += "\\r";
    else if (character.code == '\t')
      result += "\\t";
    else
      result += escaped(character.bytes == 1 ? "\\x%02x" : "\\u{%x}", character.code);
    text.remove_prefix(character.bytes);
  }
  return result;
}

}  // namespace

std::string printable(std::string_view text) {
  return with_escapes(text, {});
}

std::string printable_lines(std::string_view text) {
  return with_escapes(text, "\n\t");
}

std::string in_quotes(std::string_view word, std::size_t most) {
  std::size_t end = std::min(word.size(), most);
  // Not in the middle of a character.
  while (end < word.size() && end > 0 && (static_cast<unsigned char>(word[end]) & 0xc0U) == 0x80U)
    --end;
  return "'" + printable(word.substr(0, end)) + (end < word.size() ? "..." : "") + "'";
}

}  // namespace sweepvi
