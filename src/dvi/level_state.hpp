#pragma once

#include <vector>

#include "sweepvi/dvi.hpp"

namespace sweepvi {

inline double sign(Side side) {
  return static_cast<double>(side);
}

/// What one output may be.
struct Interval {
  double lower = PETSC_NINFINITY, upper = PETSC_INFINITY;
};

/// Outputs, levels and measures of the constraints a rank owns, carried from step to step. Held outputs are
/// exactly on their bound here, so that the level rule never sees a residue. At an upper wall everything is
/// mirrored: outputs of level 2 and above stay <= 0, measures are negative.
struct LevelState {
  std::vector<PetscInt> first;  ///< local index of level 1 of each constraint; one more at the end
  std::vector<double> upper;    ///< wmax of each constraint, PETSC_INFINITY where there is none
  std::vector<Side> side;       ///< wall at which the step starts
  std::vector<double> z;        ///< outputs at the time reached
  std::vector<int> level;       ///< r* of the step
  std::vector<double> mu;       ///< [constraint][mu_levels], measures of the step
  int mu_levels = 1;
  std::vector<int>
      mu_shift;  ///< column of level 1 in `mu`, per constraint: 0 unless the scheme has only level r
  std::vector<StepEvent> events;  ///< of the step
  std::vector<double> w;          ///< constraint values

  /// @param wmax  may be null: no upper walls
  void allocate(const std::vector<int>& levels_of_constraint, int columns_of_mu, Vec wmax);
  double& measure(std::size_t a, int i) {
    return mu[a * static_cast<std::size_t>(mu_levels) + static_cast<std::size_t>(mu_shift[a] + i - 1)];
  }
  std::size_t constraints() const { return level.size(); }
  int levels(std::size_t a) const { return static_cast<int>(first[a + 1] - first[a]); }
  std::size_t at(std::size_t a, int i) const {
    return static_cast<std::size_t>(first[a]) + static_cast<std::size_t>(i - 1);
  }

  /// The wall at which an output of level 1 stands, or which it has passed.
  Side side_of(std::size_t a, double z1) const {
    if (z1 <= 0.0) return Side::lower;
    return z1 >= upper[a] ? Side::upper : Side::none;
  }

  /// Outputs, levels and measures. @note Collective.
  void visit(StateVisitor& visitor);
  /// One number for each output, shown as [constraint][mu_levels]. @note Collective.
  void visit_outputs(StateVisitor& visitor, const char* name, std::span<double> values) const;

  /// AB (40): r* = 1 if z_1 > 0, else 1 + the largest j <= r-1 with z_i <= 0 for all i <= j; mirrored at the
  /// upper wall.
  void apply_level_rule();

  /// The box rule: 0 <= z_1 <= wmax, z_i >= 0 (upper wall: <= 0) for 2 <= i <= r*, the others free.
  Interval box(std::size_t a, int i) const {
    if (i == 1) return {0.0, upper[a]};
    if (i > level[a]) return {};
    return side[a] == Side::upper ? Interval{PETSC_NINFINITY, 0.0} : Interval{0.0, PETSC_INFINITY};
  }

  /// Takes the outputs and measures of a finished step and derives its events: an impact on level i where the
  /// measure stops an output that was heading out (or a gap that closes), a lift-off where contact ends.
  void advance(std::vector<double>& z_new);

  double penetration(MPI_Comm comm) const;
  PetscInt active() const;
};

}  // namespace sweepvi
