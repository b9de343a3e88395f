#include "service/scene_files.hpp"

#include <algorithm>

#include "io/toml_library.hpp"
#include "service/files.hpp"
#include "service/refusal.hpp"

namespace sweepvi::service {

namespace fs = std::filesystem;

namespace {

class Collector {
public:
  explicit Collector(fs::path folder) : folder_(std::move(folder)) {}

  void visit(const toml::node& node) {
    if (const auto* text = node.as_string()) add(text->get());
    if (const auto* table = node.as_table())
      for (const auto& [key, value] : *table)
        visit(value);
    if (const auto* array = node.as_array())
      for (const toml::node& value : *array)
        visit(value);
  }

  void add(const std::string& name) {
    std::error_code failure;
    const fs::path path = folder_ / name;
    if (name.empty() || !fs::is_regular_file(path, failure)) return;
    const bool known =
        std::any_of(found.begin(), found.end(), [&](const NamedFile& file) { return file.name == name; });
    if (!known) found.push_back({name, path});
  }

  std::vector<NamedFile> found;

private:
  fs::path folder_;
};

}  // namespace

std::vector<NamedFile> files_named_in(const std::string& document, const std::vector<std::string>& changes) {
  const std::optional<std::string> text = read_file(document);
  if (!text) throw UsageError(document + ": there is no such file");
  Collector collector(fs::path(document).parent_path());
  try {
    const toml::table root = toml::parse(*text);
    for (const char* part : {"model", "problem"})
      if (const toml::node* node = root.get(part)) collector.visit(*node);
  } catch (const toml::parse_error&) {
    return {};
  }
  Collector own("");
  for (const std::string& change : changes) {
    if (!change.starts_with("model.")) continue;
    try {
      own.visit(toml::parse("value = " + change.substr(change.find('=') + 1)));
    } catch (const toml::parse_error&) {  // a string without its quotes
      own.add(change.substr(change.find('=') + 1));
    }
  }
  for (NamedFile& file : own.found)
    collector.found.push_back(std::move(file));
  return std::move(collector.found);
}

}  // namespace sweepvi::service
