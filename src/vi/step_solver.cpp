#include "sweepvi/step_solver.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include <petsc/private/snesimpl.h>

#include "petsc/direct_solver.hpp"
#include "petsc/guarded_setup.hpp"
#include "petsc/log_event.hpp"
#include "petsc/sparse.hpp"
#include "vi/block_sweeps.hpp"
#include "vi/certificate.hpp"
#include "vi/data_test.hpp"
#include "vi/interior_point.hpp"
#include "vi/judged_point.hpp"
#include "vi/outer_linearisation.hpp"
#include "vi/path_sweeps.hpp"
#include "vi/predictor.hpp"
#include "vi/row_sweeps.hpp"

namespace sweepvi {

namespace {

constexpr double nearly = 1e-6;  // a ratio below which an attempt ended at a solution, but for rounding

void read_options(MPI_Comm comm, CertificateOptions& options, PredictorOptions& predictor,
                  SolverOptions& solver) {
  std::array<char, 64> chosen{"automatic"};
  std::array<char, 64> linearisation{"inner"};
  const auto read = [&]() -> PetscErrorCode {
    PetscFunctionBeginUser;
    PetscOptionsBegin(comm, nullptr, "sweepvi: step certificate", "sweepvi");
    PetscCall(PetscOptionsReal("-sweepvi_certificate_rtol",
                               "Worst natural residual of a step over row terms, and over row data [-], > 0",
                               "CertificateOptions", options.rtol, &options.rtol, nullptr));
    PetscCall(PetscOptionsReal("-sweepvi_target_rtol",
                               "Ratio at which the solver stops improving a step [-], > 0",
                               "CertificateOptions", options.target, &options.target, nullptr));
    // Not PetscOptionsEList: in PETSc 3.18 its message on an unknown value overruns its own buffer.
    PetscCall(PetscOptionsString("-sweepvi_predictor",
                                 "How a step's solution is guessed before SNES: automatic (by blocks or "
                                 "along paths, else active-set) | "
                                 "active-set | none",
                                 "PredictorOptions", chosen.data(), chosen.data(), chosen.size(), nullptr));
    PetscCall(PetscOptionsString("-sweepvi_linearisation",
                                 "Who linearises a step: inner, SNES on the nonlinear VI | outer, affine VIs "
                                 "in full steps (to compare)",
                                 "SolverOptions", linearisation.data(), linearisation.data(),
                                 linearisation.size(), nullptr));
    PetscCall(PetscOptionsInt("-sweepvi_halvings",
                              "A step that fails is taken in 2, 4, ... 2^this parts; 0: not divided",
                              "SolverOptions", solver.halvings, &solver.halvings, nullptr));
    PetscOptionsEnd();
    PetscFunctionReturn(static_cast<PetscErrorCode>(0));  // an enumeration in newer PETSc
  };
  check_options(read());
  const std::string name = chosen.data();
  if (name != "automatic" && name != "active-set" && name != "none")
    throw InputError("-sweepvi_predictor is '" + name + "'; expected automatic, active-set or none");
  predictor.sweeps = name == "automatic";
  predictor.active_set = name != "none";
  const std::string who = linearisation.data();
  if (who != "inner" && who != "outer")
    throw InputError("-sweepvi_linearisation is '" + who + "'; expected inner or outer");
  solver.linearisation = who == "inner" ? Linearisation::inner : Linearisation::outer;
  if (!(options.rtol > 0.0 && options.rtol < 1.0))
    throw InputError(
        "-sweepvi_certificate_rtol is outside (0, 1); it bounds the natural residual over row terms, 1e-10 "
        "by default");
  if (!(options.target > 0.0)) throw InputError("-sweepvi_target_rtol must be > 0; 1e-14 by default");
  if (solver.halvings < 0 || solver.halvings > 20)
    throw InputError(
        "-sweepvi_halvings is outside [0, 20]; steps that fail are halved so often, 10 by default");
  options.target = std::min(options.target, options.rtol);
  options.stagnation = std::min(options.stagnation, options.rtol);
}

}  // namespace

/// What -log_view shows of a step, besides PETSc's own events.
struct StepSolver::Events {
  LogEvent begin{"SweepviBegin"};      // box, right side and first guess
  LogEvent predict{"SweepviPredict"};  // guess, with what judging it takes
  LogEvent judge{"SweepviJudge"};      // settle and certify a point
};

StepSolver::StepSolver(SNES snes, Dvi& problem)
    : problem_(problem), snes_(snes), events_(std::make_unique<Events>()) {
  read_options(problem.comm(), certificate_, predictor_options_, solver_options_);
  jacobian_ = problem.create_jacobian();
  for (Vector* vector : {&u_, &f_, &snes_f_, &lower_, &upper_, &guess_, &terms_, &settled_, &snes_lower_,
                         &snes_upper_, &unscaled_})
    *vector = duplicate(problem.state());
  judge_ = std::make_unique<Certificate>(problem, certificate_);
  data_test_ = std::make_unique<DataTest>(problem, certificate_);
  judged_ = std::make_unique<JudgedPoint>(problem.comm());
  function_ = snes_f_.get();
  for (Vector* bound : {&lower_, &snes_lower_})
    check(VecSet(bound->get(), PETSC_NINFINITY));
  for (Vector* bound : {&upper_, &snes_upper_})
    check(VecSet(bound->get(), PETSC_INFINITY));

  std::array<char, 64> asked{};
  PetscBool given = PETSC_FALSE;
  const char* prefix = nullptr;
  check(SNESGetOptionsPrefix(snes_, &prefix));
  check(PetscOptionsGetString(nullptr, prefix, "-snes_type", asked.data(), asked.size(), &given));
  chosen_type_ = given == PETSC_TRUE ? asked.data() : SNESVINEWTONRSLS;
  if (chosen_type_ != SNESVINEWTONRSLS && chosen_type_ != SNESVINEWTONSSLS)
    throw InputError("-snes_type " + chosen_type_ +
                     " does not solve box VIs; use vinewtonrsls or vinewtonssls");
  configure(snes_, chosen_type_.c_str());
  if (predictor_options_.sweeps) paths_ = std::make_unique<PathPredictor>(problem);
  if (predictor_options_.active_set) predictor_ = std::make_unique<Predictor>(problem, jacobian_.get());
  if (solver_options_.linearisation == Linearisation::outer)
    pivoting_ = std::make_unique<OuterLinearisation>(problem);  // now, because it may refuse
}

StepSolver::~StepSolver() = default;

// Defaults first, then the options database, then what is not open to options. The type comes before all:
// changing it resets the convergence test and the line search.
void StepSolver::configure(SNES snes, const char* type) {
  check(SNESSetType(snes, type));
  check(SNESSetTolerances(snes, 0.0, 0.0, 0.0, 100, PETSC_MAX_INT));
  KSP ksp = nullptr;
  PC pc = nullptr;
  check(SNESGetKSP(snes, &ksp));
  default_to_mumps(ksp);
  // An absolute zone around the bounds would pin honest small outputs (h^3 after lift-off): none, unless
  // asked for by -snes_vi_zero_tolerance. PETSc has no setter for it.
  snes->vizerotolerance = 0.0;
  check_options(SNESSetFromOptions(snes));
  check(SNESSetType(snes, type));                        // -snes_type names the chosen one only
  check(SNESSetErrorIfNotConverged(snes, PETSC_FALSE));  // a step without solution is a result
  check(KSPSetErrorIfNotConverged(ksp, PETSC_FALSE));
  check(KSPGetPC(ksp, &pc));
  check_factorization(pc, jacobian_.get());
  try_preconditioner(ksp, jacobian_.get());
  guard_setup(ksp);
  lift_step_limit(snes);
  check(SNESSetFunction(snes, snes_f_.get(), form_function, this));
  check(SNESSetJacobian(snes, jacobian_.get(), jacobian_.get(), form_jacobian, this));
  check(SNESSetConvergenceTest(snes, converged, this, nullptr));
  check(SNESVISetVariableBounds(snes, snes_lower_.get(), snes_upper_.get()));
}

// The line search must not cut steps by their absolute length, as PETSc's default of 1e8 does.
void StepSolver::lift_step_limit(SNES snes) {
  constexpr PetscReal petsc_default = 1e8;
  SNESLineSearch search = nullptr;
  check(SNESGetLineSearch(snes, &search));
  PetscReal shortest = 0.0;
  PetscReal longest = 0.0;
  PetscReal rtol = 0.0;
  PetscReal atol = 0.0;
  PetscReal step_tolerance = 0.0;
  PetscInt iterations = 0;
  check(SNESLineSearchGetTolerances(search, &shortest, &longest, &rtol, &atol, &step_tolerance, &iterations));
  if (longest == petsc_default) longest = PETSC_MAX_REAL;
  check(SNESLineSearchSetTolerances(search, shortest, longest, rtol, atol, step_tolerance, iterations));
}

// The SNESVI type that was not chosen, made when it is first needed. A SNES of its own: a change of type
// would leave the line search and the factorization of the other one behind.
SNES StepSolver::other_snes() {
  if (!other_) {
    check(SNESCreate(problem_.comm(), other_.put()));
    configure(other_.get(), chosen_type_ == SNESVINEWTONRSLS ? SNESVINEWTONSSLS : SNESVINEWTONRSLS);
  }
  return other_.get();
}

// SNES sees sigma u and sigma F: the Jacobian stays.
PetscErrorCode StepSolver::form_function(SNES, Vec scaled_u, Vec f, void* context) {
  auto& self = *static_cast<StepSolver*>(context);
  return guarded(self.parked_, [&] {
    Vec u = self.unscaled(scaled_u);
    if (!self.judged_->is(u))
      self.problem_.residual(u, f);
    else if (f != self.f_.get())
      check(VecCopy(self.f_.get(), f));
    if (self.sigma_ != 1.0) check(VecScale(f, self.sigma_));
  });
}

PetscErrorCode StepSolver::form_jacobian(SNES, Vec scaled_u, Mat, Mat jacobian, void* context) {
  auto& self = *static_cast<StepSolver*>(context);
  return guarded(self.parked_, [&] { self.problem_.jacobian(self.unscaled(scaled_u), jacobian); });
}

Vec StepSolver::unscaled(Vec scaled_u) {
  if (sigma_ == 1.0) return scaled_u;
  check(VecCopy(scaled_u, unscaled_.get()));
  check(VecScale(unscaled_.get(), 1.0 / sigma_));
  return unscaled_.get();
}

// PETSc's absolute thresholds (the semismooth derivative switches below 1e-6) must lie below the rounding of
// the step's own numbers: sigma is the power of two, exact in every product, that brings the largest row term
// to 2^40.
void StepSolver::choose_scale() {
  problem_.row_terms(guess_.get(), terms_.get());
  double largest = 0.0;
  check(VecNorm(terms_.get(), NORM_INFINITY, &largest));
  const bool ordinary = largest > 0.0 && std::isfinite(largest);
  sigma_ = ordinary ? std::ldexp(1.0, std::clamp(40 - std::ilogb(largest), -1000, 1000)) : 1.0;
  const auto scale = [&](const Vector& bounds, const Vector& scaled) {
    const ReadArray from(bounds.get());
    const WriteArray to(scaled.get());
    for (PetscInt i = 0; i < from.size(); ++i) {
      const bool infinite = from[i] <= PETSC_NINFINITY || from[i] >= PETSC_INFINITY;
      to[i] = infinite ? from[i] : sigma_ * from[i];
    }
  };
  scale(lower_, snes_lower_);
  scale(upper_, snes_upper_);
  bind(snes_lower_.get(), snes_upper_.get(), snes_f_.get());
}

void StepSolver::bind(Vec lower, Vec upper, Vec f) {
  function_ = f;
  if (bound_ == lower) return;
  check(SNESVISetVariableBounds(snes_, lower, upper));
  bound_ = lower;
}

// Our own test: the certificate of the settled point, and whether it still improves.
PetscErrorCode StepSolver::converged(SNES snes, PetscInt iteration, PetscReal, PetscReal, PetscReal,
                                     SNESConvergedReason* reason, void* context) {
  auto& self = *static_cast<StepSolver*>(context);
  return guarded(self.parked_, [&] {
    Vec u = nullptr;
    check(SNESGetSolution(snes, &u));
    const double ratio = self.settled_ratio(self.unscaled(u));
    const bool improves = iteration == 0 || ratio < 0.9 * self.previous_ratio_;
    self.previous_ratio_ = ratio;
    if (!std::isfinite(ratio)) {
      *reason = SNES_DIVERGED_FNORM_NAN;
    } else if (ratio <= self.certificate_.target || (ratio <= self.certificate_.stagnation && !improves)) {
      *reason = SNES_CONVERGED_FNORM_RELATIVE;
    } else {
      *reason = SNES_CONVERGED_ITERATING;
    }
  });
}

// The certificate of what `u` settles to, settled_; `u` itself is left alone. Where the
// predictor was right a step asks more than once: what has settled settles to itself, and is known then.
double StepSolver::settled_ratio(Vec u) {
  if (judged_->is(u)) return judged_->ratio();
  const LogEvent::Scope logged(events_->judge);
  check(VecCopy(u, settled_.get()));
  const double ratio = judge_->settled_ratio(settled_.get(), lower_.get(), upper_.get(), f_.get());
  judged_->set(settled_.get(), f_.get(), ratio, judge_->inside());
  return ratio;
}

// The same of u_, which becomes what it settles to.
double StepSolver::settle() {
  const LogEvent::Scope logged(events_->judge);
  const double ratio = judge_->settled_ratio(u_.get(), lower_.get(), upper_.get(), f_.get());
  judged_->set(u_.get(), f_.get(), ratio, judge_->inside());
  return ratio;
}

// Whether there are blocks, and sweeps over them contract.
bool StepSolver::prepare_sweeps(const AffineStep& affine) {
  if (affine.blocks == nullptr) return false;
  if (!row_sweeps_ || swept_version_ != problem_.jacobian_version()) {
    row_sweeps_ = std::make_unique<RowSweeps>(problem_.comm(), *affine.blocks, problem_.degenerate());
    sweeps_.reset();
    swept_version_ = problem_.jacobian_version();
  }
  return row_sweeps_->worthwhile() || prepare_block_sweeps(affine);
}

bool StepSolver::prepare_block_sweeps(const AffineStep& affine) {
  if (!sweeps_)
    sweeps_ = std::make_unique<BlockSweeps>(problem_.comm(), *affine.blocks, problem_.degenerate());
  return sweeps_->worthwhile();
}

// Row by row, where diagonals govern.
bool StepSolver::sweep_rows(const AffineStep& affine) {
  constexpr int most_rounds = 2;
  if (!row_sweeps_->worthwhile()) return false;
  check(VecCopy(guess_.get(), u_.get()));
  for (int round = 0; round < most_rounds; ++round) {
    row_sweeps_->solve(u_.get(), affine.right_side, lower_.get(), upper_.get());
    if (settle() <= certificate_.target) return true;
  }
  return false;
}

// By blocks, where the step has some that read each other weakly.
bool StepSolver::sweep() {
  constexpr int most_rounds = 6;
  if (!predictor_options_.sweeps) return false;
  const AffineStep affine = problem_.affine();
  if (!prepare_sweeps(affine)) return false;
  if (sweep_rows(affine)) return true;
  if (!prepare_block_sweeps(affine)) return false;
  bool refines = false;
  for (int round = 0; round < most_rounds; ++round) {
    Vec start = round == 0 ? guess_.get() : u_.get();
    if (!refines && !sweeps_->solve(start, u_.get(), affine.right_side, lower_.get(), upper_.get()))
      return false;
    const double ratio = settle();
    if (ratio <= certificate_.target) return true;
    // Rounding is refined away; if it does not go, a set was wrong: neighbours were not yet where they are
    // now.
    refines = !refines && ratio <= nearly;
    if (refines) sweeps_->refine(u_.get(), f_.get());
  }
  return false;
}

// Puts the predictor's guess into u_ if that one is good to rounding.
bool StepSolver::predict() {
  process_predicted_ = false;
  if (!predictor_) return false;
  const LogEvent::Scope logged(events_->predict);
  if (problem_.predicts()) {
    check(VecCopy(guess_.get(), u_.get()));
    process_predicted_ = problem_.predict(u_.get());
    if (process_predicted_) {
      settle();
      return true;
    }
    check(VecCopy(u_.get(), guess_.get()));
  }
  if (sweep()) return true;
  check(VecCopy(guess_.get(), u_.get()));
  const auto ratio = [this](Vec u) { return settled_ratio(u); };
  if (paths_ && paths_->improve(u_.get(), lower_.get(), upper_.get(), certificate_.target, ratio)) {
    check(VecCopy(settled_.get(), u_.get()));  // is known, and need not be judged again
    return true;
  }
  check(VecCopy(guess_.get(), u_.get()));
  const Predictor::Outcome outcome =
      predictor_->improve(u_.get(), lower_.get(), upper_.get(), certificate_.target, ratio);
  at_guess_ = outcome != Predictor::Outcome::failed;
  if (outcome == Predictor::Outcome::creeping) return predict_interior();
  return outcome == Predictor::Outcome::solved;
}

// By the interior-point method from u_, which stays where that fails.
bool StepSolver::predict_interior() {
  const Vector point = duplicate(u_.get());
  check(VecCopy(u_.get(), point.get()));
  static_cast<void>(interior().solve(u_.get(), lower_.get(), upper_.get(), certificate_,
                                     InteriorPoint::Begin::on_path,
                                     [this](Vec u) { return settled_ratio(u); }));
  const double reached = settle();
  if (!(reached <= certificate_.rtol)) check(VecCopy(point.get(), u_.get()));
  return reached <= certificate_.target;
}

InteriorPoint& StepSolver::interior() {
  if (!interior_) interior_ = std::make_unique<InteriorPoint>(problem_);
  return *interior_;
}

std::string StepSolver::predictor() {
  if (!predictor_) return "nobody";
  if (problem_.predicts()) return "the process itself";
  if (predictor_options_.sweeps && prepare_sweeps(problem_.affine())) return "blocks";
  if (paths_ && paths_->applies()) return "paths";
  return "active set";
}

double StepSolver::mumps_flops() {
  KSP own = nullptr;
  check(SNESGetKSP(snes_, &own));
  const double of_snes = sweepvi::mumps_flops(own);
  return of_snes > 0.0 || !predictor_ ? of_snes : sweepvi::mumps_flops(predictor_->solver());
}

double StepSolver::worst_ratio(Vec u) {
  judged_->forget();  // f_ becomes that of u
  return judge_->worst_ratio(u, lower_.get(), upper_.get(), f_.get());
}

// The attempts open to this problem.
std::vector<Rung> StepSolver::ladder(bool brief) {
  if (solver_options_.linearisation == Linearisation::outer) return {Rung::pivoting};
  PetscInt size = 0;
  check(VecGetSize(u_.get(), &size));
  const bool pivots = size <= OuterLinearisation::largest;
  std::vector<Rung> rungs = {Rung::chosen, Rung::other_type};
  if (!brief && !pivots) rungs.push_back(Rung::interior_point);
  if (!brief) rungs.insert(rungs.end(), {Rung::cold_start, Rung::other_type_cold_start});
  if (pivots) rungs.push_back(Rung::pivoting);
  if (brief) return rungs;
  if (pivots) rungs.push_back(Rung::pivoting_cold_start);
  if (size <= OuterLinearisation::largest_searched) rungs.push_back(Rung::enumeration);
  if (pivots) rungs.push_back(Rung::interior_point);
  return rungs;
}

PetscInt StepSolver::attempt(Rung rung, std::string& reason) {
  if (rung == Rung::interior_point) return attempt_interior(reason);
  return rung >= Rung::pivoting ? attempt_pivoting(rung, reason) : attempt_snes(rung, reason);
}

void StepSolver::start_from(bool cold) {
  if (std::exchange(at_guess_, false) && !cold) return;
  if (cold) {
    check(VecSet(u_.get(), 0.0));
  } else {
    check(VecCopy(guess_.get(), u_.get()));
  }
}

PetscInt StepSolver::attempt_snes(Rung rung, std::string& reason) {
  const bool other_type = rung == Rung::other_type || rung == Rung::other_type_cold_start;
  SNES snes = other_type ? other_snes() : snes_;
  start_from(rung >= Rung::cold_start);
  if (sigma_ != 1.0) check(VecScale(u_.get(), sigma_));
  // A semismooth solve that broke off leaves its own function in place of ours.
  check(SNESSetFunction(snes, function_, form_function, this));
  judged_->expect_projection(u_.get());
  const PetscErrorCode code = SNESSolve(snes, nullptr, u_.get());
  check(code, parked_);
  if (sigma_ != 1.0) check(VecScale(u_.get(), 1.0 / sigma_));
  PetscInt iterations = 0;
  check(SNESGetIterationNumber(snes, &iterations));
  const char* text = nullptr;
  check(SNESGetConvergedReasonString(snes, &text));
  reason = text;
  SNESConvergedReason outcome = SNES_CONVERGED_ITERATING;
  check(SNESGetConvergedReason(snes, &outcome));
  if (outcome == SNES_DIVERGED_LINEAR_SOLVE) {
    KSP ksp = nullptr;
    check(SNESGetKSP(snes, &ksp));
    check_setup(ksp);
    const PCFailedReason why = failed_reason(ksp);
    const std::string error = setup_error(ksp);
    // Iterations made before that do not count: another run, which has the workspace already, has none.
    if (recover(ksp)) return attempt_snes(rung, reason);
    ++failed_solves_;
    failure_ = why;
    setup_error_ = error;
  }
  return iterations;
}

PetscInt StepSolver::attempt_interior(std::string& reason) {
  start_from(false);
  const InteriorPoint::Result result =
      interior().solve(u_.get(), lower_.get(), upper_.get(), certificate_, InteriorPoint::Begin::by_sets,
                       [this](Vec u) { return settled_ratio(u); });
  reason = result.reason;
  if (result.linear_failure) ++failed_solves_;
  return result.iterations;
}

PetscInt StepSolver::attempt_pivoting(Rung rung, std::string& reason) {
  if (!pivoting_) pivoting_ = std::make_unique<OuterLinearisation>(problem_);
  start_from(rung == Rung::pivoting_cold_start);
  const auto ratio = [this](Vec u) { return settled_ratio(u); };
  const OuterLinearisation::Result result =
      pivoting_->iterate(u_.get(), lower_.get(), upper_.get(), certificate_, ratio,
                         rung == Rung::enumeration ? AffineMethod::enumeration : AffineMethod::lemke);
  reason = result.reason;
  return result.iterations;
}

std::string StepSolver::linear_failure() const {
  if (failed_solves_ == 0) return {};
  const char* cause = failure_ == PC_FACTOR_OUTMEMORY ? "the factorization ran out of memory"
                      : failure_ == PC_FACTOR_STRUCT_ZEROPIVOT || failure_ == PC_FACTOR_NUMERIC_ZEROPIVOT
                          ? "its matrix is singular"
                      : failure_ == PC_NOERROR ? "the linear solver did not converge"
                                               : "the factorization failed";
  return "in " + std::to_string(failed_solves_) + " of the attempts a linear system could not be solved: " +
         (setup_error_.empty() ? cause : setup_error_);
}

// Where SNES ends near a solution of a badly conditioned problem, rounding flips degenerate rows between its
// sets. The predictor keeps them once they are right, and refines.
double StepSolver::polish() {
  const double before = worst_ratio(u_.get());
  if (!predictor_) return before;
  const Vector point = duplicate(u_.get());
  check(VecCopy(u_.get(), point.get()));
  predictor_->improve(u_.get(), lower_.get(), upper_.get(), certificate_.target,
                      [this](Vec u) { return settled_ratio(u); });
  problem_.settle(u_.get());
  const double after = worst_ratio(u_.get());
  if (after < before) return after;
  check(VecCopy(point.get(), u_.get()));
  return worst_ratio(u_.get());
}

// Of u_, whose rows are certified, with F in f_. Where it is refined, its rows are judged again.
bool StepSolver::holds_against_data(StepReport& report) {
  const LogEvent::Scope logged(events_->judge);
  const DataTest::Verdict verdict =
      data_test_->judge(u_.get(), f_.get(), judge_->terms(), report.residual, lower_.get(), upper_.get());
  if (verdict == DataTest::Verdict::refined) {
    report.refined = true;
    report.residual = settle();
  }
  if (verdict != DataTest::Verdict::fails) return report.residual <= certificate_.rtol;
  report.reason += ", at a point whose residual is small only against terms that cancel,";
  report.diagnosis = "u runs away along a direction in which M vanishes: no solution is near the best point";
  return false;
}

std::optional<ErrorEstimate> StepSolver::refine() {
  judged_->forget();
  return data_test_->refine(u_.get(), f_.get(), lower_.get(), upper_.get());
}

StepReport StepSolver::solve(const Step& step, bool brief) {
  {
    const LogEvent::Scope logged(events_->begin);
    problem_.begin(step, lower_.get(), upper_.get(), guess_.get());
  }
  judged_->forget();
  at_guess_ = false;
  failed_solves_ = 0;
  setup_error_.clear();
  const bool predicted = predict();
  if (predicted) {  // SNES looks at it once
    sigma_ = 1.0;
    bind(lower_.get(), upper_.get(), f_.get());
    at_guess_ = true;
  } else {
    choose_scale();
  }
  StepReport best;
  best.residual = std::numeric_limits<double>::infinity();
  if (!predicted) best.obstacle = problem_.obstacle();
  if (!best.obstacle.empty()) {
    check(VecCopy(guess_.get(), u_.get()));
    return best;
  }
  PetscInt iterations = 0;
  int attempts = 0;
  Vector best_point;
  std::string pivoting;
  for (const Rung rung : ladder(brief)) {
    StepReport report;
    report.rung = rung;
    report.attempts = ++attempts;
    if (predicted && attempts == 2) {
      if (process_predicted_) static_cast<void>(problem_.predict(guess_.get()));  // where others start from
      choose_scale();
    }
    iterations += attempt(rung, report.reason);
    if (rung == Rung::pivoting) pivoting = report.reason;
    report.residual = settled_ratio(u_.get());
    if (!judged_->is(u_.get())) check(VecCopy(settled_.get(), u_.get()));
    if (report.residual > certificate_.rtol && report.residual <= nearly) report.residual = polish();
    const bool solved = report.residual <= certificate_.rtol && holds_against_data(report);
    report.certified = solved && problem_.admissible(u_.get());
    if (solved && !report.certified) {
      report.reason += ", at a solution on a branch that the process refuses,";
      report.obstacle = problem_.refusal();
    }
    report.predicted = predicted && attempts == 1 && iterations == 0;
    if (report.certified) {
      report.iterations = iterations;
      if (report.predicted) report.rung = Rung::predictor;
      return report;
    }
    if (report.residual < best.residual || attempts == 1) {
      best = report;
      if (!best_point) best_point = duplicate(u_.get());
      check(VecCopy(u_.get(), best_point.get()));
    }
    best.attempts = attempts;
  }
  best.iterations = iterations;
  best.linear_failure = linear_failure();
  if (best.obstacle.empty()) {
    const std::string cause = problem_.diagnosis();
    if (!cause.empty()) best.diagnosis += (best.diagnosis.empty() ? "" : "; ") + cause;
  }
  if (!pivoting.empty() && pivoting != best.reason) best.reason += " (pivoting: " + pivoting + ")";
  check(VecCopy(best_point.get(), u_.get()));
  problem_.residual(u_.get(), f_.get());
  return best;
}

}  // namespace sweepvi
