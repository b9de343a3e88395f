#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "sweepvi/petsc.hpp"
#include "sweepvi/state_visitor.hpp"

namespace sweepvi {

/// One step t_k -> t_{k+1}.
struct Step {
  PetscInt number = 0;  ///< k + 1
  double t_old = 0.0;   ///< t_k [s]
  double t_new = 0.0;   ///< t_{k+1} [s]
  double h = 0.0;       ///< [s]
};

/// A wall of the set 0 <= w <= wmax.
enum class Side : signed char { upper = -1, none = 0, lower = 1 };

/// What happened to a constraint in a step.
struct StepEvent {
  PetscInt constraint;  ///< local number
  Side side;            ///< at which wall
  int level;            ///< level whose output jumped (impact), the highest level used (lift-off)
  bool impact;          ///< false: lift-off
  double impulse;       ///< mu_{a,level}
};

/// What to make of a component where both u_i is at its bound and F_i = 0, up to rounding. Persistent contact
/// is full of them, and the largest set of constraints in contact is the one to take.
enum class Degenerate {
  undecided,
  at_bound,  ///< u_i is an output: it stays at its bound
  off_bound  ///< u_i is a multiplier: F_i, the output, is solved for
};

/// A component counts as held at its bound when it is below this, relative to the terms of its own row. Far
/// above what a solved row leaves (rounding), a hundredth of the certificate's tolerance, so that putting it
/// on the bound does not show in the certificate.
inline constexpr double held_rtol = 1e-12;

/// How far rows of a step are from being solved; of a rank's.
struct RowRatios {
  double worst = 0.0;        ///< largest |natural residual| over the row's terms; infinity where not finite
  bool by_distance = false;  ///< some row passes because u is close to a bound, not because F is small
  bool outside = false;      ///< some u_i is not in its interval
};

class AffineRows;
class BlockRows;

/// A step whose F is affine, F(u) = K u - b, and whose unknowns fall into blocks that may be solved one by
/// one, or are states and multipliers.
struct AffineStep {
  const AffineRows* rows = nullptr;   ///< K; null: the step is not of this kind
  Vec right_side = nullptr;           ///< b, of the step that was begun
  const BlockRows* blocks = nullptr;  ///< K by blocks; null: there are none
  /// Of each of this rank's unknowns: 0 of a state, which has no bounds, i >= 1 of a multiplier of level i.
  /// Null: no such distinction.
  const std::vector<int>* level = nullptr;
  /// Multipliers of this rank, in their order, that have the row nu = 0 in this step in place of that of K.
  /// May be shorter.
  const std::vector<char>* pinned = nullptr;
  std::uint64_t version = 0;  ///< where there are levels: changes with K
};

/// The elements of a system as blocks; a small system is a single one. @param block  of each unknown of this
/// rank @param size  of the system
inline std::vector<PetscInt> small_blocks(const std::vector<PetscInt>& block, PetscInt size) {
  constexpr PetscInt small = 12;
  return size <= small ? std::vector<PetscInt>(block.size(), 0) : block;
}

/// A differential variational inequality, one step at a time: find u in the box [l, b] with
///
///     F_i(u) >= 0 where u_i = l_i,   F_i(u) <= 0 where u_i = b_i,   F_i(u) = 0 between.
///
/// Each process is one implementation. The order of calls in a step: `begin` (the box, from what is known at
/// t_k), then any number of `residual`, `jacobian`, `row_terms`, then `settle` once the solver is done, then
/// `accept` if the settled point is certified and `admissible`. Without `accept` the state is still that of
/// t_k, and `begin` may be called again.
///
/// A process with a method of its own may find the solution itself (`predict`), or prove that there is none
/// (`obstacle`); SNESVI then only certifies.
///
/// All methods are collective on `comm()`. Vectors passed in have the layout of `state()`.
class Dvi {
public:
  virtual ~Dvi() = default;

  virtual MPI_Comm comm() const = 0;
  /// The unknowns u_k at the time reached so far.
  virtual Vec state() const = 0;
  /// A matrix with the pattern of dF/du, the same in every step.
  virtual Matrix create_jacobian() const = 0;

  /// Box rule: fills l and b for the step, PETSC_NINFINITY and PETSC_INFINITY where there is none, and a
  /// first guess.
  virtual void begin(const Step& step, Vec lower, Vec upper, Vec guess) = 0;
  /// Makes a copy of the guess of `begin` a solution up to rounding, and returns true; or returns false to
  /// have it improved by the active-set predictor.
  virtual bool predict(Vec) { return false; }
  /// Whether `predict` may return true.
  virtual bool predicts() const { return false; }
  /// Why this step has no solution, if that is proved; empty otherwise. Asked where `predict` found none,
  /// before SNES is set to work.
  virtual std::string obstacle() { return {}; }
  virtual void residual(Vec u, Vec f) = 0;
  /// Sum of the absolute values of the terms of each row of F: what its residual is judged against.
  virtual void row_terms(Vec u, Vec terms) = 0;
  /// terms = |dF/du| S, S_j = terms_j / max(1, max_i |dF_j/du_i|): what rows know of the terms of the
  /// unknowns they read. An unknown that is zero in exact arithmetic is only known up to what its own row,
  /// divided by its largest entry, is made of. (Undivided, stiff rows would excuse each other ever more.)
  /// Returns false where that has no meaning.
  virtual bool spread_terms(Vec) { return false; }
  /// Both at once.
  virtual void residual_and_terms(Vec u, Vec f, Vec terms) {
    residual(u, f);
    row_terms(u, terms);
  }
  /// What K is, while `jacobian_version` (with levels: `version`) stays the same. @note Not collective.
  virtual AffineStep affine() const { return {}; }
  virtual void jacobian(Vec u, Mat jacobian) = 0;
  /// dF/du itself, where `jacobian` gives a solver something that is easier to factor.
  virtual void derivative(Vec u, Mat matrix) { jacobian(u, matrix); }
  /// Changes whenever `jacobian` would give other values: a factorization may be kept while it stays the
  /// same.
  virtual std::uint64_t jacobian_version() const = 0;
  virtual Degenerate degenerate() const { return Degenerate::undecided; }
  /// Puts what is at its bound, up to rounding of its own row, exactly there: the largest active set.
  virtual void settle(Vec u) = 0;
  /// settle, residual_and_terms of what it leaves, and what rows make of that in the box [lower, upper].
  virtual RowRatios settle_and_judge(Vec u, Vec lower, Vec upper, Vec f, Vec terms);
  /// Whether a certified point is one that the process takes, where its VI has several solutions: the others
  /// count as unsolved. The same on every rank.
  virtual bool admissible(Vec) { return true; }
  /// Why not, if there is more to say about the point last asked for. The same on every rank.
  virtual std::string refusal() { return {}; }
  /// What is behind a step that no attempt could solve, as far as the process knows; empty otherwise.
  virtual std::string diagnosis() { return {}; }
  /// Takes u as the state at t_{k+1}. `f` is F(u).
  virtual void accept(Vec u, Vec f) = 0;

  /// Whether the next step may lead to where no motion does, and is to be looked at before it stands. The
  /// same on every rank. @note Not collective.
  virtual bool suspect() const { return false; }
  /// What is wrong with the state that was accepted last, of a step that was suspect; empty if nothing is.
  /// The same on every rank.
  virtual std::string defect() { return {}; }

  /// Shows the visitor every number that later steps, or the recording of this one, depend on. Replaced, they
  /// make the process go on from that moment; its time is told by the steps.
  virtual void visit(StateVisitor& visitor) = 0;

  /// From here on steps are h long. @return false, with nothing changed, where that would be another process:
  /// a controller acts once in each step, say.
  virtual bool set_step(double) { return false; }

  /// Worst violation of a constraint in the current state (0 if none).
  virtual double penetration() const = 0;
  /// Constraints in contact in the current state, on this rank.
  virtual PetscInt active() const = 0;
};

/// A Dvi for a system with state constraints, with what the recorder reads after each step.
class ConstrainedDvi : public Dvi {
public:
  virtual Vec x() const = 0;                         ///< scene coordinates, the system's layout
  virtual const std::vector<double>& w() const = 0;  ///< constraint values, this rank's
  virtual const std::vector<double>& z()
      const = 0;  ///< outputs, this rank's, constraint by constraint; may be empty
  virtual const std::vector<double>& mu()
      const = 0;  ///< [local constraint][level], measures of the last step; negative at an upper wall
  virtual int mu_levels() const = 0;                         ///< columns of `mu`
  virtual const std::vector<int>& level() const = 0;         ///< r* of the last step, per local constraint
  virtual const std::vector<Side>& side() const = 0;         ///< wall at which the last step began
  virtual const std::vector<StepEvent>& events() const = 0;  ///< of the last step, this rank's
  /// Replaces them, by who moves the process otherwise than in steps (hybrid.hpp).
  virtual void tell(std::vector<StepEvent> events) = 0;
};

}  // namespace sweepvi
