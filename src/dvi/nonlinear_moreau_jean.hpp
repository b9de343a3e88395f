#pragma once

#include <vector>

#include "dvi/momentum.hpp"
#include "dvi/moreau_jean.hpp"
#include "dvi/stacked.hpp"
#include "petsc/sparse.hpp"

namespace sweepvi {

/// Moreau and Jean's scheme for a NonlinearLagrangian, in (v, nu): with R of Momentum, H = H(q~) of the step,
///
///     F = ( d^-1 [R(v) - H' mu],   H v + e H v_k ),    nu = delta mu >= 0,  or nu = 0 where not detected.
///
/// d = diag(M(q_k)) and delta = diag(H d^-1 H') make all rows and unknowns velocities.
class NonlinearMoreauJean final : public MoreauJean {
public:
  NonlinearMoreauJean(const NonlinearLagrangian& system, const MoreauJeanOptions& options,
                      const TimeGrid& grid);

  Matrix create_jacobian() const override;
  void begin(const Step& step, Vec lower, Vec upper, Vec guess) override;
  void residual(Vec u, Vec f) override;
  void row_terms(Vec u, Vec terms) override;
  void jacobian(Vec u, Mat jacobian) override;
  std::uint64_t jacobian_version() const override { return version_; }  // kept within a step
  Degenerate degenerate() const override { return Degenerate::off_bound; }
  void settle(Vec u) override;
  bool set_step(double h) override;
  void accept(Vec u, Vec f) override;
  Energy energy() override;

private:
  NonlinearMoreauJean(const NonlinearLagrangian& system, const MoreauJeanOptions& options,
                      const TimeGrid& grid, const Vector& q0, const Vector& v0);
  void start_contacts();
  void detect(const Step& step);
  void find_scales();
  void split(Vec u);
  Matrix saddle(Mat J) const;
  std::vector<double> gaps_at(Vec q);
  PetscInt scene_number(std::size_t a) const override {
    return row_range(H_.get()).first + static_cast<PetscInt>(a);
  }
  PetscInt row(std::size_t a) const { return local_ + static_cast<PetscInt>(a); }

  const NonlinearLagrangian& system_;
  Momentum momentum_;
  Matrix H_, abs_H_;  // at q~ of the step
  Matrix abs_J_;      // |dR/dv| at the start of the step
  Vector scale_;      // 1 / d
  std::vector<double> delta_;
  Vector v_new_, r_, part_, position_, terms_v_;  // layout of q
  Vector nu_, gap_part_;                          // layout of the constraints
  Vector work_, known_;                           // layout of u
  std::uint64_t version_ = 0;
};

}  // namespace sweepvi
