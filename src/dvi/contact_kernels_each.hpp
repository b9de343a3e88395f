#pragma once

#include <algorithm>

#include "dvi/contact_kernels.hpp"
#include "vi/lanes.hpp"

// The kernels, for each file that compiles them (lanes.hpp).
// NOLINTBEGIN(cert-dcl59-cpp,misc-definitions-in-headers,cppcoreguidelines-pro-type-member-init): as said;
// numbers are filled where they are made
namespace sweepvi {
namespace {

/// Calls each(a number of the kind to compute with, the first constraint of a pack).
template <class Each>
void each_pack(const ContactRun& run, Each&& each) {
  std::ptrdiff_t a = 0;
  for (; a + Lanes::width <= run.count; a += Lanes::width)
    each(Lanes(), a);
  for (; a < run.count; ++a)
    each(Single(), a);
}

template <class Number>
Number weight_of(const ContactRun& run, std::ptrdiff_t a) {
  return Number::load(run.weight + (run.same_weight ? 0 : a), 1);
}

/// Least H v_{k+1} where detected.
template <class Number>
Number rebound(const ContactRun& run, std::ptrdiff_t a) {
  return (Number(-0.0) - Number::load(run.e + (run.same_e ? 0 : a), 1)) * Number::load(run.velocity + a, 1);
}

void detect_contacts(const ContactRun& run, const ContactDetection& detection) {
  each_pack(run, [&](auto kind, std::ptrdiff_t a) {
    using Number = decltype(kind);
    const Number tested =
        Number::load(run.gap + a, 1) + Number(detection.ahead) * Number::load(run.velocity + a, 1);
    const typename Number::Mask reached = detection.strict ? tested < Number(0.0) : tested <= Number(0.0);
    const unsigned bits = reached.bits();
    const Number bound_before = Number::load(run.bound + a, 1);
    const unsigned before = (bound_before.absolute() < Number(detection.no_bound)).bits();
    const bool same = bits == before && !detection.afresh;
    for (int lane = 0; lane < (same ? 0 : Number::width); ++lane) {
      const bool is_reached = (bits >> lane & 1U) != 0;
      run.level[a + lane] = is_reached ? 2 : 1;
      run.side[a + lane] = is_reached ? 1 : 0;  // Side::lower
    }
    const Number weight = weight_of<Number>(run, a);
    const typename Number::Mask from_above = weight < Number(0.0);
    const Number none = Number::choose(from_above, Number(detection.no_bound), Number(-detection.no_bound));
    const Number bound = Number::choose(reached, rebound<Number>(run, a) / weight, none);
    bound.store(run.bound + a, 1);
    if (!from_above.any()) return bound.store(detection.lower + a, 1);
    Number::choose(from_above, Number(-detection.no_bound), bound).store(detection.lower + a, 1);
    Number::choose(from_above, bound, Number(detection.no_bound)).store(detection.upper + a, 1);
  });
}

void settle_contacts(const ContactRun& run, ContactSettling& settling) {
  each_pack(run, [&](auto kind, std::ptrdiff_t a) {
    using Number = decltype(kind);
    const Number u = Number::load(settling.u + a, 1);
    const Number terms = Number::load(settling.terms + a, 1);
    const Number bound = Number::load(run.bound + a, 1);
    terms.store(run.held_terms + a, 1);
    const Number distance = (u - bound).absolute();
    const typename Number::Mask moves =
        (distance <= Number(settling.near) * terms) & (Number(0.0) < distance);
    if (!moves.any()) return;
    settling.moved = true;
    Number::choose(moves, bound, u).store(settling.u + a, 1);
  });
}

/// A sum over packs, lane by lane.
class LaneSum {
public:
  void add(const Lanes& terms) { lanes_ = lanes_ + terms; }
  void add(Single term) { rest_ = rest_ + term; }
  double all() const {
    double sum = rest_[0];
    for (int lane = 0; lane < Lanes::width; ++lane)
      sum += lanes_[lane];
    return sum;
  }

private:
  Lanes lanes_ = 0.0;
  Single rest_ = 0.0;
};

/// The largest of 0 and what was taken.
class LaneMaximum {
public:
  void take(const Lanes& values) { lanes_ = Lanes::larger(lanes_, values); }
  void take(Single value) { rest_ = Single::larger(rest_, value); }
  double all() const {
    double largest = rest_[0];
    for (int lane = 0; lane < Lanes::width; ++lane)
      if (largest < lanes_[lane]) largest = lanes_[lane];
    return largest;
  }

private:
  Lanes lanes_ = 0.0;
  Single rest_ = 0.0;
};

void move_contacts(const ContactRun& run, ContactMotion& motion) {
  const double rest = 1.0 - motion.theta;
  const double ahead = motion.theta - 0.5;
  LaneSum dissipated, scheme;
  LaneMaximum deepest, fastest;
  each_pack(run, [&](auto kind, std::ptrdiff_t a) {
    using Number = decltype(kind);
    const Number u = Number::load(motion.u + a, 1);
    const Number weight = weight_of<Number>(run, a);
    const Number old = Number::load(run.velocity + a, 1);
    const typename Number::Mask holds = u == Number::load(run.bound + a, 1);
    const Number now = Number::choose(holds, rebound<Number>(run, a), weight * u);
    now.store(run.velocity + a, 1);
    fastest.take(now.absolute());

    const unsigned held = holds.bits();
    unsigned before = 0;
    for (int lane = 0; lane < Number::width; ++lane)
      before |= static_cast<unsigned>(run.contact[a + lane]) << lane;
    const Number offset = Number::load(run.offset + (run.same_offset ? 0 : a), 1);
    const Number apart = weight * Number::load(motion.q + a, 1) + offset;
    if (const unsigned goes_on = held & before; goes_on == 0) {
      apart.store(run.gap + a, 1);
    } else {
      const Number moved =
          Number::load(run.gap + a, 1) + Number(motion.h) * (Number(motion.theta) * now + Number(rest) * old);
      for (int lane = 0; lane < Number::width; ++lane)
        run.gap[a + lane] = (goes_on >> lane & 1U) != 0 ? moved[lane] : apart[lane];
    }
    deepest.take(Number(-0.0) - Number::load(run.gap + a, 1));
    if ((held | before) == 0) return;  // and there was no impulse
    const Number f = Number::load(motion.f + a, 1);
    const Number noise = Number(motion.noise) * Number::load(run.held_terms + a, 1);
    const typename Number::Mask pushes = holds & (noise * weight.absolute() < f * weight);
    const Number impulse =
        Number::choose(pushes, f / (Number::load(motion.scale + a, 1) * weight), Number(0.0));
    impulse.store(run.mu + 2 * a + 1, 2);
    dissipated.add(Number(0.5) * impulse * (old + now));
    scheme.add(Number(ahead) * impulse * (now - old));
    for (unsigned differ = held ^ before, lane = 0; differ != 0; differ >>= 1, ++lane)
      if ((differ & 1U) != 0)
        *motion.changed++ = run.first + static_cast<std::int32_t>(a) + static_cast<std::int32_t>(lane);
  });
  motion.dissipated += dissipated.all();
  motion.scheme += scheme.all();
  motion.deepest = std::max(motion.deepest, deepest.all());
  motion.fastest = std::max(motion.fastest, fastest.all());
}

}  // namespace
}  // namespace sweepvi
// NOLINTEND(cert-dcl59-cpp,misc-definitions-in-headers,cppcoreguidelines-pro-type-member-init)
