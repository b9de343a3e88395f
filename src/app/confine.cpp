#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "app/allowed_options.hpp"
#include "app/verbs.hpp"
#include "io/confinement.hpp"
#include "io/toml_table.hpp"
#include "petsc/ambient_options.hpp"

namespace sweepvi::app {

std::vector<std::string> confine(const CommandLine& line) {
  clean_petsc_environment(true);
  if (const std::string refused = why_refused(line.petsc_words); !refused.empty()) throw InputError(refused);
  const std::string text = read_text(*line.confine);
  std::map<std::string, std::string> files;
  try {
    files = nlohmann::json::parse(text).get<std::map<std::string, std::string>>();
  } catch (const nlohmann::json::exception&) {
    throw InputError(fmt::format(
        "{} is no list of files; expected a JSON object of names and paths, as in {{\"M.mtx\": \"0\"}}",
        *line.confine));
  }
  std::vector<std::string> paths;
  for (const auto& [name, path] : files)
    paths.push_back(path);
  confine_files(std::move(files));
  return paths;
}

void check_options_allowed(const std::string& where, const std::string& options) {
  if (const std::string found = loads_code(options); !found.empty())
    throw InputError(fmt::format("{}: {} brings in other code or options; that is for the command line alone",
                                 where, found));
  if (!files_are_confined()) return;
  const std::string refused = why_refused(options);
  if (!refused.empty()) throw InputError(fmt::format("{}: {}", where, refused));
}

}  // namespace sweepvi::app
