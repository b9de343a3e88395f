#include "io/confinement.hpp"

#include <utility>

namespace sweepvi {

namespace {

std::optional<std::map<std::string, std::string>>& list() {
  static std::optional<std::map<std::string, std::string>> files;
  return files;
}

}  // namespace

void confine_files(std::map<std::string, std::string> files) {
  list() = std::move(files);
}

bool files_are_confined() {
  return list().has_value();
}

std::optional<std::string> confined_file(const std::string& name) {
  const auto found = list()->find(name);
  if (found == list()->end()) return std::nullopt;
  return found->second;
}

}  // namespace sweepvi
