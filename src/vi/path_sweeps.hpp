#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "petsc/affine_rows.hpp"
#include "sweepvi/dvi.hpp"
#include "vi/tridiagonal_lcp.hpp"

namespace sweepvi {

/// Solves an affine step in states x and multipliers nu,
///
///     J x - E nu = b,      0 <= nu  _|_  G x + H nu + g >= 0,
///
/// whose constraints push each other along paths, as the contacts of a column of balls do: level by level,
/// from the highest one down. The states that a level's outputs read are taken by the diagonal D of J, and
/// the level's multipliers from the LCP of G D^-1 E + H, which is tridiagonal in the order of the paths
/// (TridiagonalLcp). Where J couples states and levels in one direction only - balls that nothing but contact
/// couples - one sweep is exact; springs and dampers are carried by further ones, which contract like h.
///
/// What it finds depends on the step and its first guess alone. The certificate decides whether it is right.
class PathSweeps {
public:
  /// @param rows  K = [J -E; G H]; must outlive this
  /// @param level  of each of this rank's unknowns: 0 of a state, i >= 1 of a multiplier
  /// @note Collective, like all methods but `worthwhile`.
  PathSweeps(MPI_Comm comm, const AffineRows& rows, const std::vector<int>& level);

  /// The constraints of each level lie on paths, with an M-matrix, and sweeps contract. The same on every
  /// rank.
  bool worthwhile() const { return rate_ <= 0.2; }

  /// From the guess u to the solution of the step with right side (b, -g).
  /// @param pinned  multipliers of this rank, in their order, that are 0 in this step. May be shorter.
  /// @return false if it has other bounds than nu >= 0, or sweeps do not settle. The same on every rank.
  bool solve(Vec u, Vec b, Vec lower, Vec upper, const std::vector<char>& pinned);

private:
  enum class Bounds { of_step, none, all_at };  // the others: to find out how sweeps contract
  struct Entry {
    PetscInt column;
    double value;
  };
  struct SparseRows {
    std::vector<std::int32_t> starts{0};
    std::vector<Entry> entries;
    void end_row() { starts.push_back(static_cast<std::int32_t>(entries.size())); }
  };
  struct Phase {
    int level = 0;
    std::vector<PetscInt> states;  // in the order in which they are taken
    std::vector<double> inverse;   // of their diagonals
    SparseRows reads;              // their rows of K without the diagonal
    SparseRows pushes;             // D^-1 E, this level's multipliers
    std::vector<PetscInt>
        multipliers;       // counted from the rank's first; on one rank in the order of the paths
    SparseRows outputs;    // their rows of K
    TridiagonalLcp paths;  // rank 0's
    Scatter to_paths;      // on several ranks, as `gathered`: rank 0 has all paths
    Vector gathered;
  };

  bool find_phases(const std::vector<int>& level);
  bool find_paths(Phase& phase, Mat tridiagonal);
  void find_rate();
  bool fits(const double* lower, const double* upper, const std::vector<char>& pinned);
  double sweep(Vec u, Vec b, Bounds bounds, const std::vector<char>& pinned);
  template <bool Measured>
  double take_states(const Phase& phase, double* u, const double* b, const double* others) const;
  void solve_paths(Phase& phase, Vec u, Vec b, Bounds bounds, const std::vector<char>& pinned);
  void gather(Phase& phase, const std::vector<double>& own, std::vector<double>& all);
  double value(PetscInt column, const double* u, const double* others) const {
    return column < count_ ? u[column] : others[column - count_];
  }

  MPI_Comm comm_;
  const AffineRows& rows_;
  PetscInt count_ = 0;  // unknowns
  int ranks_ = 1;
  bool exact_ = false;                         // one sweep is
  double rate_ = 0.0;                          // contraction of a sweep
  std::vector<Phase> phases_;                  // highest level first; the last one has states only
  std::vector<PetscInt> multiplier_;           // unknown of each multiplier of this rank
  std::vector<double> w_, x_, y_;              // of a phase's multipliers
  std::vector<double> all_w_, all_x_, all_y_;  // on rank 0 of several: of all of them
  Vector change_;                              // layout of u
};

/// Hands the step solver a point that its certificate accepts, by PathSweeps, where the step has constraints
/// on paths.
class PathPredictor {
public:
  explicit PathPredictor(Dvi& problem) : problem_(problem) {}

  /// Improves u, a guess on entry. @param ratio  settles a point and certifies it
  /// @return true if `ratio` fell to `target` @note Collective.
  template <class Ratio>
  bool improve(Vec u, Vec lower, Vec upper, double target, Ratio&& ratio) {
    constexpr int most_rounds = 5;  // the second one takes off what is left by rounding
    const AffineStep step = problem_.affine();
    if (!prepare(step)) return false;
    double reached = 1.0;
    for (int round = 0; round < most_rounds; ++round) {
      if (!sweeps_->solve(u, step.right_side, lower, upper, *step.pinned)) return false;
      const double before = reached;
      reached = ratio(u);
      if (reached <= target) return true;
      if (round > 1 && !(reached < 0.5 * before)) return false;
    }
    return false;
  }

  /// Whether the steps are of that kind. @note Collective.
  bool applies() { return prepare(problem_.affine()); }

private:
  bool prepare(const AffineStep& step);

  Dvi& problem_;
  std::unique_ptr<PathSweeps> sweeps_;
  std::uint64_t version_ = 0;
};

}  // namespace sweepvi
