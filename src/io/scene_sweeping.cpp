#include <limits>

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

/// Infinite entries stand for no bound, on the side of `none`.
std::vector<Signal> read_bounds(const TomlValue& key, std::int64_t length, double none) {
  if (!key) return {};
  std::vector<Signal> bounds = key.signals_or_infinity();
  expect_length(key, bounds, length, "n, the length of model.u0,");
  for (const Signal& bound : bounds)
    if (bound.offset == -none)
      key.fail(
          fmt::format("has the entry {}; expected numbers, signals, or {} for no bound", bound.offset, none));
  return bounds;
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
  model.lower = read_bounds(lower, n, -std::numeric_limits<double>::infinity());
  model.upper = read_bounds(upper, n, std::numeric_limits<double>::infinity());
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
