#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "sweepvi/dvi.hpp"

namespace sweepvi {

class BlockSweeps;
class RowSweeps;
class PathPredictor;
class Certificate;
class DataTest;
class JudgedPoint;
class InteriorPoint;
class OuterLinearisation;
class Predictor;

/// When a step counts as solved.
struct CertificateOptions {
  double rtol = 1e-10;    ///< -sweepvi_certificate_rtol: worst natural residual over row terms, and over row
                          ///< data [-], > 0
  double target = 1e-14;  ///< -sweepvi_target_rtol: where the solver stops improving [-], > 0 and <= rtol
  double stagnation = 1e-12;  ///< it also stops below this when a step no longer improves: what then is left
                              ///< of a held output still counts as held

  /// Whether what it passes may be called certified. What was computed with a looser tolerance is done, and
  /// no more (ExitCode::uncertified).
  bool certifies() const { return rtol <= loosest; }
  static constexpr double loosest = 1e-6;
};

/// Where a step's solve starts.
/// -sweepvi_predictor automatic | active-set | none
struct PredictorOptions {
  bool sweeps = true;      ///< over blocks, where there are some that read each other weakly
  bool active_set = true;  ///< by an active-set method; without both: the last state
};

/// Who linearises a step's VI, HO V.A.
enum class Linearisation {
  inner,  ///< the solver (SNESVI), which sees the nonlinear problem and judges its steps by it; the default
  outer  ///< we: affine VIs one after the other, each solved exactly and its solution taken whole. To compare
};

/// How a step's VI is solved.
struct SolverOptions {
  Linearisation linearisation = Linearisation::inner;  ///< -sweepvi_linearisation inner | outer
  PetscInt halvings =
      10;  ///< -sweepvi_halvings: a step that fails is taken in 2, 4, ... 2^halvings parts; 0: not
};

/// The attempts at a step, in the order in which they are made: the ladder.
enum class Rung : int {
  predictor,              ///< SNES accepts the predictor's guess as it is
  chosen,                 ///< the chosen SNESVI type from the step's guess
  other_type,             ///< the other type from there
  cold_start,             ///< the chosen type from the projection of zero
  other_type_cold_start,  ///< the other type from there
  pivoting,               ///< small problems: outer linearisation, whose affine VIs Lemke's method solves
  pivoting_cold_start,    ///< the same from the projection of zero
  enumeration,     ///< very small ones: its affine VIs by other starts of Lemke's method, then by trying
                   ///< for each unknown whether it is at a bound
  interior_point,  ///< an interior-point method and proximal steps, for degenerate monotone problems of any
                   ///< size; before the cold starts where the problem is too large for pivoting
  smaller_step,    ///< several smaller steps in place of one
  hybrid           ///< an interval of the hybrid scheme, which takes steps only where it must
};

/// What came of a step.
struct StepReport {
  bool certified = false;
  bool refined = false;     ///< by residuals summed in twofold precision, where those of doubles tell nothing
  double residual = 0.0;    ///< worst ratio of the point found, see StepSolver
  PetscInt iterations = 0;  ///< Newton iterations, all attempts
  bool predicted = false;   ///< SNES accepted the predictor's guess as it was
  Rung rung = Rung::chosen;    ///< attempt that succeeded
  int attempts = 0;            ///< made in all
  PetscInt parts = 1;          ///< in which the step was taken; above 1 it is that of smaller steps
  std::string reason;          ///< the solver's own word on the last attempt
  std::string linear_failure;  ///< why linear systems could not be solved, and in how many attempts; or empty
  std::string obstacle;   ///< why there is no solution, where that is proved (no attempt was made then), or
                          ///< why the process does not take the one found
  std::string diagnosis;  ///< what may be behind a step that no attempt could solve
};

/// How far the solution of a step may be off.
struct ErrorEstimate {
  Vector error;             ///< of each unknown, in its unit
  double of_largest = 0.0;  ///< the largest of them, over the largest |u_i|
};

/// The box VI of a step in numbers: F(u) = M u + q, l <= u <= b.
struct StepProblem {
  Matrix M;
  Vector q;
  Vector terms;  ///< sums of the absolute values of the terms that each q_i was summed from
  Vector lower, upper;
  Vector u0;            ///< the best point found
  bool affine = false;  ///< or the linearisation at u0
};

/// Solves the box VI of one step with SNESVI and certifies the result row by row, against the terms of the
/// row and against its data:
///
///     |u - mid(l, b, u - F(u))|_i  <=  rtol * (sum of the absolute values of the terms of row i)
///     |v - mid(l, b, v - F(v))|_i  <=  rtol * (size of the data of row i)                          for all i
///
/// where v is u, or what iterative refinement with residuals in twofold precision makes of it
/// (src/vi/certificate.hpp and src/vi/data_test.hpp have the small print). SNES stops when the certificate is
/// met at `target`, or stops improving below 1e-12; its own tolerances do not enter. A predictor guesses the
/// solution first (src/vi/predictor.hpp), unless the process solved the step itself; where the guess is
/// right, SNES accepts it at iteration 0. Where an attempt fails the next one is made, in the order of Rung;
/// pivoting for up to OuterLinearisation::largest unknowns. With -sweepvi_linearisation outer only pivoting
/// from the guess. A certified point that the process does not take (Dvi::admissible) is a failed attempt.
class StepSolver {
public:
  /// @param snes  set up here with defaults (reduced space, preonly + LU by MUMPS), then SNESSetFromOptions:
  /// the options
  ///              database has the last word
  /// @note Collective on the problem's communicator.
  StepSolver(SNES snes, Dvi& problem);
  ~StepSolver();
  StepSolver(const StepSolver&) = delete;
  StepSolver& operator=(const StepSolver&) = delete;

  /// Solves the step for which the problem's `begin` fills bounds and guess; settles the point found and
  /// certifies it. A step that cannot be certified is a result, not an error. The problem is left before
  /// `accept`.
  /// @param brief  only from the step's own guess: a part of a step that is tried in parts has a good one
  /// @note Collective.
  StepReport solve(const Step& step, bool brief = false);

  /// How far the certified point of the last solve may be off: what the rounding of each term in each row
  /// makes of it (a backward error of 2e-16). Refines it first: the solution then is good to rounding of its
  /// own, as far as M and q are exact, and `residual` is F there. Takes a factorization. @return nothing
  /// where the rows of its active set do not determine it: another solution is near @note Collective.
  std::optional<ErrorEstimate> refine();

  Vec solution() const { return u_.get(); }  ///< settled u of the last solve
  Vec residual() const { return f_.get(); }  ///< F at that point
  Mat jacobian() const { return jacobian_.get(); }
  SNES snes() const { return snes_; }
  const CertificateOptions& certificate() const { return certificate_; }
  const SolverOptions& options() const { return solver_options_; }

  /// Who guesses steps first: "blocks", "paths", "active set", "the process itself" or "nobody". @note
  /// Collective.
  std::string predictor();
  /// Floating-point operations of the last factorization, as MUMPS counts them; 0 if it made none. @note
  /// Collective.
  double mumps_flops();

  /// The VI of the last solve, as long as the problem has not gone on. @note Collective.
  StepProblem problem();
  /// Back to a step solved before, for which the problem begins again, and to the point found then. @note
  /// Collective.
  void return_to(const Step& step, Vec point);

  static constexpr std::array<const char*, 11> rung_names = {"predictor",
                                                             "chosen",
                                                             "other_type",
                                                             "cold_start",
                                                             "other_type_cold_start",
                                                             "pivoting",
                                                             "pivoting_cold_start",
                                                             "enumeration",
                                                             "interior_point",
                                                             "smaller_step",
                                                             "hybrid"};  ///< by Rung
  using Rungs = std::array<std::int64_t, rung_names.size()>;             ///< steps certified by each

private:
  static PetscErrorCode form_function(SNES, Vec, Vec, void*);
  static PetscErrorCode form_jacobian(SNES, Vec, Mat, Mat, void*);
  static PetscErrorCode converged(SNES, PetscInt, PetscReal, PetscReal, PetscReal, SNESConvergedReason*,
                                  void*);
  void configure(SNES snes, const char* type);
  static void lift_step_limit(SNES snes);
  SNES other_snes();
  void choose_scale();
  void bind(Vec lower, Vec upper, Vec f);
  double settled_ratio(Vec u);
  double settle();
  bool predict();
  bool predict_interior();
  InteriorPoint& interior();
  bool sweep();
  bool prepare_sweeps(const AffineStep& affine);
  bool prepare_block_sweeps(const AffineStep& affine);
  bool sweep_rows(const AffineStep& affine);
  Vec unscaled(Vec scaled_u);
  double worst_ratio(Vec u);
  bool holds_against_data(StepReport& report);
  std::vector<Rung> ladder(bool brief);
  PetscInt attempt(Rung rung, std::string& reason);
  PetscInt attempt_snes(Rung rung, std::string& reason);
  PetscInt attempt_interior(std::string& reason);
  PetscInt attempt_pivoting(Rung rung, std::string& reason);
  double polish();
  void start_from(bool cold);
  std::string linear_failure() const;

  struct Events;

  Dvi& problem_;
  SNES snes_;
  NonlinearSolver other_;
  std::string chosen_type_;
  CertificateOptions certificate_;
  PredictorOptions predictor_options_;
  SolverOptions solver_options_;
  Matrix jacobian_;
  std::unique_ptr<Certificate> judge_;
  std::unique_ptr<DataTest> data_test_;
  std::unique_ptr<JudgedPoint> judged_;  // by judge_, with F in f_
  std::unique_ptr<RowSweeps> row_sweeps_;
  std::unique_ptr<BlockSweeps> sweeps_;
  std::uint64_t swept_version_ = 0;  // of the Jacobian that sweeps_ is for
  std::unique_ptr<PathPredictor> paths_;
  std::unique_ptr<Predictor> predictor_;
  std::unique_ptr<OuterLinearisation> pivoting_;  // from the first step that needs it
  std::unique_ptr<InteriorPoint> interior_;       // likewise
  Vector u_, f_, lower_, upper_, guess_;
  Vector settled_;                  // what a point of SNES settles to
  bool at_guess_ = false;           // u_ is where SNES shall start
  bool process_predicted_ = false;  // that, and guess_ is as the step began
  double sigma_ = 1.0;              // SNES works on sigma u and sigma F
  Vec bound_ = nullptr;             // lower bounds that snes_ has
  Vec function_ = nullptr;          // where it has F
  Vector snes_f_, snes_lower_, snes_upper_, unscaled_, terms_;
  double previous_ratio_ = 0.0;
  int failed_solves_ = 0;  // attempts of this step that ended in a linear system
  PCFailedReason failure_ = PC_NOERROR;
  std::string setup_error_;  // PETSc's own words on that, if it raised an error
  std::exception_ptr parked_;
  std::unique_ptr<Events> events_;
};

}  // namespace sweepvi
