#include "service/arguments.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>

#include "service/refusal.hpp"

namespace sweepvi::service {

Arguments::Arguments(const std::string& verb, const std::vector<std::string>& words,
                     const std::vector<Option>& options, std::size_t operands, std::size_t rest_from) {
  for (std::size_t i = 0; i < words.size(); ++i) {
    const std::string& given = words[i];
    if (given.size() < 2 || given[0] != '-') {
      if (rest_from > 0 && operands_.size() + 1 == rest_from) {
        rest_.assign(words.begin() + static_cast<std::ptrdiff_t>(i), words.end());
        return;
      }
      if (operands_.size() == operands)
        throw UsageError(fmt::format("unexpected word '{}'; see 'sweepvi {} --help'", given, verb));
      operands_.push_back(given);
      continue;
    }
    const std::size_t equals = given.starts_with("--") ? given.find('=') : std::string::npos;
    const std::string word = given.substr(0, equals);
    const auto option =
        std::find_if(options.begin(), options.end(), [&](const Option& known) { return known.word == word; });
    if (option == options.end())
      throw UsageError(fmt::format("'{0}' has no option {1}; see 'sweepvi {0} --help'", verb, word));
    if (values_.contains(word)) throw UsageError(word + " is there twice");
    if (option->value.empty()) {
      if (equals != std::string::npos) throw UsageError(word + " takes no value");
      values_[word] = "";
      continue;
    }
    if (equals == std::string::npos && i + 1 == words.size())
      throw UsageError(fmt::format("{0} needs a value: {0} {1}", word, option->value));
    values_[word] = equals == std::string::npos ? words[++i] : given.substr(equals + 1);
    if (values_[word].empty())
      throw UsageError(fmt::format("{0} needs a value: {0} {1}", word, option->value));
  }
}

std::string Arguments::get(const std::string& word, const std::string& otherwise) const {
  const auto found = values_.find(word);
  return found == values_.end() ? otherwise : found->second;
}

double Arguments::number(const std::string& word, double otherwise, double least, double most) const {
  if (!has(word)) return otherwise;
  return number_in(word + " ", values_.at(word), least, most);
}

double number_in(const std::string& what, const std::string& text, double least, double most) {
  char* end = nullptr;
  double value = std::strtod(text.c_str(), &end);
  const std::string suffixes = "KMGT";
  if (*end != '\0' && end != text.c_str() && suffixes.find(*end) != std::string::npos) {
    for (std::size_t i = 0; i <= suffixes.find(*end); ++i)
      value *= 1024.0;
    ++end;
  }
  if (end == text.c_str() || *end != '\0' || !(value >= least) || !(value <= most))
    throw UsageError(fmt::format("{}{}: expected a number from {:g} to {:g}", what, text, least, most));
  return value;
}

std::string option_table(const std::vector<Option>& options) {
  const auto left = [](const Option& option) {
    return option.value.empty() ? option.word : option.word + " " + option.value;
  };
  std::size_t width = 0;
  for (const Option& option : options)
    width = std::max(width, left(option).size());
  std::string text;
  for (const Option& option : options)
    text += fmt::format("  {:<{}}  {}\n", left(option), width, option.text);
  return text;
}

}  // namespace sweepvi::service
