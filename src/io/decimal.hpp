#pragma once

#include <charconv>
#include <cstdlib>
#include <optional>
#include <string>
#include <string_view>

namespace sweepvi {

/// What a word of a text file says as a number: all of it, with or without a plus, 0 where it
/// is too small, infinite where it is too large or says so; none if it is no number.
inline std::optional<double> decimal(std::string_view word) {
  if (word.size() > 1 && word[0] == '+' && word[1] != '-') word.remove_prefix(1);  // from_chars knows no plus
  double value = 0;
  const auto [end, code] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (code == std::errc::invalid_argument || end != word.data() + word.size()) return std::nullopt;
  if (code == std::errc::result_out_of_range) value = std::strtod(std::string(word).c_str(), nullptr);
  return value;
}

}  // namespace sweepvi
