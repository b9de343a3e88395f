#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace sweepvi::service {

/// The words of a local run, "run scene.toml --set a=b -snes_type c", as a request.
struct LocalWords {
  nlohmann::json description;  ///< but for ranks, priority and the text of the document
  std::string document;        ///< path
  std::string output;          ///< of -o; empty: its stem
  std::string summary;         ///< of --summary
  std::string settings;        ///< of --settings, a path
  bool force = false;
  std::vector<std::string> changes;  ///< --set
};

/// @throws UsageError for words that a service cannot take
LocalWords read_local_words(const std::vector<std::string>& words);

}  // namespace sweepvi::service
