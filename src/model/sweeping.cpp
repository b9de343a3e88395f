#include <algorithm>
#include <cmath>
#include <limits>

#include "model/dense_parts.hpp"
#include "sweepvi/sweeping.hpp"

namespace sweepvi {

MPI_Comm SweepingSystem::comm() const {
  return PetscObjectComm(reinterpret_cast<PetscObject>(u0.get()));
}

PetscInt SweepingSystem::states() const {
  PetscInt n = 0;
  check(VecGetSize(u0.get(), &n));
  return n;
}

PetscInt SweepingSystem::constraints() const {
  PetscInt count = 0;
  if (G) {
    check(MatGetSize(G.get(), &count, nullptr));
    return count;
  }
  PetscInt local = 0;
  check(VecGetLocalSize(u0.get(), &local));
  // An entry that is not listed is zero, a bound like any other.
  std::vector<char> free_below(static_cast<std::size_t>(local), lower ? 0 : 1);
  std::vector<char> free_above(static_cast<std::size_t>(local), upper ? 0 : 1);
  const auto find_free = [](const std::optional<Forcing>& bound, std::vector<char>& is_free) {
    if (!bound) return;
    for (const Forcing::Entry& entry : bound->constant)
      if (std::isinf(entry.signal.offset)) is_free[static_cast<std::size_t>(entry.local)] = 1;
  };
  find_free(lower, free_below);
  find_free(upper, free_above);
  for (std::size_t i = 0; i < free_below.size(); ++i)
    count += free_below[i] != 0 && free_above[i] != 0 ? 0 : 1;
  MPI_Allreduce(MPI_IN_PLACE, &count, 1, MPIU_INT, MPI_SUM, comm());
  return count;
}

double one_sided_lipschitz(const SweepingSystem& system) {
  if (!system.A) return 0.0;
  const Matrix symmetric = add(system.A.get(), 1.0, transpose(system.A.get()).get());  // A + A'
  double largest = PETSC_NINFINITY;
  for_each_row(symmetric.get(), [&](PetscInt row, auto columns, auto values) {
    double sum = 0.0;
    for (std::size_t k = 0; k < columns.size(); ++k)
      sum += columns[k] == row ? values[k] : std::abs(values[k]);
    largest = std::max(largest, 0.5 * sum);
  });
  MPI_Allreduce(MPI_IN_PLACE, &largest, 1, MPI_DOUBLE, MPI_MAX, system.comm());
  return largest;
}

// ---- given in full --------------------------------------------------------------------------------

namespace {

void need_finite(const char* name, double value) {
  if (!std::isfinite(value)) throw InputError(std::string(name) + " holds a number that is not finite");
}

/// `missing` may stand for an absent bound.
void check_signals(const char* name, const std::vector<Signal>& signals, std::size_t length, double missing) {
  if (!signals.empty() && signals.size() != length)
    throw InputError(std::string(name) + " has " + std::to_string(signals.size()) + " entries, expected " +
                     std::to_string(length));
  for (const Signal& signal : signals) {
    const bool absent = std::isinf(missing) && signal.offset == missing && !signal.varies();
    for (const double value :
         {absent ? 0.0 : signal.offset, signal.amplitude, signal.frequency, signal.phase})
      need_finite(name, value);
  }
}

void check_dense(const DenseSweeping& given) {
  const std::size_t n = given.u0.size();
  if (n == 0) throw InputError("a sweeping process needs at least one component");
  const auto need = [](const char* name, std::size_t found, std::size_t expected) {
    if (found != expected)
      throw InputError(std::string(name) + " has " + std::to_string(found) + " entries, expected " +
                       std::to_string(expected));
  };
  const bool box = !given.lower.empty() || !given.upper.empty();
  const bool polyhedron = !given.G.empty() || !given.g.empty();
  if (box == polyhedron)
    throw InputError(box ? "both a box and a polyhedron are given, expected one of them"
                         : "no set is given, expected a box (lower, upper) or a polyhedron (G, g)");
  if (!given.A.empty()) need("A", given.A.size(), n * n);
  if (polyhedron) need("G", given.G.size(), given.g.size() * n);
  constexpr double infinity = std::numeric_limits<double>::infinity();
  check_signals("f", given.f, n, 0.0);
  check_signals("lower", given.lower, n, -infinity);
  check_signals("upper", given.upper, n, infinity);
  check_signals("g", given.g, given.g.size(), 0.0);
  for (const auto& [name, values] : {std::pair{"u0", &given.u0}, {"A", &given.A}, {"G", &given.G}})
    for (const double value : *values)
      need_finite(name, value);
}

/// As rows_of, with the zeros stored.
Matrix full_rows_of(MPI_Comm comm, const std::vector<double>& values, LocalRange range, PetscInt columns,
                    PetscInt local_columns) {
  RowBuilder rows;
  for (PetscInt i = range.first; i < range.last; ++i) {
    for (PetscInt j = 0; j < columns; ++j)
      rows.add(j, values[static_cast<std::size_t>(i) * static_cast<std::size_t>(columns) +
                         static_cast<std::size_t>(j)]);
    rows.end_row();
  }
  return rows.finish(comm, local_columns);
}

}  // namespace

SweepingSystem SweepingSystem::dense(MPI_Comm comm, const DenseSweeping& given) {
  agreed(comm, [&] { check_dense(given); });
  const auto n = static_cast<PetscInt>(given.u0.size());
  const LocalRange states = share(comm, n);
  SweepingSystem system;
  system.u0 = part_of(comm, given.u0, states);
  if (!given.A.empty()) system.A = rows_of(comm, given.A, states, n, states.size());
  system.f = Forcing::from(given.f, states.first, states.last);
  if (!given.lower.empty()) system.lower = Forcing::from(given.lower, states.first, states.last);
  if (!given.upper.empty()) system.upper = Forcing::from(given.upper, states.first, states.last);
  system.state_order = numbers(states);
  if (given.G.empty()) return system;
  const LocalRange faces = share(comm, static_cast<PetscInt>(given.g.size()));
  const auto rows = given.faces_turn ? full_rows_of : rows_of;
  system.G = rows(comm, given.G, faces, n, states.size());
  system.g = Forcing::from(given.g, faces.first, faces.last);
  system.face_order = numbers(faces);
  return system;
}

}  // namespace sweepvi
