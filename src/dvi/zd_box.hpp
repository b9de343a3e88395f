#pragma once

#include <vector>

#include "dvi/output_box.hpp"
#include "sweepvi/linear_system.hpp"
#include "sweepvi/zd_system.hpp"

namespace sweepvi {

/// HOMSP for a nonlinear ZdSystem (see there): with f its rates, levels below r included,
///
///     F(u) = J^{-1} [ u - u_k - h theta f(t_{k+1}, u) - h (1-theta) f(t_k, u_k) ].
///
/// The jumps J are those of the linear system with A = df/du at (t_{k+1}, u_k); where no constraint reads
/// another one above level 1 they are the identity, and nothing is computed.
class ZdBox final : public OutputBox {
public:
  ZdBox(const ZdSystem& system, const TimeGrid& grid, double theta);

  Matrix create_jacobian() const override;
  void begin(const Step& step, Vec lower, Vec upper, Vec guess) override;
  void residual(Vec u, Vec f) override;
  void row_terms(Vec u, Vec terms) override;
  bool spread_terms(Vec terms) override;
  void jacobian(Vec u, Mat jacobian) override;
  std::uint64_t jacobian_version() const override { return version_; }  // kept within a step
  void accept(Vec u, Vec f) override;
  void visit(StateVisitor& visitor) override;
  bool set_step(double h) override {
    h_ = h;
    return true;
  }
  Vec x() const override { return u_.get(); }

private:
  ZdBox(const ZdSystem& system, const TimeGrid& grid, double theta, Vector state);
  PetscInt number_of(std::size_t a) const override { return first_constraint_ + static_cast<PetscInt>(a); }
  void allocate();
  void check_levels() const;
  void make_linearisation();
  Matrix companion(Mat user) const;
  bool may_impact() const;
  void forget_jumps();
  void update_jumps(Matrix A);
  Matrix newton_matrix(Mat A) const;
  void find_rates(double t, Vec u, Vec rates);
  void find_old_rates(double t);
  void find_gains(Vec u);

  const ZdSystem& system_;
  std::vector<ZdSystem::Constraint> constraints_;
  PetscInt first_constraint_ = 0;  // global number
  ZdJacobian derivative_;
  double theta_;  // weight of t_{k+1}
  double t_new_ = 0.0;
  std::uint64_t version_ = 0;
  std::vector<PetscInt> next_;  // place of the next level for each local unknown, -1 for level r and xi
  std::vector<double> gains_;
  LinearSystem linearised_;             // A = df/du; its B and C are unit columns and rows
  bool coupled_ = false;                // some measure jumps more than its own output
  Matrix inverse_jumps_, abs_inverse_;  // J^{-1}; empty: identity
  Matrix reading_;                      // up to 1 / h
  Matrix abs_A_;                        // |df/du| at the start of the step
  Matrix pattern_;                      // of dF/du
  Vector rates_, work_;
  Vector old_rates_, old_terms_;  // h (1-theta) f_k and what it is summed from; empty: theta = 1
};

}  // namespace sweepvi
