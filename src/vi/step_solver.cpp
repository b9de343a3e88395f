#include "sweepvi/step_solver.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include <petsc/private/snesimpl.h>

#include "petsc/sparse.hpp"

namespace sweepvi {

namespace {

void read_options(MPI_Comm comm, CertificateOptions& options) {
  const auto read = [&]() -> PetscErrorCode {
    PetscFunctionBeginUser;
    PetscOptionsBegin(comm, nullptr, "sweepvi: step certificate", "sweepvi");
    PetscCall(PetscOptionsReal("-sweepvi_certificate_rtol", "Worst natural residual over row terms of a step [-], > 0",
                               "CertificateOptions", options.rtol, &options.rtol, nullptr));
    PetscCall(PetscOptionsReal("-sweepvi_target_rtol", "Ratio at which the solver stops improving a step [-], > 0",
                               "CertificateOptions", options.target, &options.target, nullptr));
    PetscOptionsEnd();
    PetscFunctionReturn(0);
  };
  check(read());
  if (!(options.rtol > 0.0 && options.rtol < 1.0))
    throw InputError(
        "-sweepvi_certificate_rtol is outside (0, 1); it bounds the natural residual over row terms, 1e-10 by default");
  if (!(options.target > 0.0)) throw InputError("-sweepvi_target_rtol must be > 0; 1e-14 by default");
  options.target = std::min(options.target, options.rtol);
}

double mid(double l, double b, double v) { return std::min(std::max(v, l), b); }

}  // namespace

StepSolver::StepSolver(SNES snes, Dvi& problem) : problem_(problem), snes_(snes) {
  read_options(problem.comm(), certificate_);
  jacobian_ = problem.create_jacobian();
  for (Vector* vector : {&u_, &f_, &snes_f_, &lower_, &upper_, &guess_, &terms_, &settled_}) *vector = duplicate(problem.state());
  check(VecSet(lower_.get(), PETSC_NINFINITY));
  check(VecSet(upper_.get(), PETSC_INFINITY));

  check(SNESSetType(snes_, SNESVINEWTONRSLS));
  configure(snes_);
  SNESType type = nullptr;
  check(SNESGetType(snes_, &type));
  chosen_type_ = type;
  if (chosen_type_ != SNESVINEWTONRSLS && chosen_type_ != SNESVINEWTONSSLS)
    throw InputError("-snes_type " + chosen_type_ + " does not solve box VIs; use vinewtonrsls or vinewtonssls");
}

// Defaults first, the options database last.
void StepSolver::configure(SNES snes) {
  check(SNESSetFunction(snes, snes_f_.get(), form_function, this));
  check(SNESSetJacobian(snes, jacobian_.get(), jacobian_.get(), form_jacobian, this));
  check(SNESSetConvergenceTest(snes, converged, this, nullptr));
  check(SNESSetTolerances(snes, 0.0, 0.0, 0.0, 100, PETSC_MAX_INT));
  check(SNESVISetVariableBounds(snes, lower_.get(), upper_.get()));
  KSP ksp = nullptr;
  PC pc = nullptr;
  check(SNESGetKSP(snes, &ksp));
  check(KSPSetType(ksp, KSPPREONLY));
  check(KSPGetPC(ksp, &pc));
  check(PCSetType(pc, PCLU));
  check(PCFactorSetMatSolverType(pc, MATSOLVERMUMPS));
  // An absolute zone around the bounds would pin honest small outputs (h^3 after lift-off): none, unless asked for by
  // -snes_vi_zero_tolerance. PETSc has no setter for it.
  snes->vizerotolerance = 0.0;
  check(SNESSetFromOptions(snes));
}

// The SNESVI type that was not chosen, made when it is first needed. A SNES of its own: a change of type would leave
// the line search and the factorization of the other one behind.
SNES StepSolver::other_snes() {
  if (!other_) {
    check(SNESCreate(problem_.comm(), other_.put()));
    configure(other_.get());
    check(SNESSetType(other_.get(), chosen_type_ == SNESVINEWTONRSLS ? SNESVINEWTONSSLS : SNESVINEWTONRSLS));
    check(SNESVISetVariableBounds(other_.get(), lower_.get(), upper_.get()));
  }
  return other_.get();
}

PetscErrorCode StepSolver::form_function(SNES, Vec u, Vec f, void* context) {
  auto& self = *static_cast<StepSolver*>(context);
  return guarded(self.parked_, [&] { self.problem_.residual(u, f); });
}

PetscErrorCode StepSolver::form_jacobian(SNES, Vec u, Mat, Mat jacobian, void* context) {
  auto& self = *static_cast<StepSolver*>(context);
  return guarded(self.parked_, [&] { self.problem_.jacobian(u, jacobian); });
}

// Our own test: the certificate of the settled point, and whether it still improves.
PetscErrorCode StepSolver::converged(SNES snes, PetscInt iteration, PetscReal, PetscReal, PetscReal,
                                     SNESConvergedReason* reason, void* context) {
  auto& self = *static_cast<StepSolver*>(context);
  return guarded(self.parked_, [&] {
    Vec u = nullptr;
    check(SNESGetSolution(snes, &u));
    check(VecCopy(u, self.settled_.get()));
    self.problem_.settle(self.settled_.get());
    const double ratio = self.worst_ratio(self.settled_.get());
    const bool improves = iteration == 0 || ratio < 0.25 * self.previous_ratio_;
    self.previous_ratio_ = ratio;
    if (!std::isfinite(ratio)) {
      *reason = SNES_DIVERGED_FNORM_NAN;
    } else if (ratio <= self.certificate_.target || (ratio <= self.certificate_.rtol && !improves)) {
      *reason = SNES_CONVERGED_FNORM_RELATIVE;
    } else {
      *reason = SNES_CONVERGED_ITERATING;
    }
  });
}

double StepSolver::worst_ratio(Vec u) {
  problem_.residual(u, f_.get());
  problem_.row_terms(u, terms_.get());
  double worst = 0.0;
  {
    const ReadArray x(u);
    const ReadArray f(f_.get());
    const ReadArray l(lower_.get());
    const ReadArray b(upper_.get());
    const ReadArray terms(terms_.get());
    for (PetscInt i = 0; i < x.size(); ++i) {
      const double natural = std::abs(x[i] - mid(l[i], b[i], x[i] - f[i]));
      if (natural == 0.0) continue;
      const double ratio = natural / terms[i];  // terms = 0: infinite, as it should be
      if (!(ratio <= worst)) worst = ratio;     // keeps NaN
      if (std::isnan(ratio)) worst = std::numeric_limits<double>::infinity();
    }
  }
  MPI_Allreduce(MPI_IN_PLACE, &worst, 1, MPI_DOUBLE, MPI_MAX, problem_.comm());
  return worst;
}

PetscInt StepSolver::attempt(bool other_type, bool cold, std::string& reason) {
  SNES snes = other_type ? other_snes() : snes_;
  if (cold) {
    check(VecSet(u_.get(), 0.0));
  } else {
    check(VecCopy(guess_.get(), u_.get()));
  }
  const PetscErrorCode code = SNESSolve(snes, nullptr, u_.get());
  check(code, parked_);
  PetscInt iterations = 0;
  check(SNESGetIterationNumber(snes, &iterations));
  const char* text = nullptr;
  check(SNESGetConvergedReasonString(snes, &text));
  reason = text;
  return iterations;
}

StepReport StepSolver::solve(const Step& step) {
  problem_.begin(step, lower_.get(), upper_.get(), guess_.get());
  StepReport best;
  best.residual = std::numeric_limits<double>::infinity();
  PetscInt iterations = 0;
  Vector best_point;
  for (int rung = 0; rung < static_cast<int>(rung_names.size()); ++rung) {
    StepReport report;
    report.rung = rung;
    iterations += attempt(rung % 2 == 1, rung >= 2, report.reason);
    problem_.settle(u_.get());
    report.residual = worst_ratio(u_.get());
    report.certified = report.residual <= certificate_.rtol;
    if (report.certified) {
      report.iterations = iterations;
      ++rungs_[static_cast<std::size_t>(rung)];
      return report;
    }
    if (report.residual < best.residual || rung == 0) {
      best = report;
      if (!best_point) best_point = duplicate(u_.get());
      check(VecCopy(u_.get(), best_point.get()));
    }
  }
  best.iterations = iterations;
  check(VecCopy(best_point.get(), u_.get()));
  problem_.residual(u_.get(), f_.get());
  return best;
}

}  // namespace sweepvi
