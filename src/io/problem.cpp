#include <fmt/format.h>

#include <limits>

#include "io/scene.hpp"
#include "io/toml_table.hpp"

namespace sweepvi {

namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

void expect_length(const TomlValue& key, const std::vector<double>& found, std::size_t n) {
  if (found.size() != n)
    key.fail(fmt::format("has {} entries; expected n = {} as in problem.M", found.size(), n));
}

std::vector<double> read_bounds(const TomlValue& key, double otherwise, std::size_t n) {
  if (!key || key.is_number()) return std::vector<double>(n, key ? key.number_or_infinity() : otherwise);
  std::vector<double> bounds = key.numbers_or_infinity();
  expect_length(key, bounds, n);
  return bounds;
}

void read_document(const TomlValue& document, Problem& problem) {
  const TomlValue table = document["problem"];
  document.refuse_unknown();
  const TomlValue M = table["M"], q = table["q"], lower = table["lower"], upper = table["upper"],
                  u0 = table["u0"], terms = table["terms"];
  table.refuse_unknown();
  problem.M = M.matrix();
  if (problem.M.rows < 1 || problem.M.rows != problem.M.cols)
    M.fail(fmt::format("is {} x {}; expected n x n, n >= 1", problem.M.rows, problem.M.cols));
  const auto n = static_cast<std::size_t>(problem.M.rows);
  problem.q = q.numbers();
  expect_length(q, problem.q, n);
  problem.lower = read_bounds(lower, 0.0, n);
  problem.upper = read_bounds(upper, infinity, n);
  for (std::size_t i = 0; i < n; ++i) {
    const TomlValue& key = lower ? lower : upper;
    if (problem.lower[i] > problem.upper[i] || problem.lower[i] == infinity || problem.upper[i] == -infinity)
      key.fail(fmt::format("leaves no room for u[{}]: lower = {}, upper = {}", i, problem.lower[i],
                           problem.upper[i]));
  }
  problem.u0 = u0 ? u0.numbers() : std::vector<double>(n, 0.0);
  expect_length(u0, problem.u0, n);
  problem.terms = terms ? terms.numbers() : std::vector<double>(n, 0.0);
  expect_length(terms, problem.terms, n);
  for (std::size_t i = 0; i < n; ++i)
    if (problem.terms[i] < 0.0)
      terms.fail(fmt::format("has entry {} = {}; expected >= 0", i, problem.terms[i]));
}

}  // namespace

Problem read_problem(MPI_Comm comm, const std::string& path) {
  Problem problem;
  problem.path = path;
  problem.text = read_shared_text(comm, path);
  int rank = 0;
  MPI_Comm_rank(comm, &rank);
  agreed(comm, [&] {
    if (rank == 0) read_document(TomlValue::parse(path, problem.text, {}, true), problem);
  });
  return problem;
}

}  // namespace sweepvi
