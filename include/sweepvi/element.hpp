#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "sweepvi/linear_system.hpp"

namespace sweepvi {

/// The values of one element's keys, in the order of Element::keys: an enum of them is the way to name them.
using KeyValues = std::span<const double>;

/// A number in an element's equations: a constant, or computed from the element's keys.
class Coefficient {
public:
  using Formula = std::function<double(KeyValues)>;
  Coefficient(double constant) : constant_(constant) {}
  Coefficient(Formula formula) : formula_(std::move(formula)) {}
  double operator()(KeyValues keys) const { return formula_ ? formula_(keys) : constant_; }

private:
  double constant_ = 0.0;
  Formula formula_;
};

/// What a chain is made of: `kind = "chain"`, `element = name`. With the states x_i of element i, i = 0 ...
/// N-1, and one constraint each,
///
///     x_i' = T x_i + e_c c S(w)_i + loads + forces(t) + pushes,       w_i = readings + offset,
///     S(w)_i = sum_j k_ij (w_j - w_i)  [- k w_i for each neighbour missing at an end],
///
/// where T is `terms`, (e_c, c) is `coupling`, and lambda_i acts by `pushes`. Rows, columns and states are
/// numbers into `states`; formulas see the keys of the element whose row they stand in. An element is one
/// such table, and may leave out what it has not; register_element() makes it known to scenes.
struct Element {
  /// What a key's value may be.
  enum class Range { any, positive, not_negative, unit, open_unit };  ///< unit: from 0 to 1

  struct Key {
    std::string name;
    double standard = 0.0;  ///< where the scene says nothing
    Range range = Range::any;
  };
  /// x_row' gets value x_column.
  struct Term {
    int row = 0, column = 0;
    Coefficient value;
  };
  struct Coupling {
    int row = 0;
    Coefficient factor;     ///< of S(w)_i in x_row'
    double standard = 0.0;  ///< the scene key `coupling` where the scene says nothing
  };
  /// w_i gets value x_state of element i + shift; nothing where there is no such element.
  struct Reading {
    int state = 0;
    double value = 1.0;
    int shift = 0;
  };
  /// lambda_i moves x_state' of element i + shift by value; nothing where there is no such element.
  struct Push {
    int state = 0;
    Coefficient value;
    int shift = 0;
  };
  /// A constant: x_row' gets value.
  struct Load {
    int row = 0;
    Coefficient value;
  };
  /// A scene key that may be a signal: x_row' gets factor times it.
  struct Force {
    std::string name;
    double standard = 0.0;
    int row = 0;
    Coefficient factor;
  };
  /// Where in the chain an element stands.
  struct Place {
    std::int64_t i = 0, count = 0;
  };

  std::string name = {};
  std::vector<std::string> states = {};  ///< as `names` of /x has them
  StateLayout layout = StateLayout::element_by_element;
  std::vector<Key> keys = {};
  std::optional<std::size_t> restitution = {};  ///< the key that is Newton's: schemes without it take only 0
  /// The key that is its mass, where states are (q, v) with q' = v, w reads q and lambda_i pushes v as the
  /// transpose of that, over the mass: what moreau-jean needs to see M, K and C.
  std::optional<std::size_t> mass = {};
  /// The key that is kappa = (1 - e)/(1 + e): such an element is an impact oscillator, with the states x, x'
  /// and w = x, for the scheme zhuravlev_ivanov and no other.
  std::optional<std::size_t> kappa = {};
  std::vector<Term> terms = {};
  std::optional<Coupling> coupling = {};  ///< none: no `coupling` key, and a chain is the only topology
  std::vector<Reading> readings = {};     ///< with `coupling` only of the element itself
  std::function<double(Place, KeyValues)> offset = {};  ///< of w_i; empty: 0. Not with `coupling`
  std::vector<Push> pushes = {};
  std::vector<Load> loads = {};
  std::vector<Force> forces = {};
  /// Default initial data: fills the states of one element, which come as 0.
  std::function<void(Place, KeyValues, std::span<double> x)> start = {};
};

/// Makes an element known to scenes, for the rest of the process. Call it before a scene is read, on every
/// rank alike, from one thread.
/// @throws Error (bad_input) if the name is taken, or names or numbers in the table make no sense; says which
void register_element(Element element);

/// The element of that name, or null. It stays where it is. @note Not collective.
const Element* find_element(const std::string& name);

/// All names: built in, then as registered. @note Not collective.
std::vector<std::string> element_names();

}  // namespace sweepvi
