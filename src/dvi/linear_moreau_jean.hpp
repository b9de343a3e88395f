#pragma once

#include <optional>
#include <vector>

#include "dvi/box_contacts.hpp"
#include "dvi/moreau_jean.hpp"
#include "model/varying_forces.hpp"
#include "petsc/affine_rows.hpp"
#include "vi/block_rows.hpp"

namespace sweepvi {

/// Moreau and Jean's scheme for a LagrangianSystem. With positions eliminated,
///
///     J v_{k+1} = r + H' mu,    J = M + h theta C + h^2 theta^2 K,
///     r = (M - h (1-theta) C - h^2 theta (1-theta) K) v_k - h K q_k + h f_theta,
///
/// where row j is divided by d_j, so that all rows read velocities. Two forms of the same box VI:
///
///   - box on v: F = J v - r, which is H' mu; H_aj v_j >= -e_a (H v_k)_a where constraint a is detected.
///   - primal-dual: unknowns (v, nu), nu_a = delta_a mu_a a velocity too, delta = diag(H d^-1 H');
///     F = (J v - r - H' mu,  H v_{k+1} + e H v_k) with nu >= 0, or nu = 0 where a is not detected.
///
/// Gaps are H q + g0 and their velocities H v. In a contact that goes on both are carried along, H v_{k+1} as
/// (H v_k carried along) + H (v_{k+1} - v_k), so that what the solver left of a contact's velocity is not
/// handed on; and in the primal-dual form gaps of open constraints are carried for 16 steps at most.
class LinearMoreauJean final : public MoreauJean {
public:
  LinearMoreauJean(const LagrangianSystem& system, const MoreauJeanOptions& options, double h, bool dual);

  Matrix create_jacobian() const override;
  void begin(const Step& step, Vec lower, Vec upper, Vec guess) override;
  void residual(Vec u, Vec f) override;
  void row_terms(Vec u, Vec terms) override;
  void residual_and_terms(Vec u, Vec f, Vec terms) override;
  RowRatios settle_and_judge(Vec u, Vec lower, Vec upper, Vec f, Vec terms) override;
  AffineStep affine() const override {
    if (dual_) return {&rows_, rhs_.get(), nullptr, &level_of_unknown_, &pinned_, rows_version_};
    return {&rows_, rhs_.get(), &block_rows_};
  }
  void jacobian(Vec u, Mat jacobian) override;
  std::uint64_t jacobian_version() const override { return version_; }
  Degenerate degenerate() const override { return dual_ ? Degenerate::off_bound : Degenerate::at_bound; }
  void settle(Vec u) override;
  std::string diagnosis() override;
  void accept(Vec u, Vec f) override;
  Energy energy() override;
  void visit(StateVisitor& visitor) override;
  bool set_step(double h) override;

private:
  void assemble();
  void make_scales();
  Matrix scaled(std::optional<double> m, std::optional<double> c, std::optional<double> k) const;
  Matrix saddle(Mat J);
  void take_pushes(Vec u, Vec nu) const;
  void find_rhs(const Step& step);
  void find_theta_forces(const Step& step);
  void bound_multipliers(Vec lower, Vec upper, Vec guess);
  void find_constraint_rhs();
  void evaluate(Vec u, Vec f);
  void put_held(Vec u, Vec terms);
  void take_multipliers(Vec u, Vec f);
  // `now` is H v_{k+1}.
  void move_contact(std::size_t a, bool holds, double impulse, double now) {
    const double old = contacts_.velocity[a];
    contacts_.take_impulse(a, holds, impulse);
    contacts_.velocity[a] = now;
    contacts_.gap[a] += h_ * (theta_ * now + (1.0 - theta_) * old);
    if (impulse == 0.0) return;
    lost_.dissipated -= 0.5 * impulse * (old + now);
    lost_.scheme -= (theta_ - 0.5) * impulse * (now - old);
  }
  void account(Vec u);
  std::vector<double> gaps_at_positions() const;
  void find_gaps();
  PetscInt scene_number(std::size_t a) const override { return system_.constraint_order[a]; }
  PetscInt row(std::size_t a) const { return local_ + static_cast<PetscInt>(a); }
  bool pinned(std::size_t a) const { return dual_ && !contacts_.detected(a); }

  const LagrangianSystem& system_;
  bool dual_;
  Vector scale_;                                   // 1 / d
  std::vector<double> delta_;                      // per constraint, primal-dual
  BoxContacts box_{contacts_};                     // box on v
  Matrix matrix_;                                  // dF/du, no row pinned
  Matrix abs_matrix_;                              // primal-dual
  AffineRows rows_;                                // of matrix_
  std::vector<PetscInt> blocks_;                   // of each unknown, box on v
  BlockRows block_rows_;                           // the same by them
  AffineRows of_v_;                                // d^-1 (M - h (1-theta) C - h^2 theta (1-theta) K)
  AffineRows of_q_;                                // -h d^-1 K
  AffineRows damping_;                             // C
  Matrix circulatory_;                             // (K - K') / 2, or empty
  Matrix pushes_, abs_pushes_;                     // d^-1 H' delta^-1, primal-dual
  Vector nu_, abs_nu_;                             // multipliers alone, primal-dual
  Vector rhs_, rhs_terms_, work_, terms_, known_;  // layout of u
  VaryingForces varying_;
  Vector forces_, theta_forces_, part_, abs_;  // layout of q; forces: constant, varying ones of the step
  double fastest_ = 0.0;                       // largest |v_k|
  std::vector<int> level_of_unknown_;          // primal-dual; 0: a velocity
  std::vector<char> pinned_;                   // primal-dual, constraints
  std::uint64_t rows_version_ = 0;
  std::uint64_t version_ = 0;  // counts changes of what is pinned and of h
  PetscInt first_row_ = 0;     // global number of this rank's first unknown
  PetscInt step_ = 0;          // number of the one that was begun
};

}  // namespace sweepvi
