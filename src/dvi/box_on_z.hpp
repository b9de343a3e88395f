#pragma once

#include <limits>
#include <vector>

#include "dvi/forced_increment.hpp"
#include "dvi/output_box.hpp"
#include "dvi/output_coordinates.hpp"
#include "dvi/output_forcing.hpp"
#include "petsc/affine_rows.hpp"
#include "sweepvi/linear_dvi.hpp"
#include "vi/block_rows.hpp"

namespace sweepvi {

/// HOMSP in coordinates u = W x + g(t), where the outputs z_{a,i} are unknowns (OutputCoordinates):
///
///     F(u) = J^{-1} [ (I - h theta R) u - (I + h (1-theta) R) u_k - c ],      R = W A W^{-1},
///
/// J the jumps that measures cause, c the forcing, 0 on the rows of levels i < r, where AB (32) holds
/// exactly. F on level r reads M_aa mu_{a,r}. Source: AB (34)-(45), there with theta = 1.
class BoxOnZ final : public OutputBox {
public:
  /// @pre  relative_degree.has_pivots, each pivot on the rank of its constraint
  BoxOnZ(const LinearSystem& system, const RelativeDegree& relative_degree, double t_start, double h,
         double theta);

  Matrix create_jacobian() const override;
  void begin(const Step& step, Vec lower, Vec upper, Vec guess) override;
  void residual(Vec u, Vec f) override;
  void row_terms(Vec u, Vec terms) override;
  void residual_and_terms(Vec u, Vec f, Vec terms) override;
  RowRatios settle_and_judge(Vec u, Vec lower, Vec upper, Vec f, Vec terms) override;
  AffineStep affine() const override { return {&rows_, rhs_.get(), &block_rows_}; }
  bool spread_terms(Vec terms) override;
  void jacobian(Vec u, Mat jacobian) override;
  std::uint64_t jacobian_version() const override { return version_; }
  void accept(Vec u, Vec f) override;
  Vec x() const override;
  void visit(StateVisitor& visitor) override;
  bool set_step(double h) override;

private:
  PetscInt number_of(std::size_t a) const override { return system_.constraint_order[a]; }
  Matrix make_rates();
  void find_g(double t, Vec g) const;

  const LinearSystem& system_;
  const RelativeDegree& relative_degree_;
  mutable OutputForcing forcing_;
  OutputCoordinates coordinates_;
  double theta_;                  // weight of t_{k+1}
  AffineRows old_rates_;          // h (1-theta) R, unless theta = 1
  Matrix jumps_, inverse_jumps_;  // J, J^{-1}; empty: identity
  AffineRows inverse_rows_;
  ForcedIncrement increment_;
  Matrix K_;                      // J^{-1} (I - h theta R)
  AffineRows rows_;               // of K
  std::vector<PetscInt> blocks_;  // of each unknown
  BlockRows block_rows_;          // the same by them
  Matrix reading_;                // |K| up to 1; from the first step that needs it
  std::uint64_t version_ = 0;     // counts changes of h
  double t_new_ = 0.0, t_ = 0.0;  // end of the step that was begun, time of u_
  mutable bool knows_x_ = true;
  mutable Vector g_outputs_;  // layout of the outputs; from the first time that needs it
  mutable Vector work_;
  Vector c_, rhs_, rhs_terms_, mapped_terms_;
};

}  // namespace sweepvi
