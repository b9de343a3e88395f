#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "dvi/catching_up.hpp"
#include "dvi/output_box.hpp"
#include "dvi/saddle.hpp"

namespace sweepvi {

namespace {

// PETSc's idea of no bound.
void evaluate(const std::optional<Forcing>& bound, double t, double missing, Vec values) {
  if (!bound) {
    check(VecSet(values, missing));
    return;
  }
  check(VecSet(values, 0.0));
  bound->add_to(values, t, 0, 1.0);
  const WriteArray entries(values);
  for (PetscInt i = 0; i < entries.size(); ++i)
    entries[i] = std::clamp(entries[i], PETSC_NINFINITY, PETSC_INFINITY);
}

std::vector<Signal> by_component(const std::optional<Forcing>& bound, std::size_t count, double missing) {
  std::vector<Signal> signals(count);
  if (!bound) {
    std::fill(signals.begin(), signals.end(), Signal{missing, 0.0, 0.0, 0.0});
    return signals;
  }
  for (const auto* entries : {&bound->constant, &bound->varying})
    for (const Forcing::Entry& entry : *entries)
      signals[static_cast<std::size_t>(entry.local)] = entry.signal;
  return signals;
}

// lower - upper at t, where that is more than the rounding of the two.
double excess(const Signal& lower, const Signal& upper, double t) {
  const double difference = lower.value(t) - upper.value(t);
  const double size =
      std::abs(lower.offset) + std::abs(lower.amplitude) + std::abs(upper.offset) + std::abs(upper.amplitude);
  return difference > rounding * size ? difference : 0.0;
}

// The first grid time at which lower > upper; `steps` + 1 if there is none.
PetscInt first_crossing(const Signal& lower, const Signal& upper, const TimeGrid& grid) {
  if (std::isinf(lower.offset) || std::isinf(upper.offset)) return grid.steps + 1;
  const double never = lower.offset + std::abs(lower.amplitude) + std::abs(upper.amplitude) - upper.offset;
  if (never <= 0.0) return grid.steps + 1;
  const PetscInt last = lower.varies() || upper.varies() ? grid.steps : 0;
  for (PetscInt k = 0; k <= last; ++k)
    if (excess(lower, upper, grid.time(k)) > 0.0) return k;
  return grid.steps + 1;
}

}  // namespace

CatchingUpBox::CatchingUpBox(const SweepingSystem& system, const TimeGrid& grid) : CatchingUp(system, grid) {
  refuse_empty(grid);
  for (Vector* vector : {&u_, &lower_, &upper_, &rhs_, &rhs_terms_, &work_})
    *vector = duplicate(system.u0.get());
  K_ = system.A ? implicit_euler(system.A.get(), h_) : scaled_identity(u_.get(), 1.0);
  abs_K_ = absolute_copy(K_.get());

  check(VecCopy(system.u0.get(), u_.get()));
  find_bounds(grid.start);
  allocate(system.state_order.size());
  start(observe(u_.get()));
}

bool CatchingUpBox::set_step(double h) {
  h_ = h;
  if (!system_.A) return true;
  K_ = implicit_euler(system_.A.get(), h);
  abs_K_ = absolute_copy(K_.get());
  ++version_;
  return true;
}

// Empty boxes are found before anything is computed: the first one in time, then in the scene's order.
void CatchingUpBox::refuse_empty(const TimeGrid& grid) const {
  constexpr double infinity = std::numeric_limits<double>::infinity();
  const std::size_t count = system_.state_order.size();
  const std::vector<Signal> lower = by_component(system_.lower, count, -infinity);
  const std::vector<Signal> upper = by_component(system_.upper, count, infinity);
  PetscInt first = grid.steps + 1;
  PetscInt component = std::numeric_limits<PetscInt>::max();
  std::size_t local = count;
  for (std::size_t i = 0; i < count; ++i) {
    const PetscInt k = first_crossing(lower[i], upper[i], grid);
    if (k > grid.steps || k > first || (k == first && system_.state_order[i] > component)) continue;
    first = k;
    component = system_.state_order[i];
    local = i;
  }
  PetscInt earliest = first;
  MPI_Allreduce(MPI_IN_PLACE, &earliest, 1, MPIU_INT, MPI_MIN, comm());
  if (earliest > grid.steps) return;
  PetscInt chosen = first == earliest ? component : std::numeric_limits<PetscInt>::max();
  MPI_Allreduce(MPI_IN_PLACE, &chosen, 1, MPIU_INT, MPI_MIN, comm());
  agreed(comm(), [&] {
    if (first != earliest || component != chosen) return;
    const double t = grid.time(earliest);
    throw InputError(fmt::format(
        "K(t) is empty at t = {:.9g} s: component {} has the lower bound {:.9g} above the upper bound {:.9g}",
        t, component, lower[local].value(t), upper[local].value(t)));
  });
}

void CatchingUpBox::find_bounds(double t) {
  evaluate(system_.lower, t, PETSC_NINFINITY, lower_.get());
  evaluate(system_.upper, t, PETSC_INFINITY, upper_.get());
  const ReadArray lower(lower_.get());
  const WriteArray upper(upper_.get());
  for (PetscInt i = 0; i < lower.size(); ++i)
    upper[i] = std::max(upper[i], lower[i]);  // equal but for rounding
}

Matrix CatchingUpBox::create_jacobian() const {
  Matrix jacobian;
  check(MatDuplicate(K_.get(), MAT_COPY_VALUES, jacobian.put()));
  return jacobian;
}

void CatchingUpBox::begin(const Step& step, Vec lower, Vec upper, Vec guess) {
  find_bounds(step.t_new);
  check(VecCopy(lower_.get(), lower));
  check(VecCopy(upper_.get(), upper));
  check(VecSet(work_.get(), 0.0));
  system_.f.add_to(work_.get(), step.t_new, 0, step.h);
  check(VecWAXPY(rhs_.get(), 1.0, u_.get(), work_.get()));
  check(VecCopy(u_.get(), guess));
  const ReadArray u(u_.get());
  const ReadArray push(work_.get());
  const WriteArray terms(rhs_terms_.get());
  for (PetscInt i = 0; i < u.size(); ++i)
    terms[i] = std::abs(u[i]) + std::abs(push[i]);
}

// Without A the projection is done component by component.
bool CatchingUpBox::predict(Vec guess) {
  if (system_.A) return false;
  const ReadArray free(rhs_.get());
  const ReadArray lower(lower_.get());
  const ReadArray upper(upper_.get());
  const WriteArray u(guess);
  for (PetscInt i = 0; i < u.size(); ++i)
    u[i] = std::clamp(free[i], lower[i], upper[i]);
  return true;
}

void CatchingUpBox::residual(Vec u, Vec f) {
  check(MatMult(K_.get(), u, f));
  check(VecAXPY(f, -1.0, rhs_.get()));
}

void CatchingUpBox::row_terms(Vec u, Vec terms) {
  check(VecCopy(u, work_.get()));
  check(VecAbs(work_.get()));
  check(MatMultAdd(abs_K_.get(), work_.get(), rhs_terms_.get(), terms));
}

void CatchingUpBox::jacobian(Vec, Mat jacobian) {
  check(MatCopy(K_.get(), jacobian, SAME_NONZERO_PATTERN));
}

void CatchingUpBox::settle(Vec u) {
  Vector terms = duplicate(u);
  row_terms(u, terms.get());
  const ReadArray scale(terms.get());
  const ReadArray lower(lower_.get());
  const ReadArray upper(upper_.get());
  const WriteArray values(u);
  for (PetscInt i = 0; i < values.size(); ++i) {
    const double slack = system_.A ? held_rtol * scale[i] : 0.0;  // without A, u is known to the last digit
    if (values[i] <= lower[i] + slack)
      values[i] = lower[i];
    else if (values[i] >= upper[i] - slack)
      values[i] = upper[i];
  }
}

// The wall of each component at u, and the distances to it.
std::vector<Side> CatchingUpBox::observe(Vec u) {
  const ReadArray values(u);
  const ReadArray lower(lower_.get());
  const ReadArray upper(upper_.get());
  std::vector<Side> sides(w_.size(), Side::none);
  for (std::size_t a = 0; a < w_.size(); ++a) {
    const auto i = static_cast<PetscInt>(a);
    const double below =
        lower[i] > PETSC_NINFINITY ? values[i] - lower[i] : std::numeric_limits<double>::infinity();
    const double above =
        upper[i] < PETSC_INFINITY ? upper[i] - values[i] : std::numeric_limits<double>::infinity();
    w_[a] = std::min(below, above);
    if (w_[a] <= 0.0) sides[a] = below <= above ? Side::lower : Side::upper;
  }
  return sides;
}

void CatchingUpBox::accept(Vec u, Vec f) {
  check(VecCopy(u, u_.get()));
  std::vector<Side> sides = observe(u);
  const ReadArray residual(f);
  const ReadArray lower(lower_.get());
  const ReadArray upper(upper_.get());
  for (std::size_t a = 0; a < w_.size(); ++a) {
    const auto i = static_cast<PetscInt>(a);
    if (sides[a] != Side::none && lower[i] == upper[i])
      sides[a] = residual[i] < 0.0 ? Side::upper : Side::lower;
    mu_[a] = sides[a] == Side::lower   ? std::max(0.0, residual[i])
             : sides[a] == Side::upper ? std::min(0.0, residual[i])
                                       : 0.0;
  }
  advance(sides);
}

}  // namespace sweepvi
