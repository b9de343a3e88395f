#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "sweepvi/lagrangian.hpp"

namespace sweepvi {

/// Gaps of the constraints a rank owns, their velocities and impulses, carried from step to step by Moreau
/// and Jean's scheme. What Newton's law holds is exact here, so that detection never sees a residue.
struct ContactState {
  std::vector<double> gap;       ///< g at the time reached
  std::vector<double> velocity;  ///< H v there
  std::vector<double> e;
  std::vector<int> level;     ///< 2: detected in the step, its impulse may act; else 1
  std::vector<char> contact;  ///< detected, and Newton's law held with equality
  std::vector<double> mu;     ///< [constraint][2]: the impulse of the step, on level 2
  std::vector<Side> side;
  std::vector<StepEvent> events;  ///< of the step
  std::optional<double> deepest;  ///< largest -gap, at least 0, where somebody found it on the way
  std::optional<double> fastest;  ///< largest |velocity| likewise

  /// Contact at the start: touching (or beyond), and neither approaching nor leaving.
  void start(std::vector<double> gaps, std::vector<double> velocities, Vec restitution);

  std::size_t size() const { return gap.size(); }
  bool detected(std::size_t a) const { return level[a] == 2; }
  double impulse(std::size_t a) const { return mu[2 * a + 1]; }
  double rebound(std::size_t a) const { return -e[a] * velocity[a]; }  ///< least H v_{k+1} where detected

  /// Box rule: `tested` are the gaps at the position that decides.
  void detect(const std::vector<double>& tested, Detection detection);
  /// The same, that position a time `ahead` of q_k with the velocities there [s].
  void detect(double ahead, Detection detection);

  /// Takes the constraint's share of a finished step, before gap and velocity move on.
  /// @param holds  detected, and H v_{k+1} stands on its bound
  void take_impulse(std::size_t a, bool holds, double impulse) {
    mu[2 * a + 1] = impulse;
    deepest.reset();
    fastest.reset();
    if (holds != (contact[a] != 0)) change_contact(a, holds, impulse);
  }

  /// Contact begins or ends for these, in a step whose impulses are in mu.
  void change_contacts(std::span<const std::int32_t> changed);

  double depth() const;               ///< largest -gap of this rank, at least 0
  double speed() const;               ///< largest |velocity| of this rank
  void visit(StateVisitor& visitor);  ///< @note Collective.
  PetscInt active() const;

private:
  template <class Gap>
  void detect_by(Gap&& gap_of, Detection detection);
  void change_contact(std::size_t a, bool holds, double impulse);
};

/// How far ahead of q_k the position that decides is, over h: 1, 1/2 or 0.
double reach_of(Detection detection);

}  // namespace sweepvi
