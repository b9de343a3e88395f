#include "hybrid/hybrid.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "dvi/level_state.hpp"
#include "petsc/sparse.hpp"

namespace sweepvi {

namespace {

constexpr int most_jumps = 50;           // at one instant
constexpr std::size_t accumulation = 3;  // gaps between impacts that shrink
constexpr int quiet_steps = 10;          // without any change of contact
constexpr int coarse_steps = 16;         // of what is left of an interval, where no better step is known
constexpr double fine_steps = 2e4;       // at most

bool any_rank(MPI_Comm comm, bool here) {
  int found = here ? 1 : 0;
  MPI_Allreduce(MPI_IN_PLACE, &found, 1, MPI_INT, MPI_LOR, comm);
  return found != 0;
}

}  // namespace

StepReport HybridProcess::reset(StepSolver& solver, const Step& step) {
  StepReport report = solver.solve(step);
  if (report.certified) dvi().accept(solver.solution(), solver.residual());
  return report;
}

Hybrid::Hybrid(HybridProcess& process, const HybridOptions& options, double h)
    : process_(process), options_(options), h_(h), x_(duplicate(process.system().x0.get())) {
  const RelativeDegree& degree = process.degree();
  if (degree.lowest > 0) flow_.emplace(process.system(), degree, process.offset());
  upper_.assign(degree.degree.size(), PETSC_INFINITY);
  if (process.system().wmax) {
    const ReadArray walls(process.system().wmax.get());
    std::copy_n(walls.data(), walls.size(), upper_.begin());
  }
  z_.resize(static_cast<std::size_t>(degree.first_level.back()));
}

StepReport Hybrid::advance(const Step& interval, StepSolver& solver, const Observer& part,
                           const Observer& event) {
  solver_ = &solver;
  part_ = &part;
  event_ = &event;
  report_ = {};
  report_.certified = true;
  report_.rung = Rung::hybrid;
  t_ = interval.t_old;
  process_.read(t_, x_.get(), z_);
  mu_.assign(constraints(), 0.0);
  contact_ = flow_ ? process_.in_contact() : std::vector<Side>(constraints(), Side::none);
  continues_ = continues_ && t_ == reached_;
  impacts_.assign(constraints(), {});
  events_ = 0;
  unseen_ = 0;
  while (t_ < interval.t_new && report_.certified)
    if ((!flow_ || !move(interval)) && report_.certified && t_ < interval.t_new)
      time_step(interval, 0.0, false);
  if (report_.certified && flow_) put();
  reached_ = t_;
  return report_;
}

Side Hybrid::wall_at(std::size_t a) const {
  const double z1 = z_[at(a, 1)];
  if (z1 <= 0.0) return Side::lower;
  return z1 >= upper_[a] ? Side::upper : Side::none;
}

// Whether a constraint would be violated right after t.
bool Hybrid::heads_out() const {
  bool out = false;
  for (std::size_t a = 0; a < constraints() && !out; ++a) {
    const Side wall = wall_at(a);
    if (wall == Side::none) continue;
    double first = wall == Side::lower ? z_[at(a, 1)] : upper_[a] - z_[at(a, 1)];
    for (int i = 2; i <= process_.degree().degree[a] && first == 0.0; ++i)
      first = sign(wall) * z_[at(a, i)];
    out = first < 0.0;
  }
  return any_rank(process_.dvi().comm(), out);
}

// From now to the next event, or to the end. False if that cannot be done smoothly.
bool Hybrid::move(const Step& interval) {
  const Step now{interval.number, t_, t_, 0.0};
  const std::vector<Side> before = contact_;
  std::vector<Side> closed(constraints(), Side::none);
  bool jumped = false;
  for (int jumps = 0; heads_out(); ++jumps) {
    if (jumps == most_jumps) return false;
    for (std::size_t a = 0; a < constraints(); ++a)
      if (contact_[a] == Side::none && wall_at(a) != Side::none) closed[a] = wall_at(a);
    if (!jump(now)) return true;
    jumped = true;
  }
  const bool began = flow_->start(t_, x_.get(), z_, continues_ && !jumped);
  continues_ = false;
  if (!began) return false;
  contact_ = flow_->contact();
  if (any_rank(process_.dvi().comm(), !process_.admits(contact_))) return false;
  for (std::size_t a = 0; a < constraints(); ++a)
    if (closed[a] == Side::none) closed[a] = before[a];
  tell_changes(now, closed, jumped);

  const double left = interval.t_new - t_;
  const double rate = 0.1 * options_.tolerance / (options_.end - options_.start);
  const std::optional<double> length = flow_->expand(left, rate);
  ++counts_.expansions;
  counts_.coefficients += flow_->terms();
  if (!length) return false;
  const std::optional<double> event = flow_->first_event(*length);
  flow_->evaluate(event.value_or(*length), event.has_value(), x_.get(), z_, mu_);
  const bool ends = !event && *length == left;
  const double old =
      std::exchange(t_, ends ? interval.t_new : std::min(t_ + event.value_or(*length), interval.t_new));
  if (t_ > old)
    unseen_ = 0;
  else if (!event || ++unseen_ == most_jumps)
    return false;
  else if (end_flights())
    return true;
  continues_ = !event;
  if (!event) return true;

  put();
  (*part_)({interval.number, old, t_, t_ - old});
  process_.tell({});
  std::fill(mu_.begin(), mu_.end(), 0.0);
  put();
  (*event_)({interval.number, t_, t_, 0.0});
  ++counts_.events;
  for (std::size_t a = 0; a < constraints(); ++a)
    if (contact_[a] == Side::none && wall_at(a) != Side::none) impacts_[a].push_back(t_);
  const double gap = accumulating();
  if (gap < PETSC_INFINITY) time_step(interval, 0.1 * gap, true);
  return ++events_ < options_.crowd;
}

// Flights that end before the clock moves are none: constraints that leave their walls and meet them have not
// left them. False if there is no such constraint.
bool Hybrid::end_flights() {
  std::vector<Side> contact = contact_;
  bool any = false;
  for (std::size_t a = 0; a < constraints(); ++a) {
    if (contact[a] != Side::none || wall_at(a) == Side::none || !flow_->leaves(a)) continue;
    contact[a] = wall_at(a);
    any = true;
  }
  any = any_rank(process_.dvi().comm(), any);
  if (any) rest(contact);
  return any;
}

// To the interval's report; of a step that failed it is that step's alone.
bool Hybrid::add(const StepReport& report) {
  report_.iterations += report.iterations;
  report_.attempts += report.attempts;
  report_.residual = std::max(report_.residual, report.residual);
  if (!report.certified) report_ = report;
  return report.certified;
}

// One step of length 0.
bool Hybrid::jump(const Step& now) {
  if (std::exchange(h_, 0.0) != 0.0) process_.dvi().set_step(0.0);
  const StepReport report = process_.reset(*solver_, now);
  if (!add(report)) return false;
  ++counts_.resets;
  (*part_)(now);
  process_.read(t_, x_.get(), z_);
  return true;
}

// Contacts that have begun without a jump, or ended; then the state after the event.
void Hybrid::tell_changes(const Step& now, const std::vector<Side>& before, bool jumped) {
  std::vector<StepEvent> changes;
  for (std::size_t a = 0; a < constraints(); ++a) {
    const auto number = static_cast<PetscInt>(a);
    if (before[a] == contact_[a]) continue;
    if (before[a] != Side::none)
      changes.push_back({number, before[a], process_.degree().degree[a], false, 0.0});
    if (contact_[a] != Side::none) changes.push_back({number, contact_[a], 1, true, 0.0});
  }
  if (!any_rank(process_.dvi().comm(), jumped || !changes.empty())) return;
  put();
  process_.tell(std::move(changes));
  (*part_)(now);
  (*event_)(now);
  process_.tell({});
}

// The last gap between impacts of a constraint whose impacts accumulate, and that moves less than the
// tolerance between them; infinite if there is none. The same on every rank.
double Hybrid::accumulating() const {
  double least = PETSC_INFINITY;
  const double seen = 8.0 * options_.tolerance * flow_->size();
  for (const std::vector<double>& times : impacts_) {
    if (times.size() <= accumulation) continue;
    bool shrinks = true;
    for (std::size_t k = times.size() - accumulation; k + 1 < times.size(); ++k)
      shrinks = shrinks && times[k + 1] - times[k] < times[k] - times[k - 1];
    const double gap = times.back() - times[times.size() - 2];
    if (shrinks && gap * gap * flow_->curvature() <= seen) least = std::min(least, gap);
  }
  MPI_Allreduce(MPI_IN_PLACE, &least, 1, MPI_DOUBLE, MPI_MIN, process_.dvi().comm());
  return least;
}

void Hybrid::put() {
  process_.write(x_.get(), z_, contact_, mu_);
}

// Steps of the Dvi's own scheme up to the end of the interval, or until all contacts are at rest.
bool Hybrid::time_step(const Step& interval, double h, bool until_rest) {
  if (flow_) put();
  const double left = interval.t_new - t_, begin = t_;
  const double least = left / (h > 0.0 ? fine_steps : coarse_steps);
  const auto steps = static_cast<std::int64_t>(std::ceil(left / std::max(h, least)));
  h_ = left / static_cast<double>(steps);
  process_.dvi().set_step(h_);
  std::vector<Side> last;
  int quiet = 0;
  for (std::int64_t k = 0; k < steps; ++k) {
    const double t_new = k + 1 == steps ? interval.t_new : begin + static_cast<double>(k + 1) * h_;
    if (!take({interval.number, t_, t_new, h_}, k + 1 == steps)) return false;
    if (!until_rest) continue;
    const std::vector<Side> contact = process_.in_contact();
    quiet = any_rank(process_.dvi().comm(), contact != last) ? 0 : quiet + 1;
    last = contact;
    if (quiet < quiet_steps) continue;
    // What still moves in contact would take it no farther than the tolerance in as many steps again.
    double fastest = 0.0, size = 0.0;
    for (std::size_t a = 0; a < constraints(); ++a)
      for (int i = 2; i <= process_.degree().degree[a] && contact[a] != Side::none; ++i)
        fastest = std::max(fastest, std::abs(z_[at(a, i)]));
    MPI_Allreduce(MPI_IN_PLACE, &fastest, 1, MPI_DOUBLE, MPI_MAX, process_.dvi().comm());
    check(VecNorm(x_.get(), NORM_INFINITY, &size));
    if (fastest * quiet_steps * h_ > options_.tolerance * size) continue;
    rest(contact);
    break;
  }
  impacts_.assign(constraints(), {});
  if (flow_ && t_ == interval.t_new) contact_ = process_.in_contact();
  return true;
}

bool Hybrid::take(const Step& step, bool last) {
  const StepReport report = solver_->solve(step);
  if (!add(report)) return false;
  process_.dvi().accept(solver_->solution(), solver_->residual());
  // The last step of an interval is told by its caller, unless we write its state.
  if (flow_ || !last) (*part_)(step);
  t_ = step.t_new;
  process_.read(t_, x_.get(), z_);
  ++counts_.steps;
  counts_.stepped += step.h;
  return true;
}

void Hybrid::rest(const std::vector<Side>& contact) {
  for (std::size_t a = 0; a < constraints(); ++a)
    for (int i = 1; i <= process_.degree().degree[a] && contact[a] != Side::none; ++i)
      z_[at(a, i)] = i == 1 && contact[a] == Side::upper ? upper_[a] : 0.0;
  contact_ = contact;
  flow_->put_in_contact(contact, t_, x_.get());
}

}  // namespace sweepvi
