#pragma once

#include <vector>

#include "dvi/level_dvi.hpp"
#include "dvi/output_forcing.hpp"
#include "dvi/saddle_rows.hpp"
#include "sweepvi/linear_dvi.hpp"

namespace sweepvi {

/// Unknowns (x, nu), one multiplier per constraint and level that the scheme knows:
///
///     F_x  = (I - h theta A) x - (I + h (1-theta) A) x_k - phi - E nu,
///     F_nu = G x + H nu + g(t_{k+1}),            0 <= nu  _|_  F_nu >= 0.
///
/// | process                     | G     | E                   | H            | measure             |
/// |-----------------------------|-------|---------------------|--------------|---------------------|
/// | HOMSP, AB (34)-(45)         | Z     | d_{a,i}             | 0            | mu = nu (/M_aa on r) |
/// | degrees 0 and 1 with D      | C     | B e, e = h (1: D=0) | D e / h      | mu = h lambda = e nu |
/// | naive Euler, AB (47)        | C     | B h                 | D            | mu = h lambda = h nu |
/// | ZD-Euler, AB (63)           | C     | B h^{1-r}           | 0            | mu = h lambda        |
///
/// A level above r* has the row nu = 0 instead, so the pattern never changes. A constraint with an upper wall
/// has one multiplier more, for wmax - z_1 >= 0 along -d_{a,1}; at that wall the multipliers of levels 2 ...
/// r* are
/// <= 0, as z_i is. phi is h f_theta, for HOMSP and
/// ZD-Euler completed along d_{a,i}, i < r, so that AB (32) holds exactly for forcing that varies.
/// theta is 1 but for HOMSP.
class PrimalDual final : public LevelDvi {
public:
  PrimalDual(const LinearSystem& system, const RelativeDegree& relative_degree, Scheme scheme, double t_start,
             double h, double theta);

  Matrix create_jacobian() const override;
  void begin(const Step& step, Vec lower, Vec upper, Vec guess) override;
  void residual(Vec u, Vec f) override;
  void row_terms(Vec u, Vec terms) override;
  void residual_and_terms(Vec u, Vec f, Vec terms) override;
  bool spread_terms(Vec terms) override;
  void jacobian(Vec u, Mat jacobian) override;
  std::uint64_t jacobian_version() const override { return pinned_version_; }
  Degenerate degenerate() const override {
    return Degenerate::off_bound;
  }  // outputs are held where they touch
  AffineStep affine() const override {
    return {&rows_.rows(), rhs_.get(), nullptr, &level_of_unknown_, &pinned_, rows_version_};
  }
  void settle(Vec u) override;
  void accept(Vec u, Vec f) override;
  void visit(StateVisitor& visitor) override;
  bool set_step(double h) override;

  std::string diagnosis() override { return check_markov_matrix(system_, relative_degree_).diagnosis(); }
  const std::vector<double>& z() const override { return has_outputs_ ? levels_.z : no_outputs_; }

private:
  PetscInt number_of(std::size_t a) const override { return system_.constraint_order[a]; }
  struct Blocks;  // E, G, H before they are assembled
  void find_measures();
  Blocks make_blocks() const;
  Matrix mirrored(Mat lower) const;
  void assemble(const Blocks& blocks);
  void find_cross_coupling();
  void find_unit_outputs();
  void find_cross_jumps(Vec u);
  void find_held(Vec u);
  void project_held(Vec u);
  void put_unit_outputs(Vec u);
  void recover_lower_measures(Vec u);
  void follow_measures(Vec u);
  void find_net_multipliers(Vec u, std::vector<double>& net) const;
  void prepare_completion();
  void find_increment(const Step& step);
  void find_right_side(Vec guess);
  void add_old_rates();
  double rate_of(std::size_t q, const std::vector<double>& z) const {
    return theta_ * z[q + 1] + (1.0 - theta_) * levels_.z[q + 1];
  }
  void find_output_scale(Vec u);
  void known_terms(Vec u, Vec f, SaddleRows::Part part, Vec terms);
  void add_states(Vec states, Vec terms) const;
  void evaluate_g(double t, Vec g);
  bool pinned(std::size_t q) const { return pinned_[q] != 0; }
  /// Local multiplier of the k-th upper wall.
  PetscInt upper_at(std::size_t k) const { return static_cast<PetscInt>(levels_.z.size() + k); }
  /// Sign of z_{a,i} away from its bound, and of its multiplier; level 1 has a multiplier for each wall.
  double orientation(std::size_t a, int i) const {
    return i > 1 && levels_.side[a] == Side::upper ? -1.0 : 1.0;
  }

  const LinearSystem& system_;
  const RelativeDegree& relative_degree_;
  Scheme scheme_;
  double theta_;      // weight of t_{k+1}
  bool with_levels_;  // HOMSP with degrees >= 1: a multiplier per level; else one per constraint
  bool has_outputs_;  // HOMSP without D: the rows of G are the outputs
  bool completes_;    // phi needs completing
  OutputForcing forcing_;
  std::vector<std::size_t> upper_walls_;  // local constraints that have one
  std::vector<double> measure_per_nu_;    // local outputs
  std::vector<double> no_outputs_;
  PetscInt local_x_ = 0;
  bool has_increment_ = false;  // constant forcing: found once
  Matrix K_;
  SaddleRows rows_;  // K
  std::uint64_t rows_version_ = 0;
  std::vector<int> level_of_unknown_;  // 0: a state
  Matrix abs_A_;                       // empty: theta = 1
  Matrix cross_;                       // Z D off its unit diagonal, levels below r; empty: no cross coupling
  AffineRows cross_rows_;              // of it
  Matrix completion_;                  // I + cross_
  LinearSolver completion_solver_;
  Vector shift_, phi_, g_, output_g_old_, output_g_new_, defect_,
      cross_terms_;  // layouts: x, multipliers, outputs
  Vector push_;      // layout: x
  Vector rhs_, rhs_terms_, work_, terms_, inherited_, spread_, pushed_;
  std::vector<char> pinned_;           // local outputs
  std::uint64_t pinned_version_ = 0;   // counts changes of pinned_ and of h
  std::vector<PetscInt> unit_state_;   // local state that an output is, or -1
  std::vector<PetscInt> unit_remote_;  // unknown on another rank that an output is, or -1
  bool any_mixed_ = false;             // on some rank: an output made of several states
  bool any_remote_ = false;            // on some rank
  std::vector<double> unit_scale_;
  std::vector<char> held_;            // outputs that stand at a bound
  std::vector<char> open_;            // outputs that do not, though Z x + g cannot tell
  std::vector<char> at_upper_;        // upper walls they stand at
  std::vector<double> settled_z_;     // outputs, exact where held
  std::vector<double> net_;           // multipliers of the outputs, upper walls subtracted
  bool scales_known_ = false;         // output_scale_ is that of this step
  std::vector<double> output_scale_;  // an output below held_rtol times this is held
  PetscInt first_row_ = 0;            // global number of this rank's first unknown
};

}  // namespace sweepvi
