#include "hybrid/hybrid.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "petsc/sparse.hpp"

namespace sweepvi {

namespace {

constexpr int terms = 28, more_terms = 34;             // of series: the shadow's are of another order
constexpr double finer = 1e-3;                         // times the tolerance: that of the shadow
constexpr double roundings = 20.0;                     // by which the shadow is moved
constexpr double safety = 4.0;                         // on how far they are apart
constexpr double window = 1e-6, widest_window = 1e-2;  // around events, of a series
constexpr double rounding_unit = 1.2e-16;

}  // namespace

std::string HybridProcess::against(double /*t*/, const std::vector<Side>& /*contact*/) {
  return {};
}

void HybridProcess::show_states(StateVisitor& visitor, const char* name, std::vector<double>& numbers) {
  visitor.visit(name, Belongs::state, numbers);
}

void HybridProcess::show_constraints(StateVisitor& visitor, const char* name, std::vector<double>& numbers) {
  visitor.visit(name, Belongs::constraint, numbers);
}

Hybrid::Hybrid(HybridProcess& process, const HybridOptions& options)
    : process_(process),
      motion_(process, options.tolerance, terms, 0.0, options.end - options.start),
      shadow_(process, finer * options.tolerance, more_terms, roundings, options.end - options.start),
      here_(duplicate(process.system().x0.get())),
      there_(duplicate(process.system().x0.get())) {
  PetscInt local = 0;
  check(VecGetLocalSize(here_.get(), &local));
  size_.assign(static_cast<std::size_t>(local), 0.0);
}

StepReport Hybrid::failed(const Motion& motion) const {
  StepReport report = motion.report();
  report.certified = false;
  report.obstacle = motion.failure();
  if (!motion.report().certified && !motion.report().reason.empty()) report.obstacle.clear();
  return report;
}

StepReport Hybrid::advance(const Step& interval, StepSolver& solver, const Observer& part,
                           const Observer& event) {
  solver_ = &solver;
  report_ = {};
  report_.certified = true;
  report_.rung = Rung::hybrid;
  if (!begun_) {
    if (process_.degree().lowest > 0) process_.dvi().set_step(0.0);
    motion_.start(interval.t_old);
    shadow_.start(interval.t_old);
    begun_ = true;
    reached_ = interval.t_old;
  }
  const auto told = [&] {
    const double t = motion_.time();
    part({interval.number, reached_, t, t - reached_});
    motion_.forget_measures();
    process_.tell({});
    reached_ = t;
  };
  const Motion::Watch watch{[&] {
                              told();
                              motion_.write(0.0);
                              event({interval.number, motion_.time(), motion_.time(), 0.0});
                            },
                            [&] {
                              report_.iterations += motion_.report().iterations;
                              report_.attempts += motion_.report().attempts;
                              report_.residual = std::max(report_.residual, motion_.report().residual);
                              told();
                            },
                            [&] {
                              told();
                              event({interval.number, motion_.time(), motion_.time(), 0.0});
                            }};
  while (true) {
    if (!motion_.ready() && !motion_.prepare(solver, interval.number, &watch, counts_))
      return failed(motion_);
    if (motion_.place_of(interval.t_new) < motion_.length()) break;
    judge(motion_.time() + 0.5 * motion_.length(), interval.number);
    motion_.finish();
  }
  judge(interval.t_new, interval.number);
  motion_.write(std::max(0.0, motion_.place_of(interval.t_new)));
  motion_.forget_measures();
  process_.tell({});
  reached_ = interval.t_new;
  return report_;
}

bool Hybrid::near_event(const Motion& motion, double t, double window_length) {
  return t - motion.last_event() <= window_length ||
         (motion.ends_in_event() && motion.length() - motion.place_of(t) <= window_length);
}

// The shadow follows to t, unless it is lost.
void Hybrid::judge(double t, PetscInt interval) {
  if (lost_) return;
  HybridCounts ignored;
  while (true) {
    if (!shadow_.ready() && !shadow_.prepare(*solver_, interval, nullptr, ignored)) {
      lost_ = true;
      counts_.relative_error = std::max(counts_.relative_error, 1.0);
      counts_.error = PETSC_INFINITY;
      return;
    }
    if (shadow_.place_of(t) < shadow_.length()) break;
    shadow_.finish();
  }
  if (shadow_.place_of(t) < 0.0) return;  // it has been asked for a later row
  const double near = std::clamp(10.0 * counts_.relative_error, window, widest_window) *
                      std::min(motion_.length(), shadow_.length());
  if (near_event(motion_, t, near) || near_event(shadow_, t, near)) return;
  const auto series = static_cast<double>(motion_.series());
  const double kept = series > judged_ ? 0.5 : 1.0;
  judged_ = series;
  const Distance distance = apart(t);
  counts_.error = std::max(safety * distance.largest, kept * counts_.error);
  counts_.relative_error = std::max(safety * distance.relative, kept * counts_.relative_error);
}

// The largest distance of a component, and relative to its size: that of what it is a sum of. At least a
// rounding.
Hybrid::Distance Hybrid::apart(double t) {
  const double place = std::max(0.0, motion_.place_of(t));
  motion_.flow().state(place, here_.get());
  shadow_.flow().state(shadow_.place_of(t), there_.get());
  std::array<double, 2> worst{0.0, rounding_unit};
  {
    const ReadArray here(here_.get());
    const ReadArray there(there_.get());
    const ReadArray summed(motion_.flow().summed());
    const std::vector<double>& traversed = motion_.flow().traversed();
    for (std::size_t i = 0; i < size_.size(); ++i) {
      const auto k = static_cast<PetscInt>(i);
      size_[i] = std::max({size_[i], std::abs(here[k]), traversed[i], place * summed[k]});
      const double distance = std::abs(here[k] - there[k]);
      worst[0] = std::max({worst[0], distance, rounding_unit * std::abs(here[k])});
      if (distance > 0.0) worst[1] = std::max(worst[1], distance / std::max(size_[i], std::abs(there[k])));
      if (std::isnan(distance)) worst = {PETSC_INFINITY, PETSC_INFINITY};
    }
  }
  MPI_Allreduce(MPI_IN_PLACE, worst.data(), 2, MPI_DOUBLE, MPI_MAX, process_.dvi().comm());
  return {worst[0], worst[1]};
}

void Hybrid::visit(StateVisitor& visitor) {
  motion_.visit(visitor, "hybrid ");
  shadow_.visit(visitor, "hybrid's shadow ");
  process_.show_states(visitor, "hybrid sizes", size_);
  int rank = 0;
  MPI_Comm_rank(process_.dvi().comm(), &rank);
  std::vector<double> shared = {begun_ ? 1.0 : 0.0,
                                lost_ ? 1.0 : 0.0,
                                counts_.error,
                                counts_.relative_error,
                                judged_,
                                reached_,
                                static_cast<double>(counts_.expansions),
                                static_cast<double>(counts_.coefficients),
                                static_cast<double>(counts_.events),
                                static_cast<double>(counts_.resets),
                                static_cast<double>(counts_.closed)};
  if (rank != 0) std::fill(shared.begin(), shared.end(), 0.0);
  visitor.visit("hybrid counts", Belongs::rank, shared, shared.size());
  MPI_Bcast(shared.data(), static_cast<int>(shared.size()), MPI_DOUBLE, 0, process_.dvi().comm());
  begun_ = shared[0] != 0.0;
  lost_ = shared[1] != 0.0;
  counts_.error = shared[2];
  counts_.relative_error = shared[3];
  judged_ = shared[4];
  reached_ = shared[5];
  counts_.expansions = static_cast<std::int64_t>(shared[6]);
  counts_.coefficients = static_cast<std::int64_t>(shared[7]);
  counts_.events = static_cast<std::int64_t>(shared[8]);
  counts_.resets = static_cast<std::int64_t>(shared[9]);
  counts_.closed = static_cast<std::int64_t>(shared[10]);
  if (visitor.replaces() && begun_ && process_.degree().lowest > 0) process_.dvi().set_step(0.0);
}

}  // namespace sweepvi
