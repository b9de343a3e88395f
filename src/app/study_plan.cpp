#include "app/study_plan.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "io/toml_table.hpp"

namespace sweepvi::app {

namespace {

void replace(Overrides& overrides, const std::string& key, const std::string& value) {
  std::erase_if(overrides, [&](const auto& entry) { return entry.first == key; });
  if (!value.empty()) overrides.emplace_back(key, value);
}

void check_names(const std::vector<std::string>& schemes, const std::string& where) {
  std::vector<std::string> known;
  for (const Scheme scheme : {Scheme::homsp, Scheme::zd_euler, Scheme::naive_euler, Scheme::catching_up,
                              Scheme::moreau_jean, Scheme::zhuravlev_ivanov, Scheme::hybrid})
    known.emplace_back(name_of(scheme));
  for (const std::string& name : schemes)
    if (std::find(known.begin(), known.end(), name) == known.end())
      throw InputError(fmt::format("{}: there is no scheme '{}'{}", where, name, suggestion(name, known)));
}

std::vector<std::string> split(const std::string& text, const char* separators) {
  std::vector<std::string> words;
  for (std::size_t first = text.find_first_not_of(separators); first != std::string::npos;) {
    const std::size_t end = text.find_first_of(separators, first);
    words.push_back(text.substr(first, end - first));
    first = text.find_first_not_of(separators, end);
  }
  return words;
}

// Words key=value, as after --set.
Overrides read_overrides(const TomlValue& set) {
  Overrides overrides;
  for (const std::string& word : split(set.string_or(""), " \t\n")) {
    const std::size_t equals = word.find('=');
    if (equals == std::string::npos || equals == 0)
      set.fail(fmt::format("has '{}'; expected key=value, as in time.theta=0.5", word));
    const std::string key = word.substr(0, equals);
    for (const char* own : {"time.step", "time.scheme", "time.tolerance"})
      if (key == own) set.fail(fmt::format("has '{}'; the command line says that, for all settings", word));
    overrides.emplace_back(key, word.substr(equals + 1));
  }
  return overrides;
}

}  // namespace

std::vector<Setting> read_settings(MPI_Comm comm, const std::string& path) {
  const std::string text = read_shared_text(comm, path);
  const TomlValue document = TomlValue::parse(path, text, {}, false);
  const TomlValue list = document["setting"];
  document.refuse_unknown();
  std::vector<Setting> settings;
  for (const TomlValue& table : list.tables()) {
    const TomlValue name = table["name"], options = table["options"], set = table["set"],
                    schemes = table["schemes"];
    table.refuse_unknown();
    settings.push_back(
        {name.string(), options.string_or(""), read_overrides(set), split(schemes.string_or(""), ", \t\n")});
    check_names(settings.back().schemes, schemes.name());
    const std::string& words = settings.back().options;
    const std::size_t start = words.find_first_not_of(" \t\n");
    if (settings.back().name.empty()) name.fail("is empty; every setting has a name of its own");
    if (start != std::string::npos && words[start] != '-')
      options.fail(fmt::format("= \"{}\" does not start with an option; names begin with a dash", words));
    if (std::count_if(settings.begin(), settings.end(),
                      [&](const Setting& other) { return other.name == settings.back().name; }) > 1)
      name.fail(fmt::format("= \"{}\" is there twice", settings.back().name));
  }
  if (settings.empty()) list.fail("is empty; expected [[setting]] with name, options and set");
  return settings;
}

bool fits(const Setting& setting, const std::string& scheme) {
  const std::vector<std::string>& schemes = setting.schemes;
  return schemes.empty() || std::find(schemes.begin(), schemes.end(), scheme) != schemes.end();
}

std::string Setting::words() const {
  std::string text;
  for (const auto& [key, value] : overrides)
    text += fmt::format("--set {}={} ", key, value);
  return text + options;
}

CommandLine line_of(const CommandLine& line, const StudyRun& run) {
  CommandLine one = line;
  for (const auto& [key, value] : run.setting.overrides)
    if (std::none_of(line.overrides.begin(), line.overrides.end(),
                     [&, name = key](const auto& said) { return said.first == name; }))
      one.overrides.emplace_back(key, value);
  if (run.scheme.empty()) return one;
  replace(one.overrides, "time.scheme", run.scheme);
  replace(one.overrides, "time.step", fmt::format("{}", run.step));
  if (run.scheme != name_of(Scheme::hybrid))
    replace(one.overrides, "time.tolerance", "");
  else if (run.tolerance)
    replace(one.overrides, "time.tolerance", fmt::format("{}", *run.tolerance));
  return one;
}

StudyPlan make_plan(MPI_Comm comm, const CommandLine& line) {
  const std::string hybrid = name_of(Scheme::hybrid);
  check_names(line.schemes, "--schemes");
  CommandLine own = line;
  if (!line.steps.empty()) replace(own.overrides, "time.step", fmt::format("{}", line.steps.front()));
  const Scene scene = read_scene(comm, line.scene, own.overrides);
  StudyPlan plan;
  plan.scheme = name_of(scene.time.scheme);
  const std::vector<double> steps = line.steps.empty() ? std::vector{scene.time.step} : line.steps;
  plan.finest = *std::min_element(steps.begin(), steps.end());
  const std::vector<std::string> schemes = line.schemes.empty() ? std::vector{plan.scheme} : line.schemes;
  const auto hybrids = std::count(schemes.begin(), schemes.end(), hybrid);
  if (!line.tolerances.empty() && hybrids == 0)
    throw InputError("--tolerances goes with the scheme hybrid; add it to --schemes");
  if (line.steps.empty() && !line.tolerances.empty() && hybrids < std::ssize(schemes))
    throw InputError("--tolerances alone goes with hybrid alone; the other schemes need --steps");
  const std::vector<Setting> settings =
      line.settings ? read_settings(comm, *line.settings) : std::vector<Setting>{{"default", "", {}, {}}};
  plan.several_settings = settings.size() > 1;
  for (const std::string& scheme : schemes)
    for (const Setting& setting : settings) {
      if (!fits(setting, scheme)) continue;
      if (scheme == hybrid && !line.tolerances.empty())
        for (const double tolerance : line.tolerances)
          plan.runs.push_back({scheme, plan.finest, tolerance, setting});
      else
        for (const double step : steps)
          plan.runs.push_back({scheme, step, {}, setting});
    }
  if (plan.runs.empty()) throw InputError("no setting of --settings goes with any scheme of the study");
  return plan;
}

}  // namespace sweepvi::app
