#include "io/scene.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>

#include "io/scene_chain.hpp"
#include "io/scene_model.hpp"
#include "io/toml_table.hpp"

namespace sweepvi {

namespace {

const std::vector<Scheme> all_schemes = {Scheme::homsp,       Scheme::zd_euler,    Scheme::naive_euler,
                                         Scheme::catching_up, Scheme::moreau_jean, Scheme::zhuravlev_ivanov,
                                         Scheme::hybrid};

template <class Choice>
std::vector<std::string> names_of(const std::vector<Choice>& choices) {
  std::vector<std::string> names;
  names.reserve(choices.size());
  for (const Choice choice : choices)
    names.emplace_back(name_of(choice));
  return names;
}

/// The schemes of a kind of model (chains: of their element), the first where the scene says nothing.
std::vector<Scheme> schemes_of(const std::string& kind, const TomlValue& model) {
  if (kind == "linear") return {Scheme::homsp, Scheme::zd_euler, Scheme::naive_euler, Scheme::hybrid};
  if (kind == "lagrangian") return {Scheme::moreau_jean, Scheme::homsp, Scheme::hybrid};
  if (kind == "sweeping") return {Scheme::catching_up, Scheme::hybrid};
  if (kind == "zhuravlev-ivanov") return {Scheme::zhuravlev_ivanov, Scheme::hybrid};
  return chain_schemes(model);
}

Scheme read_scheme(const TomlValue& value, const std::vector<Scheme>& fitting) {
  const std::vector<std::string> names = names_of(fitting);
  const std::vector<std::string> known = names_of(all_schemes);
  const std::string name = value.choice(value ? known : names, true);
  const auto at = std::find(names.begin(), names.end(), name);
  if (at == names.end())
    value.fail(fmt::format("= \"{}\" does not fit this model; expected {}", name, fmt::join(names, ", ")));
  return fitting[static_cast<std::size_t>(at - names.begin())];
}

/// theta or gamma.
double read_weight(const TomlValue& key, bool fits, const char* schemes) {
  const double value = key.number_or(1.0);
  if (value <= 0.0 || value > 1.0) key.fail(fmt::format("= {} is outside (0, 1]", value));
  if (value != 1.0 && !fits)
    key.fail(fmt::format("= {} goes with {}; the other schemes are implicit, leave it out", value, schemes));
  return value;
}

Detection read_detection(const TomlValue& key, bool fits) {
  if (!key) return Detection::predicted;
  if (!fits) key.fail("goes with the scheme \"moreau-jean\"; leave it out");
  const std::vector<Detection> all = {Detection::predicted, Detection::midpoint, Detection::current};
  const std::vector<std::string> names = names_of(all);
  const std::string name = key.choice(names, false);
  return all[static_cast<std::size_t>(std::find(names.begin(), names.end(), name) - names.begin())];
}

TimeSpec read_time(const TomlValue& table, const std::vector<Scheme>& fitting) {
  const TomlValue scheme = table["scheme"], start = table["start"], end = table["end"], step = table["step"],
                  theta = table["theta"], gamma = table["gamma"], detection = table["detection"],
                  tolerance = table["tolerance"];
  TimeSpec time;
  time.scheme = read_scheme(scheme, fitting);
  table.refuse_unknown();
  const bool event_driven = time.scheme == Scheme::hybrid;
  if (tolerance && !event_driven)
    tolerance.fail("goes with the scheme \"hybrid\"; the others have time.step");
  time.tolerance = tolerance.number_or(time.tolerance);
  if (!(time.tolerance >= 1e-15 && time.tolerance <= 0.1))
    tolerance.fail(
        fmt::format("= {}; expected 1e-15 to 0.1, relative to the size of the state", time.tolerance));
  const bool bounces = time.scheme == Scheme::moreau_jean;
  const bool transforms = time.scheme == Scheme::zhuravlev_ivanov;
  // The hybrid scheme takes them for its own steps; where an impact is, it knows without detection.
  time.theta = read_weight(theta, time.scheme == Scheme::homsp || bounces || transforms || event_driven,
                           "homsp, moreau-jean and zhuravlev-ivanov");
  time.gamma = read_weight(gamma, transforms, "zhuravlev-ivanov");
  time.detection = read_detection(detection, bounces || event_driven);

  time.start = start.number_or(0.0);
  time.end = end.number();
  const double duration = time.end - time.start;
  // The hybrid scheme finds its own steps; time.step then says how densely its motion is recorded.
  const double asked = event_driven && !step ? duration / 1000.0 : step.number();
  if (duration <= 0.0)
    end.fail(fmt::format("= {} s; expected more than time.start = {} s", time.end, time.start));
  if (!std::isfinite(duration)) end.fail(fmt::format("= {} s is too far from time.start", time.end));
  if (asked <= 0.0) step.fail(fmt::format("= {} s; expected more than 0", asked));
  constexpr double most_steps = 2147483647.0;
  const double steps = std::max(1.0, std::round(duration / asked));
  if (steps > most_steps)
    step.fail(fmt::format("= {} s makes {:.3g} steps; expected at most {:.0f}", asked, steps, most_steps));
  time.steps = static_cast<std::int64_t>(steps);
  time.asked_step = asked;
  time.step = duration / steps;
  if (time.start + time.step <= time.start || time.end - time.step >= time.end)
    step.fail(fmt::format("= {} s is lost in the rounding of times from {} s to {} s", asked, time.start,
                          time.end));
  return time;
}

OutputSpec read_output(const TomlValue& table, const std::string& scene, const ChainSpec* chain) {
  const TomlValue file = table["file"], every = table["every"], blocks = table["blocks"],
                  checkpoint = table["checkpoint"];
  table.refuse_unknown();
  OutputSpec output;
  if (file && file.string().empty()) file.fail("= \"\"; expected the name of a file");
  output.file = file ? file.target() : std::filesystem::path(scene).stem().string() + ".h5";
  if (every) output.every = every.integer();
  if (output.every < 1) every.fail(fmt::format("= {}; expected at least 1", output.every));
  output.checkpoint = checkpoint.number_or(output.checkpoint);
  if (output.checkpoint < 0.0)
    checkpoint.fail(fmt::format("= {} s; expected 0 (only when stopped) or more", output.checkpoint));

  if (!blocks || (blocks.is_string() && blocks.string() == "all")) return output;
  if (!blocks.is_array()) blocks.fail("is neither \"all\" nor a list of element numbers");
  if (chain == nullptr) blocks.fail("lists elements, but only a chain has elements; expected \"all\"");
  std::vector<std::int64_t>& chosen = output.blocks.emplace();
  for (const double number : blocks.numbers()) {
    if (number != std::round(number) || number < 0.0 || number >= static_cast<double>(chain->count))
      blocks.fail(
          fmt::format("has entry {}; expected element numbers from 0 to {}", number, chain->count - 1));
    chosen.push_back(static_cast<std::int64_t>(number));
  }
  if (chosen.empty()) blocks.fail("is empty; expected \"all\" or at least one element number");
  std::sort(chosen.begin(), chosen.end());
  if (const auto twice = std::adjacent_find(chosen.begin(), chosen.end()); twice != chosen.end())
    blocks.fail(fmt::format("lists element {} twice", *twice));
  return output;
}

void read_document(const TomlValue& document, bool root, Scene& scene) {
  const TomlValue title = document["title"], time = document["time"], model = document["model"],
                  output = document["output"], petsc = document["petsc"];
  document.refuse_unknown();
  scene.title = title.string_or("");
  const std::string kind =
      model["kind"].choice({"linear", "lagrangian", "sweeping", "zhuravlev-ivanov", "chain"}, false);
  scene.time = read_time(time, schemes_of(kind, model));
  if (kind == "linear") {
    scene.model = read_linear(model, root);
  } else if (kind == "lagrangian") {
    scene.model = read_lagrangian(model, scene.time.scheme, root);
  } else if (kind == "sweeping") {
    scene.model = read_sweeping(model, root);
  } else if (kind == "chain") {
    scene.model = read_chain(model, scene.time.scheme, root);
  } else {
    scene.model = read_impact(model);
  }
  scene.output = read_output(output, scene.path, std::get_if<ChainSpec>(&scene.model));
  const TomlValue options = petsc["options"];
  petsc.refuse_unknown();
  scene.petsc_options = options.string_or("");
  scene.petsc_options_set = options.overridden();
}

}  // namespace

Scene read_scene(MPI_Comm comm, const std::string& path, const Overrides& overrides) {
  Scene scene;
  scene.path = path;
  scene.text = read_shared_text(comm, path);
  int rank = 0;
  MPI_Comm_rank(comm, &rank);
  agreed(comm,
         [&] { read_document(TomlValue::parse(path, scene.text, overrides, rank == 0), rank == 0, scene); });
  if (auto* chain = std::get_if<ChainSpec>(&scene.model)) share(comm, *chain);
  return scene;
}

std::map<std::string, std::string> fingerprint(MPI_Comm comm, const Scene& scene,
                                               const Overrides& overrides) {
  std::map<std::string, std::string> result;
  int rank = 0;
  MPI_Comm_rank(comm, &rank);
  agreed(comm, [&] {
    if (rank != 0) return;
    const TomlValue document = TomlValue::parse(scene.path, scene.text, overrides, false);
    const TomlValue output = document["output"];
    for (const TomlValue& part : {document["time"], document["model"], output["every"], output["blocks"]})
      result.merge(part.flattened());
  });
  return result;
}

}  // namespace sweepvi
