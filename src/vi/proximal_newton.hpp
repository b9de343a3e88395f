#pragma once

#include <cstdint>
#include <vector>

#include "parallel/components.hpp"
#include "sweepvi/petsc.hpp"
#include "sweepvi/state_visitor.hpp"

namespace sweepvi {

/// Solves the mixed complementarity problem of a projection onto a polyhedron,
///
///     K u - G' y = c,     0 <= y  _|_  G u - g >= 0,
///
/// with the symmetric part of K positive definite, whatever the faces: repeated, dependent, more of them
/// active than there are dimensions.
///
/// The proximal method of multipliers solves a sequence of problems whose matrices are never singular,
///
///     K u - G' y = c,     0 <= y_i  _|_  G_i u - g_i + delta |G_i|^2 (y_i - centre_i) >= 0,
///
/// each with its centre at the solution of the one before; the first has none (0), which makes y the smallest
/// of all multipliers. delta is tiny, so that the second or third solve is exact to rounding; it shrinks
/// where nearly parallel faces slow this down. Each problem is solved by semismooth Newton: given the active
/// faces, a linear system; then
///
///     t -> d' R(u + t d),    R(u) = K u - c - G' max(0, centre - (G u - g) / (delta |G|^2)),
///
/// which is increasing, is brought to zero along the step d. Where K is symmetric that is an exact line
/// search for a strictly convex, piecewise quadratic function, and Newton ends after finitely many steps; an
/// active-set method without it cycles. Sources: R. T. Rockafellar, Math. Oper. Res. 1 (1976) 97-116; L. Qi,
/// J. Sun, Math. Program. 58 (1993) 353-367.
///
/// One Newton step lets contact spread by one face along a chain: that many are needed where many close in a
/// row.
///
/// The linear systems have one pattern, rows of inactive faces being identity rows: one symbolic
/// factorization in all, a numeric one when the active faces change.
class ProximalNewton {
public:
  /// What is solved. Vectors x = (u, y) hold, on each rank, its components and then its faces.
  struct Problem {
    Mat S = nullptr;          ///< [K, -G'; G, 0], all of its diagonal stored
    Mat abs_S = nullptr;      ///< absolute values
    Vec rhs = nullptr;        ///< (c, g)
    Vec rhs_terms = nullptr;  ///< sums of the absolute values of their terms
    PetscInt components = 0;  ///< of this rank
  };

  /// The objects of `problem` must outlive this one; their values may change, those of S with `renew`.
  /// @note Collective, as all methods are but `scale`.
  explicit ProximalNewton(const Problem& problem);
  ProximalNewton(const ProximalNewton&) = delete;
  ProximalNewton& operator=(const ProximalNewton&) = delete;

  /// S has new values.
  void renew();
  /// Brings x to the solution up to rounding. `x` is the start; the active faces start from those of the last
  /// solve. @return false if that fails: there may be no solution
  bool solve(Vec x);
  /// Solves the one problem with centre 0 and this delta. @return false if that fails
  bool solve_regularised(Vec x, double delta);

  /// What the rows of S x - rhs are judged against: the sums of the absolute values of their terms, and for a
  /// face |G| T + |g|, T = |K| |u| + |c|, because u is not known better than that: where a face holds u near
  /// zero, its own terms vanish.
  void row_terms(Vec x, Vec terms);
  /// Adds delta |G_i|^2 to the diagonal of the faces, for a matrix with the pattern of S.
  void regularise(Mat matrix) const;

  /// The faces that the next solve starts from. @note Collective.
  void visit(StateVisitor& visitor) { visitor.visit("active faces", Belongs::constraint, active_); }

private:
  static constexpr double first_delta = 1e-8;

  bool newton(Vec x, double delta);
  bool solve_active(Vec x, double delta);
  void factor(double delta);
  bool update_active(Vec x, double delta);
  void search(Vec x, double delta);
  std::vector<double> slopes(const std::vector<double>& t, double delta, double more = 0.0) const;
  std::vector<double> rounding_of_slopes(double delta) const;
  double ratio() const;

  Problem problem_;
  MPI_Comm comm_;
  Components parts_;            // of S: many copies of a small process, say
  std::vector<double> square_;  // |G_i|^2, of this rank's faces
  std::vector<double> centre_;
  std::vector<char> active_, factored_active_;
  double factored_delta_ = 0.0;
  bool has_factor_ = false;
  Matrix jacobian_;
  LinearSolver solver_;
  Vector f_, step_, terms_, work_;
  // Where Newton came from: u, and K u - c, G u - g there; the way d to the next point, and K d, G d.
  Vector from_, at_from_, way_, along_way_;
};

}  // namespace sweepvi
