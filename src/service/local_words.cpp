#include "service/local_words.hpp"

#include <fmt/format.h>

#include <array>
#include <cctype>
#include <cstdlib>
#include <filesystem>
#include <sstream>

#include "service/refusal.hpp"

namespace sweepvi::service {

using nlohmann::json;

namespace {

double number_of(const std::string& word, const std::string& text) {
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  if (text.empty() || *end != '\0') throw UsageError(fmt::format("{} {}: expected a number", word, text));
  return value;
}

json numbers_of(const std::string& word, const std::string& text) {
  json list = json::array();
  std::istringstream pieces(text);
  for (std::string piece; std::getline(pieces, piece, ',');)
    list.push_back(number_of(word, piece));
  return list;
}

json words_of(const std::string& text) {
  json list = json::array();
  std::istringstream pieces(text);
  for (std::string piece; std::getline(pieces, piece, ',');)
    list.push_back(piece);
  return list;
}

/// PETSc's, as PETSc tells them from values.
bool is_option(const std::string& word) {
  return word.size() > 1 && word[0] == '-' && std::isalpha(static_cast<unsigned char>(word[1])) != 0;
}

}  // namespace

LocalWords read_local_words(const std::vector<std::string>& words) {
  constexpr std::array verbs = {"run", "solve", "study"};
  if (words.size() < 2 || std::find(verbs.begin(), verbs.end(), words[0]) == verbs.end())
    throw UsageError(
        "'submit' needs the words of a local run: run SCENE.toml ..., solve PROBLEM.toml ..., or "
        "study SCENE.toml --steps ...");
  LocalWords local;
  const std::string& verb = words[0];
  local.document = words[1];
  json& out = local.description;
  out = {{"verb", verb}, {"name", std::filesystem::path(local.document).filename().string()}};
  for (std::size_t i = 2; i < words.size(); ++i) {
    const std::string& given = words[i];
    const std::size_t equals = given.starts_with("--") ? given.find('=') : std::string::npos;
    const std::string word = given.substr(0, equals);
    const auto value = [&]() -> std::string {
      if (equals != std::string::npos) return given.substr(equals + 1);
      if (i + 1 == words.size()) throw UsageError(word + " needs a value");
      return words[++i];
    };
    if (word == "-o" || (verb == "study" && word == "--csv")) {
      local.output = value();
    } else if (word == "--summary") {
      local.summary = value();
    } else if (word == "--force") {
      local.force = true;
    } else if (word == "--set") {
      local.changes.push_back(value());
      out["set"].push_back(local.changes.back());
    } else if (word == "--wall-limit") {
      out["wall_limit"] = number_of(word, value());
    } else if (verb == "study" && (word == "--steps" || word == "--tolerances" || word == "--components")) {
      out[word.substr(2)] = numbers_of(word, value());
    } else if (verb == "study" && word == "--schemes") {
      out["schemes"] = words_of(value());
    } else if (verb == "study" && word == "--repeats") {
      out["repeats"] = number_of(word, value());
    } else if (verb == "study" && word == "--reference") {
      out["reference"] = number_of(word, value());
    } else if (verb == "study" && word == "--settings") {
      local.settings = value();
    } else if (is_option(given)) {
      out["options"].push_back(given);
      if (i + 1 < words.size() && !is_option(words[i + 1]) && !words[i + 1].starts_with("--"))
        out["options"].push_back(words[++i]);
    } else {
      throw UsageError(fmt::format("'{}' cannot be handed in; see 'sweepvi submit --help'", given));
    }
  }
  if (local.output.empty())
    local.output = std::filesystem::path(local.document).stem().string() + (verb == "study" ? ".csv" : ".h5");
  return local;
}

}  // namespace sweepvi::service
