#pragma once

#include <array>
#include <memory>
#include <string>
#include <vector>

#include "sweepvi/dvi.hpp"

namespace sweepvi {

class OuterLinearisation;
class Predictor;

/// When a step counts as solved.
struct CertificateOptions {
  double rtol = 1e-10;        ///< -sweepvi_certificate_rtol: worst natural residual over row terms [-], > 0
  double target = 1e-14;      ///< -sweepvi_target_rtol: where the solver stops improving [-], > 0 and <= rtol
  double stagnation = 1e-12;  ///< it also stops below this when a step no longer improves: what then is left
                              ///< of a held output still counts as held
};

/// Where a step's solve starts.
struct PredictorOptions {
  bool active_set =
      true;  ///< -sweepvi_predictor active-set | none: guess by an active-set method, or the last state
};

/// Who linearises a step's VI, HO V.A.
enum class Linearisation {
  inner,  ///< the solver (SNESVI), which sees the nonlinear problem and judges its steps by it; the default
  outer  ///< we: affine VIs one after the other, each solved exactly and its solution taken whole. To compare
};

/// How a step's VI is solved.
struct SolverOptions {
  Linearisation linearisation = Linearisation::inner;  ///< -sweepvi_linearisation inner | outer
};

/// What came of a step.
struct StepReport {
  bool certified = false;
  double residual = 0.0;    ///< worst ratio |u - mid(l, b, u - F)|_i / terms_i of the point found
  PetscInt iterations = 0;  ///< Newton iterations, all attempts
  bool predicted = false;   ///< SNES accepted the predictor's guess as it was
  int rung = 0;             ///< attempt that succeeded, from 0; see StepSolver::rung_names
  int attempts = 0;         ///< made in all
  std::string reason;       ///< the solver's own word on the last attempt
  std::string obstacle;     ///< why there is no solution, where that is proved: no attempt was made then
};

/// Solves the box VI of one step with SNESVI and certifies the result row by row:
///
///     |u - mid(l, b, u - F(u))|_i  <=  rtol * (sum of the absolute values of the terms of row i)      for
///     all i.
///
/// A row without bounds whose unknowns all vanish in exact arithmetic consists of residue; only there, where
/// it fails otherwise, a tenth of the terms of the unknowns it reads counts as its own.
///
/// SNES stops when the certificate is met at `target`, or stops improving below 1e-12; its own tolerances do
/// not enter. A predictor guesses the solution first (src/vi/predictor.hpp), unless the process solved the
/// step itself; where the guess is right, SNES accepts it at iteration 0. Attempts, in order (the ladder):
/// the chosen SNESVI type from the step's guess, the other type from there, both from the projection of zero;
/// where the problem is small (100 unknowns) outer linearisation, whose affine VIs Lemke's pivoting method
/// solves, from the guess and from zero. With -sweepvi_linearisation outer that from the guess only. A
/// certified point that the process does not take (Dvi::admissible) is a failed attempt.
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
  /// @note Collective.
  StepReport solve(const Step& step);

  Vec solution() const { return u_.get(); }  ///< settled u of the last solve
  Vec residual() const { return f_.get(); }  ///< F at that point
  Mat jacobian() const { return jacobian_.get(); }
  SNES snes() const { return snes_; }
  const CertificateOptions& certificate() const { return certificate_; }

  static constexpr std::array<const char*, 6> rung_names = {
      "chosen", "other_type", "cold_start", "other_type_cold_start", "pivoting", "pivoting_cold_start"};
  using Rungs = std::array<std::int64_t, rung_names.size()>;
  const Rungs& rungs() const { return rungs_; }  ///< certified steps per rung

private:
  static PetscErrorCode form_function(SNES, Vec, Vec, void*);
  static PetscErrorCode form_jacobian(SNES, Vec, Mat, Mat, void*);
  static PetscErrorCode converged(SNES, PetscInt, PetscReal, PetscReal, PetscReal, SNESConvergedReason*,
                                  void*);
  void configure(SNES snes, const char* type);
  static void lift_step_limit(SNES snes);
  SNES other_snes();
  void choose_scale();
  double settled_ratio(Vec u);
  bool predict();
  Vec unscaled(Vec scaled_u);
  double worst_ratio(Vec u);
  void add_spread();
  double ratio_against(Vec u, Vec terms);
  PetscInt attempt(int rung, std::string& reason);
  PetscInt attempt_snes(bool other_type, bool cold, std::string& reason);
  PetscInt attempt_pivoting(bool cold, std::string& reason);
  void start_from(bool cold);

  Dvi& problem_;
  SNES snes_;
  NonlinearSolver other_;
  std::string chosen_type_;
  CertificateOptions certificate_;
  PredictorOptions predictor_options_;
  SolverOptions solver_options_;
  Matrix jacobian_;
  std::unique_ptr<Predictor> predictor_;
  std::unique_ptr<OuterLinearisation> pivoting_;
  Vector u_, f_, lower_, upper_, guess_, terms_, spread_, settled_;
  double sigma_ = 1.0;  // SNES works on sigma u and sigma F
  Vector snes_f_, snes_lower_, snes_upper_, unscaled_;
  double previous_ratio_ = 0.0;
  Rungs rungs_{};
  std::exception_ptr parked_;
};

}  // namespace sweepvi
