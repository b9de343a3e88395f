// ranks: 1
#include "dvi/contact_kernels.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <random>
#include <vector>

namespace sweepvi {
namespace {

constexpr std::size_t size = 29;  // three packs, and some by themselves
constexpr std::int32_t first = 4;
constexpr double infinite = 1e300;
constexpr double near = 1e-12;
constexpr double h = 0.01;

/// Constraints with all that may happen to them: gaps on both sides of 0 and at it, upper and lower bounds,
/// velocities on their bound, near it and elsewhere, forces that push, pull, and are no more than rounding.
struct Contacts {
  std::vector<double> gap, velocity, e, weight, offset, bound, held_terms, u, f, q, scale, terms, lower,
      upper, mu;
  std::vector<int> level;
  std::vector<signed char> side;
  std::vector<char> contact;
  std::vector<std::int32_t> changed;

  Contacts()
      : bound(size),
        held_terms(size),
        lower(size, -infinite),
        upper(size, infinite),
        mu(2 * size),
        level(size),
        side(size) {
    std::mt19937 engine(7);
    const auto pick = [&](std::vector<double> from) { return from[engine() % from.size()]; };
    const auto between = [&](double least, double most) {
      return std::uniform_real_distribution<double>(least, most)(engine);
    };
    for (std::size_t a = 0; a < size; ++a) {
      velocity.push_back(pick({0.0, -1.5, 2.0, between(-1, 1)}));
      gap.push_back(pick({0.0, -0.01 * velocity[a], 0.3, between(-0.02, 0.02)}));
      e.push_back(pick({0.0, 0.5, 1.0}));
      weight.push_back(a < 8 ? 1.0 : pick({1.0, -1.0, -0.7}));
      offset.push_back(pick({0.0, between(-1, 1)}));
      q.push_back(between(-1, 1));
      scale.push_back(between(0.5, 2));
      terms.push_back(between(1, 5));
      f.push_back(pick({between(-3, 3), between(0, 3), -between(0, 3), 1e-14, -1e-14}));
      contact.push_back(static_cast<char>(engine() % 2));
      mu[2 * a + 1] = contact[a] != 0 ? 0.25 : 0.0;
    }
  }

  ContactRun run() {
    return {.count = static_cast<std::ptrdiff_t>(size),
            .first = first,
            .gap = gap.data(),
            .velocity = velocity.data(),
            .e = e.data(),
            .level = level.data(),
            .side = side.data(),
            .contact = contact.data(),
            .mu = mu.data(),
            .weight = weight.data(),
            .offset = offset.data(),
            .bound = bound.data(),
            .held_terms = held_terms.data()};
  }
  void detect(const ContactKernels& kernels, bool strict, bool afresh = true) {
    ContactDetection detection{.ahead = h, .strict = strict, .afresh = afresh, .no_bound = infinite};
    detection.lower = lower.data();
    detection.upper = upper.data();
    kernels.detect(run(), detection);
  }
  /// Where they end without impulse, but on, near and off their bound in turn where there is one.
  void fly() {
    for (std::size_t a = 0; a < size; ++a) {
      const double steps[] = {0.0, 0.5 * near * terms[a], 3.0 * near * terms[a], 0.2};
      u.push_back(level[a] == 2 ? bound[a] + steps[a % 4] : velocity[a] + 0.125);
    }
  }
  bool settle(const ContactKernels& kernels) {
    ContactSettling settling{.near = near, .u = u.data(), .terms = terms.data()};
    kernels.settle(run(), settling);
    return settling.moved;
  }
  ContactMotion move(const ContactKernels& kernels, double theta) {
    changed.assign(size, -1);
    ContactMotion motion{.h = h, .theta = theta, .noise = near};
    motion.u = u.data();
    motion.f = f.data();
    motion.q = q.data();
    motion.scale = scale.data();
    motion.changed = changed.data();
    kernels.move(run(), motion);
    changed.resize(static_cast<std::size_t>(motion.changed - changed.data()));
    return motion;
  }
};

std::vector<const ContactKernels*> all_kernels() {
  std::vector<const ContactKernels*> all = {&detail::plain_contact_kernels};
  if (&contact_kernels() != all.front()) all.push_back(&contact_kernels());
  return all;
}

TEST(ContactKernels, DetectWhatIsReached) {
  for (const ContactKernels* kernels : all_kernels()) {
    for (const bool strict : {false, true}) {
      Contacts contacts;
      contacts.detect(*kernels, strict);
      int detected = 0;
      for (std::size_t a = 0; a < size; ++a) {
        SCOPED_TRACE(a);
        const double tested = contacts.gap[a] + h * contacts.velocity[a];
        const bool reached = strict ? tested < 0.0 : tested <= 0.0;
        detected += reached ? 1 : 0;
        EXPECT_EQ(contacts.level[a], reached ? 2 : 1);
        EXPECT_EQ(contacts.side[a], reached ? 1 : 0);
        const bool from_above = contacts.weight[a] < 0.0;
        const double bound = -contacts.e[a] * contacts.velocity[a] / contacts.weight[a];
        EXPECT_EQ(contacts.lower[a], reached && !from_above ? bound : -infinite);
        EXPECT_EQ(contacts.upper[a], reached && from_above ? bound : infinite);
      }
      EXPECT_GT(detected, 5);
      EXPECT_LT(detected, 24);
      // What differs from the last time is written.
      for (std::size_t a = 0; a < size; a += 3)
        contacts.gap[a] = contacts.level[a] == 2 ? 1.0 : -1.0;
      Contacts all = contacts;
      contacts.detect(*kernels, strict, false);
      all.detect(*kernels, strict, true);
      EXPECT_EQ(contacts.level, all.level);
      EXPECT_EQ(contacts.side, all.side);
      EXPECT_EQ(contacts.bound, all.bound);
    }
  }
}

TEST(ContactKernels, PutWhatIsNearOnItsBound) {
  for (const ContactKernels* kernels : all_kernels()) {
    Contacts contacts;
    contacts.detect(*kernels, false);
    contacts.fly();
    const std::vector<double> before = contacts.u;
    EXPECT_TRUE(contacts.settle(*kernels));
    int put = 0;
    for (std::size_t a = 0; a < size; ++a) {
      const double distance = std::abs(before[a] - contacts.bound[a]);
      const bool is_near = contacts.level[a] == 2 && distance <= near * contacts.terms[a];
      put += is_near && distance > 0.0 ? 1 : 0;
      EXPECT_EQ(contacts.u[a], is_near ? contacts.bound[a] : before[a]);
    }
    EXPECT_GT(put, 0);
    EXPECT_EQ(contacts.held_terms, contacts.terms);
    EXPECT_FALSE(contacts.settle(*kernels));
  }
}

TEST(ContactKernels, MoveThemAndTellWhatChanged) {
  for (const ContactKernels* kernels : all_kernels()) {
    for (const double theta : {0.5, 0.8}) {
      Contacts contacts;
      contacts.detect(*kernels, false);
      contacts.fly();
      contacts.settle(*kernels);
      const Contacts before = contacts;
      const ContactMotion motion = contacts.move(*kernels, theta);
      std::vector<std::int32_t> changed;
      double dissipated = 0.0;
      double scheme = 0.0;
      double fastest = 0.0;
      int pushed = 0;
      int going_on = 0;
      for (std::size_t a = 0; a < size; ++a) {
        SCOPED_TRACE(a);
        const double old = before.velocity[a];
        const bool holds = before.level[a] == 2 && before.u[a] == before.bound[a];
        const double now = holds ? -before.e[a] * old : before.weight[a] * before.u[a];
        const double force = before.f[a] * before.weight[a];
        const bool pushes = holds && force > near * before.terms[a] * std::abs(before.weight[a]);
        const double impulse = pushes ? before.f[a] / (before.scale[a] * before.weight[a]) : 0.0;
        pushed += pushes ? 1 : 0;
        EXPECT_EQ(contacts.velocity[a], now);
        const bool goes_on = holds && before.contact[a] != 0;
        EXPECT_EQ(contacts.gap[a], goes_on ? before.gap[a] + h * (theta * now + (1.0 - theta) * old)
                                           : before.weight[a] * before.q[a] + before.offset[a]);
        going_on += goes_on ? 1 : 0;
        fastest = std::max(fastest, std::abs(now));
        EXPECT_EQ(contacts.mu[2 * a], 0.0);
        EXPECT_EQ(contacts.mu[2 * a + 1], impulse);
        dissipated += 0.5 * impulse * (old + now);
        scheme += (theta - 0.5) * impulse * (now - old);
        if (holds != (before.contact[a] != 0)) changed.push_back(first + static_cast<std::int32_t>(a));
      }
      EXPECT_GT(pushed, 1);
      EXPECT_GT(going_on, 1);
      EXPECT_EQ(motion.fastest, fastest);
      EXPECT_GT(changed.size(), 5U);
      EXPECT_EQ(contacts.changed, changed);
      EXPECT_NEAR(motion.dissipated, dissipated, 1e-14);  // some tens of terms of 1, in another order
      EXPECT_NEAR(motion.scheme, scheme, 1e-14);
      EXPECT_EQ(motion.deepest, -*std::min_element(contacts.gap.begin(), contacts.gap.end()));
    }
  }
}

// Sums, too: they are made in the same order.
TEST(ContactKernels, AreTheSameToTheBit) {
  if (all_kernels().size() == 1) GTEST_SKIP() << "there are no others here";
  std::vector<ContactMotion> motions;
  for (const ContactKernels* kernels : all_kernels()) {
    Contacts contacts;
    contacts.detect(*kernels, false);
    contacts.fly();
    contacts.settle(*kernels);
    motions.push_back(contacts.move(*kernels, 0.8));
  }
  EXPECT_EQ(motions[0].dissipated, motions[1].dissipated);
  EXPECT_EQ(motions[0].scheme, motions[1].scheme);
}

}  // namespace
}  // namespace sweepvi
