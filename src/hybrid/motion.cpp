#include "hybrid/motion.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "dvi/level_state.hpp"
#include "petsc/agreement.hpp"
#include "petsc/sparse.hpp"

namespace sweepvi {

namespace {

constexpr int patient = 100;           // jumps at one instant before small ones are no more jumps
constexpr int most_jumps = 100000;     // at one instant
constexpr int crowd = 100000;          // of series
constexpr double progress = 1e-15;     // over the longest time, that so many make at least
constexpr double small_part = 0.01;    // of the tolerance: what is left of a flight
constexpr double smaller_part = 1e-3;  // what is left out of all series
constexpr double noise = 1e-15;        // a flight below it is rounding
constexpr double growth = 4.0;         // of the length that is tried, from series to series
constexpr double epsilon = 1.1102230246251565e-16;

// +1 or -1, without pattern, the same whatever the ranks.
double coin(std::uint64_t number, std::uint64_t time) {
  std::uint64_t bits = number * 0x9E3779B97F4A7C15ull + time * 0xD1B54A32D192ED03ull + 0x94D049BB133111EBull;
  bits ^= bits >> 30;
  bits *= 0xBF58476D1CE4E5B9ull;
  bits ^= bits >> 27;
  bits *= 0x94D049BB133111EBull;
  return ((bits ^ (bits >> 31)) & 1u) != 0 ? 1.0 : -1.0;
}

}  // namespace

Motion::Motion(HybridProcess& process, double tolerance, int terms, double perturbed, double longest)
    : process_(process),
      flow_(process.system(), process.degree(), process.offset(), process.equations(), terms),
      closing_(std::max(small_part * tolerance, noise)),
      rate_(smaller_part * tolerance / longest),
      perturbed_(perturbed),
      longest_(longest),
      x_(duplicate(process.system().x0.get())),
      row_(duplicate(process.system().x0.get())),
      tried_(longest) {
  const std::size_t count = flow_.constraints();
  const auto outputs = static_cast<std::size_t>(process.degree().first_level.back());
  contact_.assign(count, Side::none);
  mu_.assign(count, 0.0);
  end_w_.assign(count, 0.0);
  flight_.assign(count, PETSC_INFINITY);
  sizes_.assign(outputs, 0.0);
  known_.assign(outputs, 0);
}

void Motion::start(double t) {
  clock_ = {t, 0.0};
  std::vector<double> z(known_.size());
  process_.read(t, x_.get(), z);
  contact_ = process_.in_contact();
  perturb();
}

// What holds exactly after the series: contacts, and who meets its wall.
void Motion::find_known() {
  known_ = event_ ? flow_.meeting() : std::vector<char>(known_.size(), 0);
  for (std::size_t a = 0; a < constraints(); ++a)
    for (int i = 1; i <= flow_.levels(a) && contact_[a] != Side::none && series_ > 0; ++i)
      known_[flow_.at(a, i)] = 1;
}

bool Motion::prepare(StepSolver& solver, PetscInt interval, const Watch* watch, HybridCounts& counts) {
  if (resumed_) {
    flow_.begin_again(clock_.high, x_.get());
    resumed_ = false;
    begin_series();
    return failure_.empty();
  }
  if (++crowd_ >= crowd) {
    crowd_ = 0;
    if (!(std::abs(clock_.until(crowded_at_)) > progress * longest_)) {
      failure_ = fmt::format("at t = {:.17g} s events follow each other without end", clock_.high);
      return false;
    }
    crowded_at_ = clock_.high;
  }
  find_known();
  met_.assign(constraints(), 0);
  std::vector<Side> before = contact_;
  bool jumped = false;
  for (int jumps = 0;; ++jumps) {
    bool out = flow_.place(clock_.high, x_.get(), known_);
    if (out && close_flights(counts, jumps >= patient)) out = flow_.place(clock_.high, x_.get(), known_);
    if (!out) break;
    if (jumps == most_jumps) {
      failure_ = fmt::format("at t = {:.17g} s impacts follow each other without end", clock_.high);
      return false;
    }
    for (std::size_t a = 0; a < constraints(); ++a)
      if (flow_.stand()[a] == Stand::out && before[a] == Side::none) before[a] = flow_.wall(a);
    if (!jumped && watch != nullptr && series_ > 0) {  // a run's first row is the state before its first jump
      flow_.pull_in(x_.get());
      write(0.0);
      watch->before();
    }
    jumped = true;
    if (!jump(solver, interval, watch, counts)) return false;
  }
  flow_.pull_in(x_.get());
  if (!flow_.choose(x_.get(), contact_)) {
    failure_ = fmt::format(
        "at t = {:.17g} s it could not be found which constraints stay in contact: 0 <= a + M lambda _|_ "
        "lambda >= 0 was not solved, M the leading Markov matrix (`sweepvi check` describes it)",
        clock_.high);
    return false;
  }
  if (const std::string against = process_.against(clock_.high, flow_.contact()); !against.empty()) {
    failure_ = fmt::format("at t = {:.17g} s {}", clock_.high, against);
    return false;
  }
  std::vector<Side> old = std::exchange(contact_, flow_.contact());
  for (std::size_t a = 0; a < constraints() && series_ == 0; ++a)
    if (flow_.levels(a) == 0) old[a] = before[a] = contact_[a];  // branches at the start are no events
  const bool changed = anywhere(process_.dvi().comm(), old != contact_);
  if ((jumped || changed)) {
    last_event_ = clock_.high;
    if (watch != nullptr) {
      ++counts.events;
      if (!jumped && series_ > 0) {
        contact_ = old;
        write(0.0);
        watch->before();
        contact_ = flow_.contact();
      }
      write(0.0);
      tell_changes(before);
      watch->after();
      process_.tell({});
    }
  }
  for (std::size_t q = 0; q < sizes_.size(); ++q)
    sizes_[q] = std::max(sizes_[q], flow_.begin().terms[q]);
  for (std::size_t a = 0; a < constraints(); ++a)
    if (flow_.stand()[a] == Stand::leaving || flow_.stand()[a] == Stand::touching) flight_[a] = 0.0;
  if (series_ > 0) tried_ = std::min(longest_, growth * held_);
  begin_series();
  if (watch != nullptr) {
    ++counts.expansions;
    counts.coefficients += flow_.terms();
  }
  return failure_.empty();
}

void Motion::begin_series() {
  const std::optional<double> length = flow_.expand(tried_, rate_);
  if (!length) {
    failure_ = fmt::format(
        "at t = {:.17g} s the motion has no Taylor series: numbers overflow, or contacts depend on each "
        "other",
        clock_.high);
    return;
  }
  const std::optional<double> event = flow_.first_event(*length);
  event_ = event.has_value();
  held_ = *length;
  length_ = event.value_or(held_);
  ready_ = true;
  told_ = 0.0;
}

void Motion::finish() {
  flow_.add_measures(told_, length_, mu_);
  measure_flights(length_);
  flow_.traverse(length_, x_.get());
  if (process_.degree().lowest == 0) end_w_ = flow_.w(length_, flow_.outputs(length_, x_.get()));
  clock_.advance(length_);
  told_ = 0.0;
  ready_ = false;
  ++series_;
  perturb();
}

// Rounding, many times over, by other signs.
void Motion::perturb() {
  if (perturbed_ == 0.0) return;
  const WriteArray x(x_.get());
  const std::vector<PetscInt>& numbers = process_.system().state_order;
  for (PetscInt i = 0; i < x.size(); ++i) {
    const auto local = static_cast<std::size_t>(i);
    const double size = series_ > 0 ? flow_.traversed()[local] : std::abs(x[i]);
    const std::uint64_t number = local < numbers.size() ? static_cast<std::uint64_t>(numbers[local]) : local;
    x[i] += coin(number, static_cast<std::uint64_t>(series_)) * perturbed_ * epsilon * size;
  }
}

// Of those that are not at their walls, relative to the sizes of their outputs.
void Motion::measure_flights(double tau) {
  bool any = false;
  for (std::size_t a = 0; a < constraints(); ++a)
    any = any || (contact_[a] == Side::none && flight_[a] < closing_);
  if (!anywhere(process_.dvi().comm(), any)) return;
  flow_.state(tau, row_.get());
  const Outputs end = flow_.outputs(tau, row_.get());
  for (std::size_t a = 0; a < constraints(); ++a) {
    if (contact_[a] != Side::none || !(flight_[a] < closing_) || flow_.levels(a) < 2) continue;
    const auto relative = [&](double value, int level) {
      const double size = sizes_[flow_.at(a, level)];
      flight_[a] = std::max(flight_[a], size > 0.0 ? std::abs(value) / size : PETSC_INFINITY);
    };
    relative(flow_.excursion(a, tau), 1);
    for (int i = 2; i <= flow_.levels(a); ++i) {
      relative(flow_.begin().z[flow_.at(a, i)], i);
      relative(end.z[flow_.at(a, i)], i);
    }
  }
}

// Impacts of constraints that have hardly left their walls are none. @param all  small ones, too, of any
// flight
bool Motion::close_flights(HybridCounts& counts, bool all) {
  bool closed = false;
  for (std::size_t a = 0; a < constraints(); ++a) {
    if (flow_.stand()[a] != Stand::out || flow_.levels(a) < 2) continue;
    const double z1 = flow_.begin().z[flow_.at(a, 1)];
    bool small = flight_[a] < closing_ || all;
    if (z1 != 0.0 && z1 != flow_.upper(a)) small = false;
    for (int i = 2; i <= flow_.levels(a) && small; ++i)
      small = std::abs(flow_.begin().z[flow_.at(a, i)]) <= closing_ * sizes_[flow_.at(a, i)] || i > 2;
    if (!small) continue;
    for (int i = 1; i <= flow_.levels(a); ++i)
      known_[flow_.at(a, i)] = 1;
    closed = true;
    ++counts.closed;
  }
  return anywhere(process_.dvi().comm(), closed);
}

// Who is beyond a wall goes onto it. @return false if that was not found
bool Motion::push_out(std::vector<double>& pushes) {
  if (flow_.push_out(clock_.high, x_.get(), pushes)) return true;
  failure_ = fmt::format("at t = {:.17g} s positions could not be put back to their walls", clock_.high);
  return false;
}

bool Motion::jump(StepSolver& solver, PetscInt interval, const Watch* watch, HybridCounts& counts) {
  if (process_.degree().lowest == 0) return jump_at_once(watch, counts);
  if (watch == nullptr) aside_.take(process_.dvi());
  flow_.pull_in(x_.get());
  bool beyond = false;
  for (std::size_t a = 0; a < constraints() && process_.keeps_positions(); ++a)
    beyond = beyond || flow_.begin().z[flow_.at(a, 1)] < 0.0;
  if (anywhere(process_.dvi().comm(), beyond)) {
    std::vector<double> pushes;
    if (!push_out(pushes)) return false;
    flow_.place(clock_.high, x_.get(), known_);
  }
  write(0.0);
  report_ = process_.reset(solver, {interval, clock_.high, clock_.high, 0.0}, met_);
  if (report_.certified) {
    std::vector<double> z(known_.size());
    process_.read(clock_.high, x_.get(), z);
    for (std::size_t a = 0; a < constraints(); ++a)
      for (int i = 1; i <= flow_.levels(a); ++i) {
        const double output = z[flow_.at(a, i)];
        known_[flow_.at(a, i)] = output == 0.0 || (i == 1 && output == flow_.upper(a)) ? 1 : 0;
      }
    if (watch != nullptr) {
      ++counts.resets;
      watch->jumped();
    }
  } else {
    failure_ = fmt::format("the jump at t = {:.17g} s could not be certified", clock_.high);
  }
  if (watch == nullptr) aside_.put_back(process_.dvi());
  return report_.certified;
}

// With degrees 0 and 1 the state jumps only from where it began.
bool Motion::jump_at_once(const Watch* watch, HybridCounts& counts) {
  std::vector<double> pushes;
  if (!push_out(pushes)) return false;
  flow_.place(clock_.high, x_.get(), known_);
  if (watch == nullptr) return true;
  std::vector<StepEvent> impacts;
  for (std::size_t a = 0; a < constraints(); ++a) {
    mu_[a] += pushes[a];
    if (pushes[a] == 0.0) continue;
    impacts.push_back({static_cast<PetscInt>(a), flow_.wall(a), 1, true, pushes[a]});
    met_[a] = 1;
  }
  ++counts.resets;
  write(0.0);
  process_.tell(std::move(impacts));
  watch->jumped();
  return true;
}

// Contacts that have begun without a jump, or ended.
void Motion::tell_changes(const std::vector<Side>& before) {
  std::vector<StepEvent> changes;
  for (std::size_t a = 0; a < constraints(); ++a) {
    const auto number = static_cast<PetscInt>(a);
    if (before[a] == contact_[a]) continue;
    if (before[a] != Side::none)
      changes.push_back({number, before[a], std::max(1, flow_.levels(a)), false, 0.0});
    if (contact_[a] != Side::none && met_[a] == 0) changes.push_back({number, contact_[a], 1, true, 0.0});
  }
  process_.tell(std::move(changes));
}

void Motion::write(double tau) {
  if (!ready_) {
    std::vector<double> w = end_w_;
    for (std::size_t a = 0; a < constraints(); ++a)
      if (flow_.levels(a) > 0) w[a] = flow_.begin().z[flow_.at(a, 1)];
    process_.write(x_.get(), flow_.begin().z, w, contact_, mu_);
    return;
  }
  flow_.add_measures(told_, tau, mu_);
  told_ = tau;
  flow_.state(tau, row_.get());
  flow_.hold(tau, row_.get());
  const Outputs now = flow_.outputs(tau, row_.get());
  process_.write(row_.get(), now.z, flow_.w(tau, now), contact_, mu_);
}

void Motion::forget_measures() {
  std::fill(mu_.begin(), mu_.end(), 0.0);
}

void Motion::visit(StateVisitor& visitor, const std::string& prefix) {
  const SmoothFlow::Show states = [&](const char* name, std::vector<double>& numbers) {
    process_.show_states(visitor, (prefix + name).c_str(), numbers);
  };
  const SmoothFlow::Show constraints_of = [&](const char* name, std::vector<double>& numbers) {
    process_.show_constraints(visitor, (prefix + name).c_str(), numbers);
  };
  {
    const WriteArray x(x_.get());
    std::vector<double> numbers(x.data(), x.data() + x.size());
    states("x", numbers);
    std::copy(numbers.begin(), numbers.end(), x.data());
  }
  flow_.visit(states, constraints_of);
  constraints_of("flights", flight_);
  constraints_of("measures", mu_);
  // Outputs of a constraint one after the other, as many as the highest degree.
  for (int i = 1; i <= process_.degree().highest; ++i) {
    std::vector<double> sizes(constraints(), 0.0);
    for (std::size_t a = 0; a < constraints(); ++a)
      if (i <= flow_.levels(a)) sizes[a] = sizes_[flow_.at(a, i)];
    constraints_of(fmt::format("sizes {}", i).c_str(), sizes);
    for (std::size_t a = 0; a < constraints(); ++a)
      if (i <= flow_.levels(a)) sizes_[flow_.at(a, i)] = sizes[a];
  }
  // The same numbers on every rank: rank 0's are kept.
  int rank = 0;
  MPI_Comm_rank(process_.dvi().comm(), &rank);
  std::vector<double> shared = {clock_.high, clock_.low,  told_,
                                tried_,      last_event_, static_cast<double>(series_)};
  if (rank != 0) std::fill(shared.begin(), shared.end(), 0.0);
  visitor.visit((prefix + "clock").c_str(), Belongs::rank, shared, shared.size());
  MPI_Bcast(shared.data(), static_cast<int>(shared.size()), MPI_DOUBLE, 0, process_.dvi().comm());
  clock_ = {shared[0], shared[1]};
  told_ = shared[2];
  tried_ = shared[3];
  last_event_ = shared[4];
  series_ = static_cast<std::int64_t>(shared[5]);
  if (!visitor.replaces()) return;
  contact_ = flow_.contact();
  resumed_ = true;
  ready_ = false;
}

}  // namespace sweepvi
