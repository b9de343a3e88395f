#pragma once

#include <vector>

#include "dvi/level_dvi.hpp"
#include "dvi/output_forcing.hpp"
#include "sweepvi/linear_dvi.hpp"

namespace sweepvi {

/// HOMSP where every output is a state of its own (up to a scale s): unknowns u = S x + g(t) with u_{a,i} =
/// z_{a,i} on output states and u = x elsewhere,
///
///     F(u) = (I - h S A S^{-1}) u - u_k - c,   c = (I - h S A S^{-1}) g_{k+1} - g_k + h S f_{k+1},
///
/// with c = 0 on the rows of levels i < r, where AB (32) holds exactly. F on a bounded row is the measure
/// mu_{a,i} (on level r: M_aa mu_{a,r}), so 0 <= z_{a,i} _|_ mu_{a,i} >= 0 for i <= r* is the box VI itself.
/// Source: AB (34)-(45).
class BoxOnZ final : public LevelDvi {
public:
  BoxOnZ(const LinearSystem& system, const RelativeDegree& relative_degree, double t_start, double h);

  Matrix create_jacobian() const override;
  void begin(const Step& step, Vec lower, Vec upper, Vec guess) override;
  void residual(Vec u, Vec f) override;
  void row_terms(Vec u, Vec terms) override;
  void jacobian(Vec u, Mat jacobian) override;
  std::uint64_t jacobian_version() const override { return 0; }  // constant
  void settle(Vec u) override;
  void accept(Vec u, Vec f) override;

private:
  void place_forcing(double t, Vec g_x);
  void find_c(const Step& step);
  void recover_x(Vec u);

  const RelativeDegree& relative_degree_;
  OutputForcing forcing_;
  std::vector<PetscInt> position_;    // local state of each local output
  Vector scale_;                      // S
  Matrix K_, abs_K_;                  // I - h S A S^{-1} and its absolute values
  Vector g_outputs_, g_old_, g_new_;  // layouts: outputs, x, x
  Vector c_, rhs_, rhs_terms_, work_, terms_;
};

}  // namespace sweepvi
