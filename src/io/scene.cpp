#include "io/scene.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>

#include "io/scene_chain.hpp"
#include "io/toml_table.hpp"

namespace sweepvi {

namespace {

/// What the contract names for later, so that it is not mistaken for a slip.
const std::vector<std::string> planned_schemes = {"catching-up", "moreau-jean", "hybrid", "zhuravlev-ivanov"};
const std::vector<std::string> planned_kinds = {"lagrangian", "sweeping", "zhuravlev-ivanov"};

Scheme read_scheme(const TomlValue& value) {
  const std::vector<Scheme> schemes = {Scheme::homsp, Scheme::zd_euler, Scheme::naive_euler};
  std::vector<std::string> names;
  names.reserve(schemes.size());
  for (const Scheme scheme : schemes)
    names.emplace_back(name_of(scheme));
  const std::string name = value.choice(names, planned_schemes, true);
  return schemes[static_cast<std::size_t>(std::find(names.begin(), names.end(), name) - names.begin())];
}

TimeSpec read_time(const TomlValue& table) {
  const TomlValue scheme = table["scheme"], start = table["start"], end = table["end"], step = table["step"],
                  theta = table["theta"], gamma = table["gamma"], detection = table["detection"],
                  tolerance = table["tolerance"];
  TimeSpec time;
  time.scheme = read_scheme(scheme);
  table.refuse_unknown();
  if (gamma) gamma.fail_not_built("schemes without it");
  if (detection) detection.fail_not_built("schemes without it");
  if (tolerance) tolerance.fail_not_built("time.step");
  if (const double value = theta.number_or(1.0); value != 1.0) {
    if (value <= 0.0 || value > 1.0) theta.fail(fmt::format("= {} is outside (0, 1]", value));
    theta.fail(fmt::format("= {} is not built yet; available: 1.0", value));
  }

  time.start = start.number_or(0.0);
  time.end = end.number();
  const double asked = step.number();
  const double duration = time.end - time.start;
  if (duration <= 0.0)
    end.fail(fmt::format("= {} s; expected more than time.start = {} s", time.end, time.start));
  if (!std::isfinite(duration)) end.fail(fmt::format("= {} s is too far from time.start", time.end));
  if (asked <= 0.0) step.fail(fmt::format("= {} s; expected more than 0", asked));
  constexpr double most_steps = 2147483647.0;
  const double steps = std::max(1.0, std::round(duration / asked));
  if (steps > most_steps)
    step.fail(fmt::format("= {} s makes {:.3g} steps; expected at most {:.0f}", asked, steps, most_steps));
  time.steps = static_cast<std::int64_t>(steps);
  time.step = duration / steps;
  if (time.start + time.step <= time.start || time.end - time.step >= time.end)
    step.fail(fmt::format("= {} s is lost in the rounding of times from {} s to {} s", asked, time.start,
                          time.end));
  return time;
}

// Linear scenes
// --------------------------------------------------------------------------------------------------

void expect_shape(const TomlValue& key, const SparseEntries& found, std::int64_t rows, std::int64_t cols) {
  if (found.rows != rows || found.cols != cols)
    key.fail(fmt::format("is {} x {}; expected {} x {}, as model.A is n x n and model.B n x m", found.rows,
                         found.cols, rows, cols));
}

template <class T>
void expect_length(const TomlValue& key, const std::vector<T>& found, std::int64_t length, const char* what) {
  if (static_cast<std::int64_t>(found.size()) != length)
    key.fail(fmt::format("has {} entries; expected {} = {}", found.size(), what, length));
}

/// Empty if no constraint has an upper limit.
std::vector<double> read_wmax(const TomlValue& wmax, std::int64_t m) {
  if (!wmax) return {};
  std::vector<double> values;
  if (wmax.is_number()) {
    values.assign(static_cast<std::size_t>(m), wmax.number_or_infinity());
  } else {
    values = wmax.numbers_or_infinity();
    expect_length(wmax, values, m, "m");
  }
  for (const double value : values)
    if (!(value > 0.0))
      wmax.fail(
          fmt::format("has the entry {}; expected more than 0, the distance between the walls w = 0 and w = "
                      "wmax, or inf",
                      value));
  const bool none = std::all_of(values.begin(), values.end(), [](double value) {
    return value == std::numeric_limits<double>::infinity();
  });
  return none ? std::vector<double>{} : values;
}

LinearSpec read_linear(const TomlValue& table, bool root) {
  const TomlValue A = table["A"], B = table["B"], C = table["C"], D = table["D"], f = table["f"],
                  w0 = table["w0"], x0 = table["x0"], wmax = table["wmax"];
  table.refuse_unknown();
  LinearSpec model;
  if (!root) {
    if (D) model.D.emplace();
    return model;
  }
  model.A = A.matrix();
  const std::int64_t n = model.A.rows;
  if (n < 1 || model.A.cols != n) A.fail(fmt::format("is {} x {}; expected n x n, n >= 1", n, model.A.cols));
  model.B = B.matrix();
  const std::int64_t m = model.B.cols;
  if (m < 1)
    B.fail(fmt::format("is {} x {}; expected n x m with at least one constraint, m >= 1", model.B.rows, m));
  expect_shape(B, model.B, n, m);
  model.C = C.matrix();
  expect_shape(C, model.C, m, n);
  if (D) {
    model.D = D.matrix();
    expect_shape(D, *model.D, m, m);
  }
  if (f) {
    model.f = f.signals();
    expect_length(f, model.f, n, "n");
  }
  model.w0 = w0 ? w0.numbers() : std::vector<double>(static_cast<std::size_t>(m), 0.0);
  expect_length(w0, model.w0, m, "m");
  model.x0 = x0.numbers();
  expect_length(x0, model.x0, n, "n");
  model.wmax = read_wmax(wmax, m);
  return model;
}

// The rest
// -------------------------------------------------------------------------------------------------------

OutputSpec read_output(const TomlValue& table, const std::string& scene, const ChainSpec* chain) {
  const TomlValue file = table["file"], every = table["every"], blocks = table["blocks"],
                  checkpoint = table["checkpoint"];
  table.refuse_unknown();
  OutputSpec output;
  output.file = file ? file.path() : std::filesystem::path(scene).stem().string() + ".h5";
  if (every) output.every = every.integer();
  if (output.every < 1) every.fail(fmt::format("= {}; expected at least 1", output.every));
  if (const double seconds = checkpoint.number_or(0.0); seconds != 0.0) {
    if (seconds < 0.0) checkpoint.fail(fmt::format("= {} s; expected 0 or more", seconds));
    checkpoint.fail(fmt::format("= {} s is not built yet; available: 0, only when stopped", seconds));
  }

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
  const bool is_chain = model["kind"].choice({"linear", "chain"}, planned_kinds, false) == "chain";
  scene.time = read_time(time);
  if (is_chain) {
    scene.model = read_chain(model, scene.time.scheme, root);
  } else {
    scene.model = read_linear(model, root);
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

}  // namespace sweepvi
