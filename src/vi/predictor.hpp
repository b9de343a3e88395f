#pragma once

#include <functional>
#include <vector>

#include "sweepvi/dvi.hpp"

namespace sweepvi {

/// Guesses a step's solution by its active set: semismooth Newton on the natural residual u - mid(l, b, u -
/// F),
///
///     rows with u - F <= l:  u_new = l;   with u - F >= b:  u_new = b;   the others:  F(u) + J (u_new - u) =
///     0,
///
/// until the guess is certified or the sets repeat. Where the sets only lose rows or only gain some, a few in
/// each iteration, none comes back, but it may take as many iterations as a grid has cells: the free boundary
/// of an obstacle problem moves by one cell in each. Then others are faster. Degenerate rows go where
/// Dvi::degenerate says. Active rows become identity rows instead of being cut out, so the pattern is the
/// same in every step: one symbolic factorization a run, a numeric one when the active set (or the Jacobian)
/// has changed, none otherwise. Source: M. Hintermueller, K. Ito, K. Kunisch, SIAM J. Optim. 13 (2002)
/// 865-888 (primal-dual active set strategy).
class Predictor {
public:
  /// @note Collective. The linear solver reads the same options as SNES's own (-ksp_type, -pc_type, ...).
  Predictor(Dvi& problem, Mat pattern);
  Predictor(const Predictor&) = delete;
  Predictor& operator=(const Predictor&) = delete;

  /// Worst certificate ratio of the point that u settles to.
  using Ratio = std::function<double(Vec u)>;

  enum class Outcome {
    solved,      ///< `ratio` fell to `target`
    creeping,    ///< sets change one way only, for some iterations now
    unfinished,  ///< no sets came back; who goes on should do so from here
    failed
  };
  /// Improves `u`, a guess on entry. @note Collective.
  Outcome improve(Vec u, Vec lower, Vec upper, double target, const Ratio& ratio);

  KSP solver() const { return solver_.get(); }

private:
  /// A row held at a bound.
  struct Bound {
    PetscInt row;
    double value;
    bool operator==(const Bound&) const = default;
  };
  /// Whether rows entered the sets, or left them.
  struct Change {
    bool entered = false, left = false;
  };
  bool classify(Vec u, Vec lower, Vec upper);
  Change change();
  std::uint64_t fingerprint() const;
  void factor(Vec u);
  bool advance(Vec u);

  Dvi& problem_;
  Matrix jacobian_;
  LinearSolver solver_;
  Vector f_, right_side_, step_, terms_;
  std::vector<Bound> active_, factored_, before_;  // of this iteration; of the factorization; of the last one
  std::uint64_t factored_version_ = 0;
  bool has_factor_ = false;
};

}  // namespace sweepvi
