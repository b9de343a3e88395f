#include "sweepvi/time_march.hpp"

#include <petsc/private/tsimpl.h>

#include <algorithm>
#include <optional>

#include "hybrid/hybrid.hpp"
#include "petsc/sparse.hpp"
#include "sweepvi/state_visitor.hpp"

namespace sweepvi {

namespace {
constexpr const char* ts_type_name = "sweepvi";

// The march's clock is start, end and steps. The program's command line turns -ts_dt and its kin into scene
// keys; from elsewhere (PETSC_OPTIONS, a scene) they would silently do nothing, or cut the run short.
void refuse_clock_options() {
  for (const char* name : {"-ts_dt", "-ts_max_time", "-ts_max_steps", "-ts_init_time", "-ts_time_span",
                           "-ts_theta_theta", "-ts_exact_final_time"}) {
    PetscBool given = PETSC_FALSE;
    check(PetscOptionsHasName(nullptr, nullptr, name, &given));
    if (given == PETSC_TRUE)
      throw InputError(std::string("option ") + name +
                       " does not set this clock: use time.start, time.end and time.step of the scene");
  }
}

}  // namespace

struct TimeMarch::Impl {
  Dvi& problem;
  TimeGrid grid;
  TimeStepper ts;
  std::unique_ptr<StepSolver> solver;
  Observer observer;
  Observer part_observer;
  Observer event_observer;
  std::optional<Hybrid> hybrid;
  StateSnapshot before, hybrid_before;
  StepReport last;
  std::exception_ptr parked;

  /// One step, called by TSStep: on success the TS stands at t_{k+1}.
  void take_step() {
    TS raw = ts.get();
    const Step step{raw->steps + 1, grid.time(raw->steps), grid.time(raw->steps + 1), grid.h()};
    if (hybrid)
      last = advance(step);
    else
      last = solver->solve(step);
    if (!hybrid) settle(step);
    if (!last.certified) {
      raw->reason = TS_DIVERGED_NONLINEAR_SOLVE;
      return;
    }
    raw->ptime = step.t_new;
    raw->time_step = step.h;
    if (observer) observer(step, last);
  }

  /// Accepts a solved step, or takes one that could not be solved in parts. A state that no motion leads to
  /// is taken back, and the step has failed.
  void settle(const Step& step) {
    const bool suspect = problem.suspect();
    StateSnapshot old;
    Vector point;
    if (suspect) {
      old.take(problem);
      point = duplicate(solver->solution());
      check(VecCopy(solver->solution(), point.get()));
    }
    if (last.certified)
      problem.accept(solver->solution(), solver->residual());
    else
      last = divide(step, last);
    if (!suspect || !last.certified) return;
    last.obstacle = problem.defect();
    if (last.obstacle.empty()) return;
    last.certified = false;
    old.put_back(problem);
    solver->return_to(step, point.get());
  }

  /// By the hybrid scheme; if it fails, the state is that at the begin of the interval.
  StepReport advance(const Step& interval) {
    const auto call = [&](const Observer& observer_of) {
      return [&](const Step& part) {
        if (observer_of) observer_of(part, last);
      };
    };
    before.take(problem);
    hybrid_before.take(*hybrid);
    StepReport report = hybrid->advance(interval, *solver, call(part_observer), call(event_observer));
    if (report.certified) return report;
    before.put_back(problem);
    hybrid_before.put_back(*hybrid);
    return report;
  }

  /// Takes a step in parts, the fewest that can all be solved. If there are none everything is as before.
  StepReport divide(const Step& step, const StepReport& whole) {
    const PetscInt halvings = solver->options().halvings;
    if (halvings == 0 || !whole.obstacle.empty()) return whole;
    before.take(problem);
    const Vector point = duplicate(solver->solution());
    check(VecCopy(solver->solution(), point.get()));
    StepReport result = whole;
    PetscInt parts = 2;
    for (; parts <= PetscInt{1} << halvings && !result.certified; parts *= 2) {
      if (!problem.set_step(step.h / static_cast<double>(parts))) break;
      // First to see whether it works, then again for those who watch.
      const bool solvable = take_parts(step, parts, {}).certified;
      before.put_back(problem);
      if (!solvable) continue;
      result = take_parts(step, parts, part_observer);
      if (!result.certified)
        throw Error(ExitCode::internal, "a step's parts were solved once, and not again");
    }
    problem.set_step(step.h);
    if (!result.certified) {
      solver->return_to(step, point.get());
      return whole;
    }
    result.iterations += whole.iterations;
    result.attempts += whole.attempts;
    return result;
  }

  /// Up to the first part that fails. The report is of all of them.
  StepReport take_parts(const Step& step, PetscInt parts, const Observer& observe_part) {
    StepReport all;
    const double h = step.h / static_cast<double>(parts);
    for (PetscInt i = 0; i < parts; ++i) {
      const bool is_last = i + 1 == parts;
      const Step part{step.number, step.t_old + static_cast<double>(i) * h,
                      is_last ? step.t_new : step.t_old + static_cast<double>(i + 1) * h, h};
      StepReport report = solver->solve(part, true);
      report.rung = Rung::smaller_step;
      report.predicted = false;
      report.iterations += all.iterations;
      report.attempts += all.attempts;
      report.residual = std::max(report.residual, all.residual);
      report.parts = parts;
      all = report;
      if (!all.certified) return all;
      problem.accept(solver->solution(), solver->residual());
      if (observe_part && !is_last) observe_part(part, all);
    }
    return all;
  }

  // The PETSc side of the type: TS finds us through ts->data.
  static PetscErrorCode ts_step(TS ts) {
    auto* self = static_cast<Impl*>(ts->data);
    return guarded(self->parked, [&] { self->take_step(); });
  }
  static PetscErrorCode ts_no_op(TS) { return static_cast<PetscErrorCode>(0); }
  static PetscErrorCode ts_view(TS ts, PetscViewer viewer) {
    const auto* self = static_cast<Impl*>(ts->data);
    PetscFunctionBeginUser;
    PetscCall(PetscViewerASCIIPrintf(viewer, "  %" PetscInt_FMT " steps of %g s, one box VI each\n",
                                     self->grid.steps, self->grid.h()));
    PetscFunctionReturn(static_cast<PetscErrorCode>(0));  // an enumeration in newer PETSc
  }
  static PetscErrorCode ts_create(TS ts) {
    ts->ops->step = ts_step;
    ts->ops->setup = ts_no_op;
    ts->ops->reset = ts_no_op;
    ts->ops->destroy = ts_no_op;
    ts->ops->view = ts_view;
    ts->default_adapt_type = TSADAPTNONE;
    ts->usessnes = PETSC_TRUE;
    return static_cast<PetscErrorCode>(0);
  }
};

TimeMarch::TimeMarch(Dvi& problem, const TimeGrid& grid, PetscInt done)
    : impl_(new Impl{problem, grid, {}, nullptr, {}, {}, {}, {}, {}, {}, {}, nullptr}) {
  impl_->last.certified = true;                      // nothing has failed yet
  check(TSRegister(ts_type_name, Impl::ts_create));  // idempotent
  check(TSCreate(problem.comm(), impl_->ts.put()));
  TS ts = impl_->ts.get();
  check(TSSetType(ts, ts_type_name));
  ts->data = impl_.get();
  check(TSSetSolution(ts, problem.state()));
  check(TSSetTime(ts, grid.time(done)));
  check(TSSetStepNumber(ts, done));
  check(TSSetTimeStep(ts, grid.h()));
  check(TSSetMaxSteps(ts, grid.steps));
  check(TSSetMaxTime(ts, PETSC_MAX_REAL));
  // The number of steps ends the run, not the clock.
  check(TSSetExactFinalTime(ts, TS_EXACTFINALTIME_STEPOVER));
  check(TSSetErrorIfStepFails(ts, PETSC_FALSE));
  refuse_clock_options();
  check_options(TSSetFromOptions(ts));
  check(TSSetErrorIfStepFails(ts, PETSC_FALSE));  // a step without solution is a result
  TSType type = nullptr;
  check(TSGetType(ts, &type));
  if (std::string(type) != ts_type_name)
    throw InputError(std::string("-ts_type ") + type + " is not ours: the march is the TS type '" +
                     ts_type_name + "'; choose the scheme by time.scheme");
  SNES snes = nullptr;  // after TSSetFromOptions, which would configure it once more
  check(TSGetSNES(ts, &snes));
  impl_->solver = std::make_unique<StepSolver>(snes, problem);
}

TimeMarch::TimeMarch(HybridProcess& process, const HybridOptions& options, const TimeGrid& grid,
                     PetscInt done)
    : TimeMarch(process.dvi(), grid, done) {
  HybridOptions chosen = options;
  chosen.start = grid.start;
  chosen.end = grid.end;
  impl_->hybrid.emplace(process, chosen);
}

TimeMarch::~TimeMarch() {
  if (impl_->ts) impl_->ts.get()->data = nullptr;
}

void TimeMarch::observe(Observer observer) {
  impl_->observer = std::move(observer);
}

void TimeMarch::observe_parts(Observer observer) {
  impl_->part_observer = std::move(observer);
}

void TimeMarch::observe_events(Observer observer) {
  impl_->event_observer = std::move(observer);
}

HybridCounts TimeMarch::hybrid_counts() const {
  return impl_->hybrid ? impl_->hybrid->counts() : HybridCounts{};
}

double TimeMarch::hybrid_error() const {
  return impl_->hybrid ? impl_->hybrid->error() : 0.0;
}

void TimeMarch::visit_hybrid(StateVisitor& visitor) {
  if (impl_->hybrid) impl_->hybrid->visit(visitor);
}

StepReport TimeMarch::step() {
  check(TSStep(impl_->ts.get()), impl_->parked);
  return impl_->last;
}

StepReport TimeMarch::run() {
  check(TSSolve(impl_->ts.get(), nullptr), impl_->parked);
  return impl_->last;
}

void TimeMarch::stop() {
  check(TSSetConvergedReason(impl_->ts.get(), TS_CONVERGED_USER));
}

PetscInt TimeMarch::steps_taken() const {
  PetscInt taken = 0;
  check(TSGetStepNumber(impl_->ts.get(), &taken));
  return taken;
}

const TimeGrid& TimeMarch::grid() const {
  return impl_->grid;
}
double TimeMarch::time() const {
  return impl_->grid.time(steps_taken());
}
StepProblem TimeMarch::problem() {
  return impl_->solver->problem();
}
StepSolver& TimeMarch::solver() const {
  return *impl_->solver;
}

}  // namespace sweepvi
