#include "service/description.hpp"

#include <fmt/format.h>

#include <cmath>

#include "service/refusal.hpp"

namespace sweepvi::service {

using nlohmann::json;

namespace {

constexpr std::size_t most_words = 200;
constexpr std::size_t longest_word = 4096;
constexpr int deepest = 8;

bool has_control_characters(const std::string& text) {
  return text.find_first_of(std::string("\0\n\r", 3)) != std::string::npos;
}

}  // namespace

void Description::refuse(const std::string& what) {
  throw Refusal(400, what);
}

Description::Description(std::string_view text) {
  // A parser that recurses would not survive a million brackets.
  const auto shallow = [](int depth, json::parse_event_t, json&) {
    if (depth > deepest) refuse("the description nests too deep");
    return true;
  };
  try {
    object_ = json::parse(text, shallow);
  } catch (const json::exception&) {
    refuse("the description is not JSON");
  }
  if (!object_.is_object()) refuse("the description is not a JSON object");
}

std::string Description::text(const char* key, const std::string& otherwise, std::size_t longest) const {
  if (!has(key)) return otherwise;
  if (!object_[key].is_string()) refuse(fmt::format("'{}' is not a text", key));
  std::string value = object_[key];
  if (value.size() > longest) refuse(fmt::format("'{}' has more than {} bytes", key, longest));
  return value;
}

double Description::number(const char* key, double otherwise, double least, double most) const {
  if (!has(key) || object_[key].is_null()) return otherwise;
  const double value = object_[key].is_number() ? object_[key].get<double>() : NAN;
  if (!(value >= least) || !(value <= most))
    refuse(fmt::format("'{}' is not a number from {:g} to {:g}", key, least, most));
  return value;
}

std::int64_t Description::integer(const char* key, std::int64_t otherwise, std::int64_t least,
                                  std::int64_t most) const {
  if (!has(key) || object_[key].is_null()) return otherwise;
  const double value = object_[key].is_number() ? object_[key].get<double>() : NAN;
  if (!(value >= static_cast<double>(least)) || !(value <= static_cast<double>(most)) ||
      value != std::floor(value))
    refuse(fmt::format("'{}' is not a whole number from {} to {}", key, least, most));
  return static_cast<std::int64_t>(value);
}

std::vector<std::string> Description::words(const char* key) const {
  std::vector<std::string> words;
  if (!has(key)) return words;
  if (!object_[key].is_array() || object_[key].size() > most_words)
    refuse(fmt::format("'{}' is not a list of at most {} texts", key, most_words));
  for (const json& entry : object_[key]) {
    if (!entry.is_string()) refuse(fmt::format("'{}' has an entry that is not a text", key));
    words.push_back(entry);
    if (words.back().size() > longest_word || has_control_characters(words.back()))
      refuse(fmt::format("'{}' has an entry that is too long, or more than a line", key));
  }
  return words;
}

std::string Description::numbers(const char* key) const {
  std::string list;
  if (!has(key)) return list;
  if (!object_[key].is_array() || object_[key].size() > most_words || object_[key].empty())
    refuse(fmt::format("'{}' is not a list of 1 to {} numbers", key, most_words));
  for (const json& entry : object_[key]) {
    if (!entry.is_number()) refuse(fmt::format("'{}' has an entry that is not a number", key));
    list += (list.empty() ? "" : ",") + fmt::format("{}", entry.get<double>());
  }
  return list;
}

void Description::refuse_others(const std::set<std::string>& keys) const {
  for (const auto& [key, value] : object_.items())
    if (!keys.contains(key))
      refuse(fmt::format("'{}' is unknown; known are {}", key.substr(0, 40), fmt::join(keys, ", ")));
}

}  // namespace sweepvi::service
