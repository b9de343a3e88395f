#include "sweepvi/linear_system.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "model/dense_parts.hpp"

namespace sweepvi {

Forcing Forcing::from(const std::vector<Signal>& all, PetscInt first, PetscInt last) {
  Forcing forcing;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const Signal& signal = all[i];
    if (signal.is_zero()) continue;
    forcing.any = true;
    forcing.varies = forcing.varies || signal.varies();
    const auto row = static_cast<PetscInt>(i);
    if (row < first || row >= last) continue;
    (signal.varies() ? forcing.varying : forcing.constant).push_back({row - first, signal});
  }
  return forcing;
}

void Forcing::clear(Vec y) const {
  if (constant.empty() && varying.empty()) return;
  const WriteArray values(y);
  for (const auto* entries : {&constant, &varying})
    for (const Entry& entry : *entries)
      values[entry.local] = 0.0;
}

void Forcing::add_to(Vec y, double t, int order, double factor) const {
  if (constant.empty() && varying.empty()) return;
  const WriteArray values(y);
  if (order == 0)
    for (const Entry& entry : constant)
      values[entry.local] += factor * entry.signal.value(t);
  add_varying_to(values.data(), t, order, factor);
}

// Many entries share a frequency: sin(a + phase) = sin(a) cos(phase) + cos(a) sin(phase).
void Forcing::add_varying_to(double* y, double t, int order, double factor) const {
  double frequency = 0.0;  // of no entry that varies
  double sine = 0.0;
  double cosine = 0.0;
  for (const Entry& entry : varying) {
    const Signal& signal = entry.signal;
    if (signal.frequency != frequency) {
      frequency = signal.frequency;
      const double omega = 2.0 * std::numbers::pi * frequency;
      const double angle = omega * t + 0.5 * std::numbers::pi * (order % 4);
      const double scale = std::pow(omega, order);
      sine = scale * std::sin(angle);
      cosine = scale * std::cos(angle);
    }
    const double wave = signal.amplitude * (sine * entry.cosine + cosine * entry.sine);
    y[entry.local] += factor * (order == 0 ? signal.offset + wave : wave);
  }
}

void Forcing::add_bound_to(Vec y, int order, double factor) const {
  const WriteArray values(y);
  if (order == 0)
    for (const Entry& entry : constant)
      values[entry.local] += factor * entry.signal.bound();
  for (const Entry& entry : varying)
    values[entry.local] += factor * entry.signal.bound(order);
}

MPI_Comm LinearSystem::comm() const {
  return PetscObjectComm(reinterpret_cast<PetscObject>(A.get()));
}

PetscInt LinearSystem::states() const {
  PetscInt n = 0;
  check(MatGetSize(A.get(), &n, nullptr));
  return n;
}

PetscInt LinearSystem::constraints() const {
  PetscInt m = 0;
  check(MatGetSize(C.get(), &m, nullptr));
  return m;
}

PetscInt LinearSystem::scene_constraints() const {
  auto merged = static_cast<PetscInt>(opposite.size());
  MPI_Allreduce(MPI_IN_PLACE, &merged, 1, MPIU_INT, MPI_SUM, comm());
  return constraints() + merged;
}

namespace {

void check_sizes(const DenseSystem& given) {
  const auto need = [](const char* name, std::size_t found, std::size_t expected) {
    if (found != expected)
      throw InputError(std::string(name) + " has " + std::to_string(found) + " entries, expected " +
                       std::to_string(expected));
  };
  const std::size_t n = given.x0.size();
  if (n == 0 || given.B.size() < n) throw InputError("a system needs at least one state and one constraint");
  const std::size_t m = given.B.size() / n;
  need("A", given.A.size(), n * n);
  need("B", given.B.size(), n * m);
  need("C", given.C.size(), m * n);
  if (!given.D.empty()) need("D", given.D.size(), m * m);
  if (!given.f.empty()) need("f", given.f.size(), n);
  if (!given.w0.empty()) need("w0", given.w0.size(), m);
  if (!given.wmax.empty()) need("wmax", given.wmax.size(), m);
  for (const auto& [name, values] : {std::pair{"A", &given.A},
                                     {"B", &given.B},
                                     {"C", &given.C},
                                     {"D", &given.D},
                                     {"w0", &given.w0},
                                     {"x0", &given.x0}})
    for (const double value : *values)
      if (!std::isfinite(value)) throw InputError(std::string(name) + " holds a number that is not finite");
  for (const double value : given.wmax)
    if (!(value > 0.0)) throw InputError("wmax holds " + std::to_string(value) + "; expected more than 0");
}

}  // namespace

LinearSystem LinearSystem::dense(MPI_Comm comm, const DenseSystem& given) {
  agreed(comm, [&] { check_sizes(given); });
  const auto n = static_cast<PetscInt>(given.x0.size());
  const auto m = static_cast<PetscInt>(given.B.size()) / n;
  const LocalRange states = share(comm, n);
  const LocalRange constraints = share(comm, m);
  LinearSystem system;
  system.A = rows_of(comm, given.A, states, n, states.size());
  system.B = rows_of(comm, given.B, states, m, constraints.size());
  system.C = rows_of(comm, given.C, constraints, n, states.size());
  if (std::any_of(given.D.begin(), given.D.end(), [](double value) { return value != 0.0; }))
    system.D = rows_of(comm, given.D, constraints, m, constraints.size());
  system.x0 = part_of(comm, given.x0, states);
  system.w0 = part_of(comm, given.w0, constraints);
  if (!given.wmax.empty()) system.wmax = part_of(comm, given.wmax, constraints);
  if (!given.f.empty()) system.f = Forcing::from(given.f, states.first, states.last);
  system.state_order = numbers(states);
  system.block = system.state_order;
  system.block_count = n;
  system.constraint_order = numbers(constraints);
  return system;
}

}  // namespace sweepvi
