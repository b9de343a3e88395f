#include <algorithm>
#include <cmath>

#include "io/scene_checks.hpp"
#include "io/scene_model.hpp"

namespace sweepvi {

namespace {

constexpr const char* sizes = "model.M is n x n and model.H m x n";

/// One for each constraint; a single number stands for all.
std::vector<double> read_restitution(const TomlValue& e, Scheme scheme, std::int64_t m) {
  std::vector<double> values(static_cast<std::size_t>(m), 0.0);
  if (e && e.is_number()) {
    values.assign(values.size(), e.number());
  } else if (e) {
    values = e.numbers();
    expect_length(e, values, m, "m");
  }
  for (const double value : values) {
    if (!(value >= 0.0 && value <= 1.0)) e.fail(fmt::format("has the value {}; expected 0 to 1", value));
    if (value != 0.0 && scheme == Scheme::homsp)
      e.fail(
          fmt::format("has the value {}; the scheme \"{}\" takes all velocity into the constraint and needs "
                      "0. Use \"moreau-jean\"",
                      value, name_of(scheme)));
  }
  return values;
}

/// Positive on the diagonal, symmetric; diagonal, where M^-1 K is asked for.
void check_mass(const TomlValue& key, const SparseEntries& M, Scheme scheme) {
  constexpr double rounding = 1e-14;  // of whoever computed the masses
  for (std::int64_t i = 0; i < M.rows; ++i) {
    const double diagonal = M.entry(i, i);
    if (!(diagonal > 0.0))
      key.fail(
          fmt::format("has [{}][{}] = {} on its diagonal; expected a mass, more than 0, as M is positive "
                      "definite",
                      i, i, diagonal));
    for (std::int64_t k = M.row_starts[static_cast<std::size_t>(i)];
         k < M.row_starts[static_cast<std::size_t>(i) + 1]; ++k) {
      const std::int64_t j = M.columns[static_cast<std::size_t>(k)];
      const double here = M.values[static_cast<std::size_t>(k)];
      if (std::abs(here - M.entry(j, i)) > rounding * diagonal)
        key.fail(fmt::format("is not symmetric: [{}][{}] = {}, but [{}][{}] = {}", i, j, here, j, i,
                             M.entry(j, i)));
      if (i != j && here != 0.0 && scheme != Scheme::moreau_jean)
        key.fail(fmt::format(
            "has [{}][{}] = {}, but the scheme \"{}\" needs it diagonal: M^-1 K would be dense. Use "
            "\"moreau-jean\", or lump the masses",
            i, j, here, name_of(scheme)));
    }
  }
}

void check_constraints(const TomlValue& key, const SparseEntries& H) {
  for (std::size_t a = 0; a + 1 < H.row_starts.size(); ++a) {
    bool any = false;
    for (std::int64_t k = H.row_starts[a]; k < H.row_starts[a + 1]; ++k)
      any = any || H.values[static_cast<std::size_t>(k)] != 0.0;
    if (!any) key.fail(fmt::format("has no entries in row {}; expected a constraint on some coordinate", a));
  }
}

std::vector<double> read_vector(const TomlValue& key, std::int64_t length, const char* what) {
  std::vector<double> values = key.numbers();
  expect_length(key, values, length, what);
  return values;
}

}  // namespace

LagrangianSpec read_lagrangian(const TomlValue& table, Scheme scheme, bool root) {
  const TomlValue M = table["M"], K = table["K"], C = table["Cv"], H = table["H"], q0 = table["q0"],
                  v0 = table["v0"], f = table["f"], g0 = table["g0"], e = table["e"];
  table.refuse_unknown();
  LagrangianSpec model;
  if (!root) return model;
  model.M = M.matrix();
  const std::int64_t n = model.M.rows;
  if (n < 1 || model.M.cols != n) M.fail(fmt::format("is {} x {}; expected n x n, n >= 1", n, model.M.cols));
  check_mass(M, model.M, scheme);
  model.K = K.matrix();
  expect_shape(K, model.K, n, n, sizes);
  if (C) {
    model.C = C.matrix();
    expect_shape(C, model.C, n, n, sizes);
  }
  model.H = H.matrix();
  const std::int64_t m = model.H.rows;
  if (m < 1) H.fail(fmt::format("is {} x {}; expected m x n with at least one constraint", m, model.H.cols));
  expect_shape(H, model.H, m, n, sizes);
  check_constraints(H, model.H);
  model.q0 = read_vector(q0, n, "n");
  model.v0 = read_vector(v0, n, "n");
  if (f) {
    model.f = f.signals();
    expect_length(f, model.f, n, "n");
  }
  model.g0 = g0 ? read_vector(g0, m, "m") : std::vector<double>(static_cast<std::size_t>(m), 0.0);
  model.e = read_restitution(e, scheme, m);
  return model;
}

}  // namespace sweepvi
