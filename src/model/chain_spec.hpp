#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "io/sparse_entries.hpp"
#include "sweepvi/element.hpp"
#include "sweepvi/regulator.hpp"
#include "sweepvi/signal.hpp"

namespace sweepvi {

/// A value per element: one number for all, or one each.
template <class T>
struct PerElement {
  std::vector<T> values;  ///< length 1 or N
  const T& operator[](std::int64_t i) const {
    return values.size() == 1 ? values.front() : values[static_cast<std::size_t>(i)];
  }
};

enum class Topology { chain, ring, lattice };

/// `kind = "chain"`. Complete on every rank, but for `weights`.
struct ChainSpec {
  /// `count` elements with the standard values of their keys.
  static ChainSpec of(const Element& element, std::int64_t count);

  const Element* element = nullptr;
  std::int64_t count = 0;
  Topology topology = Topology::chain;
  std::array<std::int64_t, 2> shape = {0, 0};  ///< nx, ny of a lattice: element i = ix + nx iy
  double coupling = 0.0;                       ///< between neighbours
  std::optional<SparseEntries> weights;    ///< symmetric N x N, instead of coupling; entries on rank 0 only
  std::vector<PerElement<double>> keys;    ///< in the order of Element::keys
  std::vector<PerElement<Signal>> forces;  ///< in the order of Element::forces
  std::vector<double> phase_spread;        ///< of each of them over the elements [rad]
  std::optional<Regulator> regulator;      ///< of impact oscillators (Element::kappa)
  std::vector<double> x0;                  ///< in the order of /x, or empty: the element's default

  /// The k-th force on element i: its phase is larger by phase_spread frac(0.618... i).
  Signal force(std::size_t k, std::int64_t i) const;
};

}  // namespace sweepvi
