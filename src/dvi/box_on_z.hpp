#pragma once

#include <limits>
#include <vector>

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
  AffineStep affine() const override { return {&rows_, rhs_.get(), &blocks_, &block_rows_}; }
  bool spread_terms(Vec terms) override;
  void jacobian(Vec u, Mat jacobian) override;
  std::uint64_t jacobian_version() const override { return version_; }
  void accept(Vec u, Vec f) override;
  void visit(StateVisitor& visitor) override;
  bool set_step(double h) override;

private:
  PetscInt number_of(std::size_t a) const override { return system_.constraint_order[a]; }
  void place_forcing(double t, Vec g_x);
  void find_c(const Step& step);
  void make_rates();
  void add_completion(const Step& step);

  const LinearSystem& system_;
  const RelativeDegree& relative_degree_;
  OutputForcing forcing_;
  OutputCoordinates coordinates_;
  double theta_;                         // weight of t_{k+1}
  Matrix plain_K_;                       // I - h theta R
  AffineRows plain_rows_;                // of it
  AffineRows old_rates_;                 // h (1-theta) R, unless theta = 1
  Matrix jumps_, inverse_jumps_;         // J, J^{-1}; empty: identity
  AffineRows jump_rows_, inverse_rows_;  // of them
  Matrix K_;                             // J^{-1} plain_K_
  AffineRows rows_;                      // of K
  std::vector<PetscInt> blocks_;         // of each unknown
  BlockRows block_rows_;                 // the same by them
  Matrix reading_;                       // |K| up to 1; from the first step that needs it
  std::uint64_t version_ = 0;            // counts changes of h
  double g_time_ = std::numeric_limits<double>::quiet_NaN();      // of g_ and g_outputs_
  bool has_c_ = false;                                            // constant forcing: found once
  Vector g_outputs_old_, g_outputs_, defect_;                     // layout of the outputs
  Vector g_old_, g_, c_, rhs_, rhs_terms_, work_, mapped_terms_;  // layout of x
};

}  // namespace sweepvi
