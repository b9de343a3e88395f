#pragma once

#include <vector>

#include "sweepvi/dvi.hpp"
#include "sweepvi/linear_system.hpp"
#include "sweepvi/relative_degree.hpp"

namespace sweepvi {

/// Constraints as the scene has them: opposite rows that were merged into one constraint are two again, each
/// with outputs that stay >= 0 and measures >= 0 of its own:
///
///     w_b = s (wmax_a - w_a),   z_{b,i} = -s z_{a,i},   mu_{b,i} = s max(0, -mu_{a,i})  (level r: max(0,
///     -mu) / t).
///
/// No method is collective; all are about the rows that this rank owns.
class SceneRows {
public:
  SceneRows(const LinearSystem& system, const RelativeDegree& relative_degree, const ConstrainedDvi& dvi);

  std::size_t count() const { return rows_.size(); }
  std::vector<PetscInt> numbers() const;  ///< in the scene
  std::vector<int> degrees() const;

  // Each writes this rank's numbers, row by row.
  void w(double* to) const;
  void z(double* to) const;  ///< level by level; nothing if the DVI has none
  void level(double* to) const;
  void mu(double* to) const;  ///< measures of the last step, [row][level]
  PetscInt number_of(const StepEvent& event) const;
  double impulse_of(const StepEvent& event) const;

private:
  struct Row {
    std::size_t constraint = 0;
    PetscInt number = 0;
    bool lower = true, upper = true;  // walls of the constraint that are this row's
    double output_scale = 1.0, multiplier_scale = 1.0;
    bool mirrored() const { return !lower; }
  };
  double measure(const Row& row, int level, double mu) const;
  const Row& row_of(const StepEvent& event) const;

  const RelativeDegree& relative_degree_;
  const ConstrainedDvi& dvi_;
  std::vector<double> wmax_;
  std::vector<Row> rows_;  // own rows first, in the order of the constraints; then the merged ones
  std::vector<std::size_t> merged_row_;  // per constraint, or none
  static constexpr std::size_t none = static_cast<std::size_t>(-1);
};

}  // namespace sweepvi
