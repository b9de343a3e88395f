#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <string>
#include <utility>

#include "dvi/level_state.hpp"
#include "hybrid/named_numbers.hpp"
#include "petsc/sparse.hpp"
#include "sweepvi/hybrid.hpp"
#include "sweepvi/sweeping.hpp"

namespace sweepvi {

namespace {

/// The rows w_a = s_a (u_i - b_i(t)) >= 0 of a box, or those of a polyhedron: constraints of degree 1 that
/// move. Bounds that are the same are one row, an equation.
struct Rows {
  Matrix C;
  Forcing offset;
  std::vector<PetscInt> component;  // box: local number of u_i
  std::vector<Side> side;           // box: which bound
  std::vector<char> equation;
};

/// Of all components; what is not listed is zero.
std::vector<Signal> signals_of(const Forcing& bound, PetscInt components) {
  std::vector<Signal> signals(static_cast<std::size_t>(components));
  for (const auto* list : {&bound.constant, &bound.varying})
    for (const Forcing::Entry& entry : *list)
      signals[static_cast<std::size_t>(entry.local)] = entry.signal;
  return signals;
}

/// Up to rounding, at all times: of one frequency, the same offset, sine and cosine.
bool same(const Signal& a, const Signal& b) {
  constexpr double rounding = 8.0 * std::numeric_limits<double>::epsilon();
  if (std::isinf(a.offset) || std::isinf(b.offset)) return false;
  const auto equal = [](double p, double q, double size) { return std::abs(p - q) <= rounding * size; };
  const auto constant = [](const Signal& s) { return s.varies() ? s.offset : s.value(0.0); };
  if (!equal(constant(a), constant(b), std::max(a.bound(), b.bound()))) return false;
  if (a.varies() != b.varies()) return false;
  if (!a.varies()) return true;
  const double turn = a.frequency == -b.frequency ? -1.0 : 1.0;  // sin(-x) = -sin(x)
  if (a.frequency != turn * b.frequency) return false;
  const double size = std::max(std::abs(a.amplitude), std::abs(b.amplitude));
  return equal(a.amplitude * std::cos(a.phase), turn * b.amplitude * std::cos(b.phase * turn), size) &&
         equal(a.amplitude * std::sin(a.phase), turn * b.amplitude * std::sin(b.phase * turn), size);
}

void add_bound(const Signal& signal, Side side, bool equation, PetscInt component, Rows& rows) {
  if (std::isinf(signal.offset)) return;
  const auto row = static_cast<PetscInt>(rows.component.size());
  rows.component.push_back(component);
  rows.side.push_back(side);
  rows.equation.push_back(equation ? 1 : 0);
  (signal.varies() ? rows.offset.varying : rows.offset.constant).push_back({row, signal.scaled(-sign(side))});
}

Rows rows_of(const SweepingSystem& system) {
  Rows rows;
  PetscInt components = 0, first = 0;
  check(VecGetLocalSize(system.u0.get(), &components));
  check(VecGetOwnershipRange(system.u0.get(), &first, nullptr));
  if (system.G) {
    rows.C = Matrix::share(system.G.get());
    rows.offset = system.g;
    for (auto* list : {&rows.offset.constant, &rows.offset.varying})
      for (Forcing::Entry& entry : *list)
        entry.signal = entry.signal.scaled(-1.0);
    return rows;
  }
  const Signal none[] = {{.offset = -std::numeric_limits<double>::infinity()},
                         {.offset = std::numeric_limits<double>::infinity()}};
  const auto all = static_cast<std::size_t>(components);
  const auto lower = system.lower ? signals_of(*system.lower, components) : std::vector(all, none[0]);
  const auto upper = system.upper ? signals_of(*system.upper, components) : std::vector(all, none[1]);
  std::vector<char> fixed(all);
  for (std::size_t i = 0; i < all; ++i) {
    fixed[i] = same(lower[i], upper[i]) ? 1 : 0;
    add_bound(lower[i], Side::lower, fixed[i] != 0, static_cast<PetscInt>(i), rows);
  }
  for (std::size_t i = 0; i < all; ++i)
    if (fixed[i] == 0) add_bound(upper[i], Side::upper, false, static_cast<PetscInt>(i), rows);
  RowBuilder builder;
  for (std::size_t a = 0; a < rows.component.size(); ++a) {
    builder.add(first + rows.component[a], sign(rows.side[a]));
    builder.end_row();
  }
  rows.C = builder.finish(system.comm(), components);
  return rows;
}

/// x' = A x + C' lambda + f, w = C x + offset(t).
LinearSystem linear_form(const SweepingSystem& system, const Rows& rows) {
  LinearSystem linear;
  PetscInt components = 0;
  check(VecGetLocalSize(system.u0.get(), &components));
  if (system.A) {
    linear.A = Matrix::share(system.A.get());
  } else {
    RowBuilder nothing;
    for (PetscInt i = 0; i < components; ++i)
      nothing.end_row();
    linear.A = nothing.finish(system.comm(), components);
  }
  linear.B = transpose(rows.C.get());
  linear.C = Matrix::share(rows.C.get());
  linear.f = system.f;
  linear.x0 = Vector::share(system.u0.get());
  linear.w0 = make_vector(system.comm(), row_range(rows.C.get()).size());
  check(VecSet(linear.w0.get(), 0.0));
  linear.state_order = system.state_order;
  linear.constraint_order = system.face_order;
  if (!system.G)
    for (const PetscInt i : rows.component)
      linear.constraint_order.push_back(system.state_order[static_cast<std::size_t>(i)]);
  return linear;
}

/// A point swept along by a moving box or polyhedron, stepped by the catching-up algorithm.
class SweepingProcess final : public HybridProcess {
public:
  SweepingProcess(ConstrainedDvi& dvi, const SweepingSystem& system)
      : dvi_(dvi),
        box_(system.is_box()),
        rows_(rows_of(system)),
        system_(linear_form(system, rows_)),
        degree_(analyse_relative_degree(system_)),
        offset_(duplicate(system_.w0.get())) {
    if (!box_) return;
    // A component is never at both of its bounds (`against`): they share no multiplier.
    RowBuilder identity;
    const LocalRange range = row_range(degree_.markov.get());
    for (PetscInt row = range.first; row < range.last; ++row) {
      identity.add(row, 1.0);
      identity.end_row();
    }
    degree_.markov = identity.finish(system.comm(), range.size());
  }

  Dvi& dvi() override { return dvi_; }
  const LinearSystem& system() const override { return system_; }
  const RelativeDegree& degree() const override { return degree_; }
  const Forcing* offset() const override { return &rows_.offset; }

  std::vector<char> equations() const override { return rows_.equation; }

  // Between its bounds there is room for each component, up to rounding; M takes them for constraints that
  // share no multiplier.
  std::string against(double t, const std::vector<Side>& contact) override {
    constexpr double rounding = 256.0 * std::numeric_limits<double>::epsilon();
    PetscInt worst = -1;
    struct Row {
      double offset, size;
      bool held;
    };
    std::vector<std::optional<Row>> other(dvi_.w().size());
    check(VecSet(offset_.get(), 0.0));
    rows_.offset.add_to(offset_.get(), t, 0, 1.0);
    const ReadArray offsets(offset_.get());
    for (std::size_t a = 0; a < contact.size() && box_; ++a) {
      const double offset = offsets[static_cast<PetscInt>(a)];
      const Row now{offset, std::abs(offset), contact[a] != Side::none};
      std::optional<Row>& first = other[component(a)];
      // u - l >= 0 and b - u >= 0: the offsets' sum is b - l.
      if (first &&
          ((now.held && first->held) || now.offset + first->offset < -rounding * (now.size + first->size)))
        worst = std::max(worst, system_.constraint_order[a]);
      first = now;
    }
    MPI_Allreduce(MPI_IN_PLACE, &worst, 1, MPIU_INT, MPI_MAX, dvi_.comm());
    return worst < 0 ? "" : "the bounds of component " + std::to_string(worst) + " meet or cross";
  }

  // A box is known by its components: a number for each of the two bounds.
  void show_constraints(StateVisitor& visitor, const char* name, std::vector<double>& numbers) override {
    if (!box_) return HybridProcess::show_constraints(visitor, name, numbers);
    std::vector<double> both(2 * dvi_.w().size(), 0.0);
    const auto place = [&](std::size_t a) {
      return 2 * component(a) + (rows_.side[a] == Side::upper ? 1 : 0);
    };
    for (std::size_t a = 0; a < numbers.size(); ++a)
      both[place(a)] = numbers[a];
    visitor.visit(name, Belongs::constraint, both, 2);
    for (std::size_t a = 0; a < numbers.size(); ++a)
      numbers[a] = both[place(a)];
  }

  void read(double t, Vec x, std::vector<double>& z) override {
    check(VecCopy(dvi_.x(), x));
    const std::vector<Side> contact = in_contact();
    check(VecSet(offset_.get(), 0.0));
    rows_.offset.add_to(offset_.get(), t, 0, 1.0);
    const Vector w = duplicate(offset_.get());
    check(MatMultAdd(rows_.C.get(), x, offset_.get(), w.get()));
    const ReadArray values(w.get());
    for (std::size_t a = 0; a < z.size(); ++a)
      z[a] = contact[a] != Side::none ? 0.0 : values[static_cast<PetscInt>(a)];
  }

  void write(Vec x, const std::vector<double>& z, const std::vector<double>&,
             const std::vector<Side>& contact, const std::vector<double>& mu) override {
    const auto zero = [](std::span<double> values) { std::fill(values.begin(), values.end(), 0.0); };
    const auto sides = [&](std::span<double> values) {
      std::fill(values.begin(), values.end(), 0.0);
      for (std::size_t a = 0; a < contact.size(); ++a)
        if (contact[a] != Side::none) values[component(a)] = box_ ? sign(rows_.side[a]) : 1.0;
    };
    NamedNumbers put(
        true, {{"u",
                [&](std::span<double> values) {
                  const ReadArray from(x);
                  std::copy_n(from.data(), from.size(), values.begin());
                }},
               {"w",
                [&](std::span<double> values) {
                  std::fill(values.begin(), values.end(), std::numeric_limits<double>::infinity());
                  for (std::size_t a = 0; a < z.size(); ++a)
                    values[component(a)] = std::min(values[component(a)], z[a]);
                }},
               {"mu",
                [&](std::span<double> values) {
                  std::fill(values.begin(), values.end(), 0.0);
                  for (std::size_t a = 0; a < mu.size(); ++a)
                    values[component(a)] += box_ ? sign(rows_.side[a]) * mu[a] : mu[a];
                }},
               {"level", [](std::span<double> values) { std::fill(values.begin(), values.end(), 1.0); }},
               {"side", sides},
               {"old side", sides},
               {"started outside", zero},
               {"nu", zero}});
    dvi_.visit(put);
  }

  std::vector<Side> in_contact() override {
    std::vector<Side> contact(degree_.degree.size(), Side::none);
    NamedNumbers take(false, {{"side", [&](std::span<double> sides) {
                                 for (std::size_t a = 0; a < contact.size(); ++a) {
                                   const double wanted = box_ ? sign(rows_.side[a]) : 1.0;
                                   if (sides[component(a)] == wanted) contact[a] = Side::lower;
                                 }
                               }}});
    dvi_.visit(take);
    return contact;
  }

  // From outside of the set; the state does not jump otherwise.
  StepReport reset(StepSolver& solver, const Step& step, std::vector<char>& met) override {
    StepReport report = jump_of(dvi_, solver, step);
    for (const StepEvent& event : dvi_.events())
      for (std::size_t a = 0; a < met.size(); ++a)
        if (static_cast<PetscInt>(component(a)) == event.constraint && (!box_ || rows_.side[a] == event.side))
          met[a] = 1;
    return report;
  }

  void tell(std::vector<StepEvent> events) override {
    for (StepEvent& event : events) {
      if (!box_) continue;
      const auto a = static_cast<std::size_t>(event.constraint);
      event.side = rows_.side[a];
      event.constraint = rows_.component[a];
    }
    dvi_.tell(std::move(events));
  }

private:
  std::size_t component(std::size_t a) const {
    return box_ ? static_cast<std::size_t>(rows_.component[a]) : a;
  }

  ConstrainedDvi& dvi_;
  bool box_;
  Rows rows_;
  LinearSystem system_;
  RelativeDegree degree_;
  Vector offset_;
};

}  // namespace

std::unique_ptr<HybridProcess> make_hybrid(ConstrainedDvi& dvi, const SweepingSystem& system) {
  return std::make_unique<SweepingProcess>(dvi, system);
}

}  // namespace sweepvi
