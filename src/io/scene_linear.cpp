#include <algorithm>
#include <cmath>
#include <limits>

#include "io/scene_checks.hpp"
#include "io/scene_model.hpp"

namespace sweepvi {

namespace {

constexpr const char* sizes = "model.A is n x n and model.B n x m";

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

/// Empty if absent: to be found from the matrices.
std::vector<int> read_relative_degree(const TomlValue& stated, std::int64_t n, std::int64_t m, bool has_D) {
  if (!stated) return {};
  std::vector<double> values;
  if (stated.is_number())
    values = {stated.number()};
  else
    values = stated.numbers();
  if (values.size() != 1) expect_length(stated, values, m, "m, or one for all constraints");
  std::vector<int> degrees;
  for (const double value : values) {
    if (!(value >= (has_D ? 0 : 1) && value <= static_cast<double>(n) && value == std::floor(value)))
      stated.fail(
          fmt::format("has the entry {}; expected the relative degree of a constraint, an integer from {} "
                      "to n = {}",
                      value, has_D ? 0 : 1, n));
    degrees.push_back(static_cast<int>(value));
  }
  return degrees;
}

}  // namespace

LinearSpec read_linear(const TomlValue& table, bool root) {
  const TomlValue A = table["A"], B = table["B"], C = table["C"], D = table["D"], f = table["f"],
                  w0 = table["w0"], x0 = table["x0"], wmax = table["wmax"],
                  relative_degree = table["relative_degree"];
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
  expect_shape(B, model.B, n, m, sizes);
  model.C = C.matrix();
  expect_shape(C, model.C, m, n, sizes);
  if (D) {
    model.D = D.matrix();
    expect_shape(D, *model.D, m, m, sizes);
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
  model.relative_degree = read_relative_degree(relative_degree, n, m, static_cast<bool>(D));
  return model;
}

}  // namespace sweepvi
