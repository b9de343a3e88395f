#include "model/builtin_elements.hpp"

#include <cmath>
#include <numbers>

#include "model/golden_fraction.hpp"

namespace sweepvi {

namespace {

using Range = Element::Range;
using Place = Element::Place;

/// The value of a key.
Coefficient key(int number) {
  return Coefficient::Formula([number](KeyValues k) { return k[static_cast<std::size_t>(number)]; });
}

/// value / (a key's value): a force on a mass.
Coefficient over(int number, double value = 1.0) {
  return Coefficient::Formula([=](KeyValues k) { return value / k[static_cast<std::size_t>(number)]; });
}

/// AB (65) with a coupling, r = 3:
///
///     z1' = z2,  z2' = z3,  z3' = a1 z1 + a2 z2 + a3 z3 + xi2 + S(z1)_i + force + lambda,
///     xi1' = xi2,  xi2' = -xi1 + z1,      w = z1.
Element jerk() {
  enum { z1, z2, z3, xi1, xi2 };
  enum { a1, a2, a3, base, spread };
  return {.name = "jerk",
          .states = {"z1", "z2", "z3", "xi1", "xi2"},
          .keys = {{"a1", -1.0}, {"a2", -1.0}, {"a3", -1.0}, {"base", 0.2}, {"spread", 0.8}},
          .terms = {{z1, z2, 1.0},
                    {z2, z3, 1.0},
                    {z3, z1, key(a1)},
                    {z3, z2, key(a2)},
                    {z3, z3, key(a3)},
                    {z3, xi2, 1.0},
                    {xi1, xi2, 1.0},
                    {xi2, z1, 1.0},
                    {xi2, xi1, -1.0}},
          .coupling = {{z3, 1.0, 0.0}},
          .readings = {{z1}},
          .pushes = {{z3, 1.0}},
          .forces = {{"force", 0.0, z3, 1.0}},
          .start = [](Place place, KeyValues k, std::span<double> x) {
            x[z1] = k[base] + k[spread] * golden_fraction(place.i);
          }};
}

/// A mass above a wall, r = 2:
///
///     mass q'' = -damping q' + S(q)_i + force + lambda,      w = q.
Element wall() {
  enum { q, v };
  enum { mass, damping, e, base, amplitude, waves };
  return {
      .name = "wall",
      .states = {"q", "v"},
      .layout = StateLayout::state_by_state,
      .keys = {{"mass", 1.0, Range::positive},
               {"damping", 0.0},
               {"e", 0.5, Range::unit},
               {"base", 0.1},
               {"amplitude", 0.05},
               {"waves", 3.0}},
      .restitution = e,
      .mass = mass,
      .terms = {{q, v, 1.0}, {v, v, Coefficient::Formula([](KeyValues k) { return -k[damping] / k[mass]; })}},
      .coupling = {{v, over(mass), 1.0}},
      .readings = {{q}},
      .pushes = {{v, over(mass)}},
      .forces = {{"force", -0.5, v, over(mass)}},
      .start = [](Place place, KeyValues k, std::span<double> x) {
        const double turns = k[waves] * static_cast<double>(place.i) / static_cast<double>(place.count);
        x[q] = k[base] + k[amplitude] * std::sin(2.0 * std::numbers::pi * turns);
      }};
}

/// A column of balls of length 1 on the ground, r = 2:
///
///     mass q'' = -mass gravity + force + lambda_i - lambda_{i+1},      w_0 = q_0,  w_i = q_i - q_{i-1} - 1.
Element contact() {
  enum { q, v };
  enum { mass, gravity, e };
  return {.name = "contact",
          .states = {"q", "v"},
          .layout = StateLayout::state_by_state,
          .keys = {{"mass", 1.0, Range::positive}, {"gravity", 1.0}, {"e", 0.0, Range::unit}},
          .restitution = e,
          .mass = mass,
          .terms = {{q, v, 1.0}},
          .readings = {{q, 1.0}, {q, -1.0, -1}},
          .offset = [](Place place, KeyValues) { return place.i == 0 ? 0.0 : -1.0; },
          .pushes = {{v, over(mass)}, {v, over(mass, -1.0), -1}},
          .loads = {{v, Coefficient::Formula([](KeyValues k) { return -k[gravity]; })}},
          .forces = {{"force", 0.0, v, over(mass)}},
          .start = [](Place place, KeyValues,
                      std::span<double> x) { x[q] = 1.05 * static_cast<double>(place.i) + 0.1; }};
}

/// A link q that may not pass a wall, behind a flexible joint; only its motor p can be pushed, r = 4:
///
///     mass q'' = joint (p - q) + S(q)_i - ground q - damping q' + force,      inertia p'' = joint (q - p) +
///     lambda, w = q.
///
/// When the link hits the wall, lambda holds derivatives of Dirac measures: the velocity of the link jumps,
/// and so do position and velocity of its motor. That is what a relative degree above 2 means. Motors of
/// other elements never jump.
Element flexible() {
  enum { q, p, dq, dp };
  enum { mass, inertia, joint, ground, damping, base, spread };
  return {
      .name = "flexible",
      .states = {"q", "p", "q'", "p'"},
      .keys = {{"mass", 1.0, Range::positive},
               {"inertia", 1.0, Range::positive},
               {"joint", 10.0, Range::positive},
               {"ground", 1.0},
               {"damping", 0.0},
               {"base", 0.5},
               {"spread", 0.1}},
      .terms = {{q, dq, 1.0},
                {p, dp, 1.0},
                {dq, q, Coefficient::Formula([](KeyValues k) { return -(k[joint] + k[ground]) / k[mass]; })},
                {dq, dq, Coefficient::Formula([](KeyValues k) { return -k[damping] / k[mass]; })},
                {dq, p, Coefficient::Formula([](KeyValues k) { return k[joint] / k[mass]; })},
                {dp, q, Coefficient::Formula([](KeyValues k) { return k[joint] / k[inertia]; })},
                {dp, p, Coefficient::Formula([](KeyValues k) { return -k[joint] / k[inertia]; })}},
      .coupling = {{dq, over(mass), 1.0}},
      .readings = {{q}},
      .pushes = {{dp, over(inertia)}},
      .forces = {{"force", -1.0, dq, over(mass)}},
      .start = [](Place place, KeyValues k, std::span<double> x) {
        x[q] = x[p] = k[base] + k[spread] * static_cast<double>(place.i % 3);
      }};
}

/// A ball of unit mass above its wall, integrated in the transformed coordinates of Zhuravlev and Ivanov; it
/// comes back with e = (1 - kappa)/(1 + kappa) of its velocity:
///
///     x'' = S(x)_i + force,      w = x.
Element zhuravlev_ivanov() {
  enum { x, velocity };
  enum { kappa, base, spread };
  return {.name = "zhuravlev-ivanov",
          .states = {"x", "x'"},
          .layout = StateLayout::state_by_state,
          .keys = {{"kappa", 0.5, Range::open_unit},
                   {"base", 1.0, Range::not_negative},
                   {"spread", 0.5, Range::not_negative}},
          .kappa = kappa,
          .terms = {{x, velocity, 1.0}},
          .coupling = {{velocity, 1.0, 0.0}},
          .readings = {{x}},
          .pushes = {{velocity, 1.0}},
          .forces = {{"force", -9.81, velocity, 1.0}},
          .start = [](Place place, KeyValues k, std::span<double> states) {
            states[x] = k[base] + k[spread] * golden_fraction(place.i);
          }};
}

}  // namespace

std::vector<Element> builtin_elements() {
  return {jerk(), wall(), contact(), flexible(), zhuravlev_ivanov()};
}

}  // namespace sweepvi
