#include "io/scene_chain.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "io/scene_model.hpp"
#include "parallel/gather.hpp"

namespace sweepvi {

namespace {

std::vector<double> values_of(const TomlValue& key, double /*kind*/) {
  return key.numbers();
}
std::vector<Signal> values_of(const TomlValue& key, const Signal& /*kind*/) {
  return key.signals();
}
double value_of(const TomlValue& key, double /*kind*/) {
  return key.number();
}
Signal value_of(const TomlValue& key, const Signal& /*kind*/) {
  return key.signal();
}

/// A number (or signal) for all elements, or one each.
template <class T>
void read_per_element(const TomlValue& key, std::int64_t count, PerElement<T>& element) {
  if (!key) return;
  if (!key.is_array() && !key.names_file()) {
    element = {{value_of(key, T{})}};
    return;
  }
  element = {values_of(key, T{})};
  if (!key.elsewhere() && static_cast<std::int64_t>(element.values.size()) != count)
    key.fail(fmt::format("has {} entries; expected a single value, or model.count = {} entries",
                         element.values.size(), count));
}

bool contains(Element::Range range, double value) {
  switch (range) {
    case Element::Range::any:
      return true;
    case Element::Range::positive:
      return value > 0.0;
    case Element::Range::not_negative:
      return value >= 0.0;
    case Element::Range::unit:
      return value >= 0.0 && value <= 1.0;
    case Element::Range::open_unit:
      return value > 0.0 && value < 1.0;
  }
  return false;
}

const char* text_of(Element::Range range) {
  switch (range) {
    case Element::Range::any:
      return "any number";
    case Element::Range::positive:
      return "more than 0";
    case Element::Range::not_negative:
      return "0 or more";
    case Element::Range::unit:
      return "0 to 1";
    case Element::Range::open_unit:
      return "more than 0 and less than 1";
  }
  return "";
}

/// "= -1", or "has entry 3 = -1" where there are several.
std::string found(const PerElement<double>& element, std::size_t i) {
  return element.values.size() == 1 ? fmt::format("= {}", element.values[i])
                                    : fmt::format("has entry {} = {}", i, element.values[i]);
}

void check_range(const TomlValue& key, Element::Range range, const PerElement<double>& element) {
  for (std::size_t i = 0; i < element.values.size(); ++i)
    if (!contains(range, element.values[i]))
      key.fail(fmt::format("{}; expected {}", found(element, i), text_of(range)));
}

/// Only moreau-jean lets a mass bounce.
void check_restitution(const TomlValue& key, Scheme scheme, const PerElement<double>& element) {
  if (scheme == Scheme::moreau_jean || scheme == Scheme::hybrid) return;
  for (std::size_t i = 0; i < element.values.size(); ++i)
    if (element.values[i] != 0.0)
      key.fail(fmt::format(
          "{}{}; the scheme \"{}\" takes all velocity into the wall and needs 0. Write {} = 0, or use "
          "time.scheme = \"moreau-jean\"",
          found(element, i), key ? "" : " unless the scene says otherwise", name_of(scheme), key.name()));
}

const Element& read_element(const TomlValue& element) {
  return *find_element(element.choice(element_names(), false));
}

std::int64_t read_count(const TomlValue& count, std::size_t states, Topology topology) {
  const std::int64_t value = count.integer();
  const bool ring = topology == Topology::ring;
  const std::int64_t least = ring ? 3 : 1;
  // A step has at most as many multipliers as states.
  const std::int64_t most = std::numeric_limits<PetscInt>::max() / (2 * static_cast<std::int64_t>(states));
  if (value < least)
    count.fail(fmt::format("= {}; expected at least {}{}", value, least, ring ? " in a ring" : ""));
  if (value > most)
    count.fail(fmt::format("= {}; expected at most {}, with {} states each and unknowns counted in {} bits",
                           value, most, states, 8 * sizeof(PetscInt)));
  return value;
}

Topology read_topology(const TomlValue& topology, const Element& element) {
  const std::string name = topology.choice({"chain", "ring", "lattice"}, true);
  if (name != "chain" && !element.coupling)
    topology.fail(fmt::format("= \"{}\"; the element \"{}\" only makes a \"chain\", leave topology out", name,
                              element.name));
  if (name == "ring") return Topology::ring;
  return name == "lattice" ? Topology::lattice : Topology::chain;
}

std::array<std::int64_t, 2> read_shape(const TomlValue& shape, Topology topology, std::int64_t count) {
  if (topology != Topology::lattice) {
    if (shape) shape.fail("goes with topology = \"lattice\" only; leave it out, or ask for a lattice");
    return {0, 0};
  }
  if (!shape)
    shape.fail(fmt::format("is missing; a lattice needs shape = [nx, ny] with nx ny = count = {}", count));
  const std::vector<double> sizes = shape.is_array() ? shape.numbers() : std::vector<double>{};
  const auto is_size = [&](double size) {
    return size >= 1.0 && size == std::round(size) && size <= static_cast<double>(count);
  };
  if (sizes.size() != 2 || !is_size(sizes[0]) || !is_size(sizes[1]) ||
      sizes[0] * sizes[1] != static_cast<double>(count))
    shape.fail(fmt::format("{}; expected [nx, ny], integers from 1, with nx ny = model.count = {}",
                           shape.is_array() ? fmt::format("= [{}]", fmt::join(sizes, ", ")) : "is no list",
                           count));
  return {static_cast<std::int64_t>(sizes[0]), static_cast<std::int64_t>(sizes[1])};
}

void check_weights(const TomlValue& key, const SparseEntries& weights, std::int64_t count) {
  if (weights.rows != count || weights.cols != count)
    key.fail(fmt::format("is {} x {}; expected a number, or model.count x model.count = {} x {}",
                         weights.rows, weights.cols, count, count));
  constexpr double rounding = 1e-14;  // of whoever computed the weights
  for (std::int64_t i = 0; i < count; ++i) {
    for (std::int64_t k = weights.row_starts[static_cast<std::size_t>(i)];
         k < weights.row_starts[static_cast<std::size_t>(i) + 1]; ++k) {
      const std::int64_t j = weights.columns[static_cast<std::size_t>(k)];
      const double here = weights.values[static_cast<std::size_t>(k)];
      if (i == j && here != 0.0)
        key.fail(
            fmt::format("has the diagonal entry [{}][{}] = {}, which couples an element to itself; "
                        "expected 0, as S(w)_i is the sum of k_ij (w_j - w_i)",
                        i, i, here));
      const double there = weights.entry(j, i);
      if (std::abs(here - there) > rounding * std::abs(here))
        key.fail(fmt::format(
            "is not symmetric: [{}][{}] = {}, but [{}][{}] = {}; expected equal weights both ways", i, j,
            here, j, i, there));
    }
  }
}

/// `coupling`, a number or a matrix, with what belongs to the one and not to the other.
void read_coupling(const TomlValue& table, bool root, ChainSpec& chain) {
  if (!chain.element->coupling) return;
  const TomlValue coupling = table["coupling"], topology = table["topology"], shape = table["shape"];
  if (!coupling.is_array() && !coupling.names_file()) {
    chain.shape = read_shape(shape, chain.topology, chain.count);
    chain.coupling = coupling.number_or(chain.coupling);
    return;
  }
  for (const TomlValue& other : {topology, shape})
    if (other)
      other.fail("goes with a coupling that is a number; a matrix says itself who is coupled, leave it out");
  chain.weights.emplace();
  if (!root) return;
  chain.weights = coupling.matrix();
  check_weights(coupling, *chain.weights, chain.count);
}

/// Positions come first.
void check_above_wall(const TomlValue& key, const std::vector<double>& x0, std::int64_t count) {
  const auto last = x0.begin() + std::min(count, static_cast<std::int64_t>(x0.size()));
  const auto below = std::find_if(x0.begin(), last, [](double x) { return x < 0.0; });
  if (below != last)
    key.fail(fmt::format("has entry {} = {}; expected 0 or more, as the wall is x = 0",
                         std::distance(x0.begin(), below), *below));
}

/// Asks for each key the element has, so that all others are unknown.
void ask(const TomlValue& table, const Element& element) {
  std::vector<std::string> names = {"count", "x0", "topology"};
  if (element.coupling) names.insert(names.end(), {"coupling", "shape"});
  if (element.kappa) names.emplace_back("regulator");
  for (const std::string& name : names)
    table[name];
  for (const Element::Force& force : element.forces)
    table[force.name];
  for (const Element::Key& key : element.keys)
    table[key.name];
}

}  // namespace

std::vector<Scheme> chain_schemes(const TomlValue& table) {
  if (read_element(table["element"]).kappa) return {Scheme::zhuravlev_ivanov, Scheme::hybrid};
  std::vector<Scheme> schemes = {Scheme::homsp, Scheme::zd_euler, Scheme::naive_euler, Scheme::hybrid};
  if (read_element(table["element"]).mass) schemes.push_back(Scheme::moreau_jean);
  return schemes;
}

ChainSpec read_chain(const TomlValue& table, Scheme scheme, bool root) {
  const Element& element = read_element(table["element"]);
  ask(table, element);
  table.refuse_unknown();
  const Topology topology = read_topology(table["topology"], element);
  const std::size_t states = element.states.size();
  ChainSpec chain = ChainSpec::of(element, read_count(table["count"], states, topology));
  chain.topology = topology;
  read_coupling(table, root, chain);
  for (std::size_t k = 0; k < element.keys.size(); ++k) {
    const TomlValue key = table[element.keys[k].name];
    read_per_element(key, chain.count, chain.keys[k]);
    check_range(key, element.keys[k].range, chain.keys[k]);
    if (element.restitution == k) check_restitution(key, scheme, chain.keys[k]);
  }
  for (std::size_t k = 0; k < element.forces.size(); ++k) {
    const TomlValue key = table[element.forces[k].name];
    if (key.is_table() && !key.names_file())
      chain.forces[k] = {{key.signal(chain.phase_spread[k])}};
    else
      read_per_element(key, chain.count, chain.forces[k]);
  }
  if (const TomlValue regulator = table["regulator"]) chain.regulator = read_regulator(regulator);
  if (const TomlValue x0 = table["x0"]) {
    chain.x0 = x0.numbers();
    const std::int64_t length = static_cast<std::int64_t>(states) * chain.count;
    if (!x0.elsewhere() && static_cast<std::int64_t>(chain.x0.size()) != length)
      x0.fail(fmt::format("has {} entries; expected {} model.count = {}", chain.x0.size(), states, length));
    if (element.kappa) check_above_wall(x0, chain.x0, chain.count);
  }
  return chain;
}

void share(MPI_Comm comm, ChainSpec& chain) {
  for (PerElement<double>& key : chain.keys)
    broadcast(comm, key.values);
  for (PerElement<Signal>& force : chain.forces)
    broadcast(comm, force.values);
  broadcast(comm, chain.x0);
}

}  // namespace sweepvi
