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

std::vector<Setting> read_settings(MPI_Comm comm, const std::string& path) {
  const std::string text = read_shared_text(comm, path);
  const TomlValue document = TomlValue::parse(path, text, {}, false);
  const TomlValue list = document["setting"];
  document.refuse_unknown();
  std::vector<Setting> settings;
  for (const TomlValue& table : list.tables()) {
    const TomlValue name = table["name"], options = table["options"];
    table.refuse_unknown();
    settings.push_back({name.string(), options.string_or("")});
    const std::string& words = settings.back().options;
    const std::size_t start = words.find_first_not_of(" \t\n");
    if (settings.back().name.empty()) name.fail("is empty; every setting has a name of its own");
    if (start != std::string::npos && words[start] != '-')
      options.fail(fmt::format("= \"{}\" does not start with an option; names begin with a dash", words));
    if (std::count_if(settings.begin(), settings.end(),
                      [&](const Setting& other) { return other.name == settings.back().name; }) > 1)
      name.fail(fmt::format("= \"{}\" is there twice", settings.back().name));
  }
  if (settings.empty()) list.fail("is empty; expected [[setting]] with name and options");
  return settings;
}

void check_names(const std::vector<std::string>& schemes) {
  std::vector<std::string> known;
  for (const Scheme scheme : {Scheme::homsp, Scheme::zd_euler, Scheme::naive_euler, Scheme::catching_up,
                              Scheme::moreau_jean, Scheme::zhuravlev_ivanov, Scheme::hybrid})
    known.emplace_back(name_of(scheme));
  for (const std::string& name : schemes)
    if (std::find(known.begin(), known.end(), name) == known.end())
      throw InputError(fmt::format("--schemes: there is no scheme '{}'{}", name, suggestion(name, known)));
}

}  // namespace

CommandLine line_of(const CommandLine& line, const StudyRun& run) {
  CommandLine one = line;
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
  check_names(line.schemes);
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
      line.settings ? read_settings(comm, *line.settings) : std::vector<Setting>{{"default", ""}};
  plan.several_settings = settings.size() > 1;
  for (const std::string& scheme : schemes)
    for (const Setting& setting : settings)
      if (scheme == hybrid && !line.tolerances.empty())
        for (const double tolerance : line.tolerances)
          plan.runs.push_back({scheme, plan.finest, tolerance, setting});
      else
        for (const double step : steps)
          plan.runs.push_back({scheme, step, {}, setting});
  return plan;
}

}  // namespace sweepvi::app
