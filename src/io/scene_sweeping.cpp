#include "io/scene_checks.hpp"
#include "io/scene_model.hpp"

namespace sweepvi {

namespace {

std::vector<Signal> read_signals(const TomlValue& key, std::int64_t length, const char* what) {
  if (!key) return {};
  std::vector<Signal> signals = key.signals();
  expect_length(key, signals, length, what);
  return signals;
}

}  // namespace

SweepingSpec read_sweeping(const TomlValue& table, bool root) {
  const TomlValue u0 = table["u0"], f = table["f"], A = table["A"], lower = table["lower"],
                  upper = table["upper"], G = table["G"], g = table["g"];
  table.refuse_unknown();
  const TomlValue& of_box = lower ? lower : upper;
  if (of_box && (G || g))
    of_box.fail("goes with a box, model.G and model.g with a polyhedron G u >= g; give one of the two");
  if (!of_box && !G)
    G.fail("is missing; a sweeping scene needs a set: lower and upper of a box, or G and g of a polyhedron");
  SweepingSpec model;
  if (A) model.A.emplace();
  if (G) model.G.emplace();
  if (!root) return model;
  model.u0 = u0.numbers();
  const auto n = static_cast<std::int64_t>(model.u0.size());
  if (n < 1) u0.fail("is empty; expected at least one entry");
  model.f = read_signals(f, n, "n, the length of model.u0,");
  model.lower = read_signals(lower, n, "n, the length of model.u0,");
  model.upper = read_signals(upper, n, "n, the length of model.u0,");
  if (A) {
    model.A = A.matrix();
    expect_shape(A, *model.A, n, n, "model.u0 has n entries");
  }
  if (G) {
    model.G = G.matrix();
    if (model.G->rows < 1) G.fail("has no rows; expected m x n with at least one face");
    expect_shape(G, *model.G, model.G->rows, n, "model.u0 has n entries");
    if (!g) g.fail("is missing; the polyhedron is G u >= g");
    model.g = read_signals(g, model.G->rows, "m, the rows of model.G,");
  }
  return model;
}

}  // namespace sweepvi
