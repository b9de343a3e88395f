#include "sweepvi/element.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <deque>
#include <utility>

#include "model/builtin_elements.hpp"
#include "sweepvi/error.hpp"

namespace sweepvi {

namespace {

/// Grows at its end only: elements stay where they are.
std::deque<Element>& registry() {
  static std::deque<Element> elements = [] {
    std::vector<Element> builtin = builtin_elements();
    return std::deque<Element>(std::make_move_iterator(builtin.begin()),
                               std::make_move_iterator(builtin.end()));
  }();
  return elements;
}

[[noreturn]] void refuse(const Element& element, const std::string& complaint) {
  throw InputError(fmt::format("element \"{}\" {}", element.name, complaint));
}

void check_names(const Element& element) {
  std::vector<std::string> names = {"kind", "element", "count", "coupling", "topology", "shape", "x0"};
  for (const Element::Key& key : element.keys)
    names.push_back(key.name);
  for (const Element::Force& force : element.forces)
    names.push_back(force.name);
  std::sort(names.begin(), names.end());
  if (names.front().empty()) refuse(element, "has a key without a name; every key of a scene needs one");
  const auto twice = std::adjacent_find(names.begin(), names.end());
  if (twice != names.end())
    refuse(element,
           fmt::format("has the key '{}', which it or every chain has already; choose another", *twice));
}

void check_states(const Element& element) {
  const auto known = [&](const char* where, int state) {
    if (state < 0 || static_cast<std::size_t>(state) >= element.states.size())
      refuse(element, fmt::format("names state {} in {}; expected 0 to {}, as it has {} states", state, where,
                                  static_cast<int>(element.states.size()) - 1, element.states.size()));
  };
  for (const Element::Term& term : element.terms) {
    known("the row of a term", term.row);
    known("the column of a term", term.column);
  }
  for (const Element::Reading& reading : element.readings)
    known("a reading", reading.state);
  for (const Element::Push& push : element.pushes)
    known("a push", push.state);
  for (const Element::Load& load : element.loads)
    known("a load", load.row);
  for (const Element::Force& force : element.forces)
    known("a force", force.row);
  if (element.coupling) known("the coupling", element.coupling->row);
}

/// States (q, v), q' = v alone; w reads q, lambda pushes v.
void check_mechanics(const Element& element) {
  const auto of = [](const auto& entries, int row) {
    return std::count_if(entries.begin(), entries.end(),
                         [row](const auto& entry) { return entry.row == row; });
  };
  const bool kinematic =
      element.states.size() == 2 && of(element.terms, 0) == 1 && of(element.loads, 0) == 0 &&
      of(element.forces, 0) == 0 && !(element.coupling && element.coupling->row == 0) &&
      std::all_of(element.terms.begin(), element.terms.end(),
                  [](const Element::Term& term) { return term.row != 0 || term.column == 1; });
  const bool reads_q = std::all_of(element.readings.begin(), element.readings.end(),
                                   [](const Element::Reading& reading) { return reading.state == 0; });
  const bool pushes_v = std::all_of(element.pushes.begin(), element.pushes.end(),
                                    [](const Element::Push& push) { return push.state == 1; });
  if (!kinematic || !reads_q || !pushes_v)
    refuse(element, "has a mass, so its states must be (q, v) with q' = v, w must read q and lambda push v");
}

void check_constraint(const Element& element) {
  if (element.readings.empty()) refuse(element, "has no readings; its constraint w needs at least one");
  if (element.pushes.empty()) refuse(element, "has no pushes; its lambda needs at least one");
  for (const auto& [number, role] : {std::pair{element.restitution, "restitution"},
                                     std::pair{element.mass, "mass"}, std::pair{element.kappa, "kappa"}})
    if (number && *number >= element.keys.size())
      refuse(element,
             fmt::format("takes key {} as its {}; it has {} keys", *number, role, element.keys.size()));
  if (element.mass) check_mechanics(element);
  if (!element.coupling) return;
  const bool own = std::all_of(element.readings.begin(), element.readings.end(),
                               [](const Element::Reading& reading) { return reading.shift == 0; });
  if (!own || element.offset)
    refuse(element, "has a coupling and a w with an offset or of other elements; S(w) is for w = own states");
}

}  // namespace

void register_element(Element element) {
  if (element.name.empty()) refuse(element, "has no name; scenes need one");
  if (find_element(element.name) != nullptr) refuse(element, "is registered already; choose another name");
  check_names(element);
  check_states(element);
  check_constraint(element);
  registry().push_back(std::move(element));
}

const Element* find_element(const std::string& name) {
  for (const Element& element : registry())
    if (element.name == name) return &element;
  return nullptr;
}

std::vector<std::string> element_names() {
  std::vector<std::string> names;
  for (const Element& element : registry())
    names.push_back(element.name);
  return names;
}

}  // namespace sweepvi
