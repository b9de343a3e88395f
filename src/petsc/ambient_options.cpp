#include "petsc/ambient_options.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <cstdlib>
#include <sstream>
#include <string_view>
#include <vector>

#include "sweepvi/error.hpp"

namespace sweepvi {

namespace {

// As PETSc compares names: without regard to case, and to dashes and underscores.
std::string plain(std::string_view word) {
  std::string result;
  for (const unsigned char c : word)
    if (std::isalnum(c) != 0) result += static_cast<char>(std::tolower(c));
  return result;
}

bool is_name(const std::string& word) {
  return word.size() > 1 && word[0] == '-' && std::isalpha(static_cast<unsigned char>(word[1])) != 0;
}

constexpr std::array names = {
    "dllappend",         "dllprepend",    "dllview",       "optionsfile",     "optionsfileyaml",
    "optionsstringyaml", "prefixpush",    "prefixpop",     "startindebugger", "onerrorattachdebugger",
    "stopfordebugger",   "debuggernodes", "debuggerranks", "debugterminal",   "snespythontype",
    "ksppythontype",     "pcpythontype",  "tspythontype",  "matpythontype",   "sweepvipetscrc"};

/// A type by the name of a library and a function in it: -pc_type ./own.so:make.
bool names_library(const std::string& option, const std::string& value) {
  return option.ends_with("type") && value.find_first_of("/:.") != std::string::npos;
}

}  // namespace

std::string loads_code(const std::string& text) {
  std::string unquoted = text;
  std::erase_if(unquoted, [](char c) { return c == '"' || c == '\''; });
  std::istringstream stream(unquoted);
  std::vector<std::string> words;
  for (std::string word; stream >> word;)
    words.push_back(word);
  for (std::size_t i = 0; i < words.size(); ++i) {
    if (!is_name(words[i])) continue;
    const std::string name = plain(words[i]);
    if (std::find(names.begin(), names.end(), name) != names.end()) return words[i];
    if (i + 1 < words.size() && names_library(name, words[i + 1])) return words[i] + " " + words[i + 1];
  }
  return {};
}

void clean_petsc_environment(bool confined) {
  unsetenv("PETSC_OPTIONS_YAML");
  const char* options = std::getenv("PETSC_OPTIONS");
  if (options == nullptr) return;
  if (confined) {
    unsetenv("PETSC_OPTIONS");
    return;
  }
  const std::string found = loads_code(options);
  if (!found.empty())
    throw InputError(
        "PETSC_OPTIONS has " + found +
        ", which brings in other code or options; give it on the command line, where everybody sees it");
}

}  // namespace sweepvi
