#pragma once

#include <functional>
#include <string>
#include <vector>

#include "sweepvi/dvi.hpp"
#include "sweepvi/step_solver.hpp"
#include "vi/scaled_vi.hpp"

namespace sweepvi {

/// Solves monotone steps of any size, however degenerate: linear programs, repeated and dependent rows,
/// circuits with diodes in loops, where the matrices of active-set methods are singular. Two methods on the
/// scaled step (scaled_vi.hpp), A v + q in the box l <= v <= b:
///
/// 1. Mehrotra's predictor-corrector, an interior-point method. Positive zl, zu stand for the two signs of
///    G = A v + q,
///
///        A v + q + pull diag(s) v - zl + zu = 0,   (v - l) zl = mu,   (b - v) zu = mu,   mu -> 0,
///
///    for the bounds that there are. The pull towards 0 goes with mu, from the spring of 1e-2 with which the
///    path begins to 1e-13 (A. N. Tikhonov): with it the path exists and stays near the solutions also where
///    no v has v > l and G > 0 in all rows, as transport that just meets its demand, and without it runs away
///    along null vectors of A. A Newton step solves with A + diag(zl / (v - l) + zu / (b - v) + pull s),
///    which is nonsingular where A is monotone. 10 to 30 factorizations, whatever the size. It converges for
///    monotone problems that have a solution.
///
/// 2. Proximal steps by active sets, which make the solution exact. With the sets that v tells,
///
///        rows with v - G <= l:  v_new = l;   v - G >= b:  v_new = b;   (by more than rounding)   the others:
///        G(v) + (A + rho diag(s)) (v_new - v) = 0:
///
///    one iteration of the proximal point method with its centre at v, whose fixed points are solutions
///    whatever rho, and whose matrix is not singular where rows of A are dependent. It ends in one or two
///    steps from where 1. has led, with the sets of that path first; and before 1. it is tried from where the
///    step begins: there it ends soon where the sets are nearly those of the last step.
///
/// Not monotone: nothing is claimed, an attempt like others. Where F is not affine, it is linearised at the
/// solution of the last linearisation.
///
/// All matrices have the pattern of the step's Jacobian: one symbolic factorization, in parallel as the
/// options of the linear solver say.
///
/// Sources: S. Mehrotra, SIAM J. Optim. 2 (1992) 575-601; S. J. Wright, Primal-Dual Interior-Point Methods,
/// 1997, chapters 8 and 10; R. T. Rockafellar, SIAM J. Control Optim. 14 (1976) 877-898; S. Pougkakiotis, J.
/// Gondzio, Comput. Optim. Appl. 78 (2021) 307-351.
class InteriorPoint {
public:
  /// The linear solver reads the same options as SNES's own (-ksp_type, -pc_type, ...). @note Collective.
  explicit InteriorPoint(Dvi& problem);
  InteriorPoint(const InteriorPoint&) = delete;
  InteriorPoint& operator=(const InteriorPoint&) = delete;

  struct Result {
    PetscInt iterations = 0;      ///< linear systems with new matrices
    std::string reason;           ///< in the manner of SNES: INTERIOR_CONVERGED, ...
    bool linear_failure = false;  ///< a linear system could not be solved
  };

  /// Certificate ratio of the point that u settles to.
  using Ratio = std::function<double(Vec u)>;

  /// With what to begin: 2. or 1.
  enum class Begin { by_sets, on_path };

  /// Improves `u` until `ratio` is at most the target, or below stagnation without getting better; leaves the
  /// best point seen. @note Collective.
  Result solve(Vec u, Vec lower, Vec upper, const CertificateOptions& options, Begin begin,
               const Ratio& ratio);

private:
  /// A direction of the path: of v, and of zl, zu of this rank's rows (0 where there is no such bound).
  struct Direction {
    Vector v;
    std::vector<double> zl, zu;
  };

  bool solve_affine(Vec u, const CertificateOptions& options, Begin begin, const Ratio& ratio,
                    Result& result);
  void keep(Vec u, double ratio);
  bool solve_system(Result& result);
  void set_matrix(Vec rows, Vec columns);

  bool proximal_steps(Vec u, int most, const CertificateOptions& options, const Ratio& ratio, Result& result);
  bool without_residue(Vec u, const CertificateOptions& options, const Ratio& ratio);
  bool escaped() const;
  bool classify();
  void classify_on_path();
  void set_proximal_matrix();
  void set_proximal_right_side();
  void put_on_bounds();

  double reach(Result& result);
  void enter(Result& result);
  bool follow_path(double goal, Result& result);
  bool advance(double mu, double& length, Result& result);
  void set_newton_matrix();
  bool direction(double product, const Direction* second_order, Direction& way, Result& result);
  void set_newton_right_side(double product, const Direction* second_order);
  double longest(const Direction& way) const;
  double mean_product(const Direction* way, double length) const;
  void go(const Direction& way, double length);

  Dvi& problem_;
  ScaledVi vi_;
  Matrix system_;  // diag(.) A diag(.) + diag(.), of the linear solver
  LinearSolver solver_;
  Vector v_, g_;  // the point, and A v + q there; on the path less zl - zu
  Vector right_, scale_, shift_, change_, work_, best_;
  double best_ratio_ = 0.0;
  double size_ = 0.0;  // largest of v and q at the start
  // Of this rank's rows. Sets: -1 at the lower bound, 1 at the upper, 0 between; of the last factorization.
  std::vector<signed char> active_, factored_;
  std::vector<char> below_, above_;  // whether there is a lower, an upper bound
  std::vector<double> zl_, zu_;
  std::vector<double> gap_l_, gap_u_;  // v - l, b - v, without the rounding of v; 1 where there is no bound
  std::vector<double> stiffness_;      // zl / (v - l) + zu / (b - v) + pull s
  std::vector<double> change_l_, change_u_;  // second-order changes of the products
  Direction predictor_, way_;
  double bounds_ = 0.0;  // their number, of all ranks
  double mu_at_start_ = 0.0, pull_ = 0.0;
};

}  // namespace sweepvi
