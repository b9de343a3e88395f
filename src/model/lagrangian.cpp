#include "sweepvi/lagrangian.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "model/definiteness.hpp"
#include "model/dense_parts.hpp"
#include "model/step_matrix.hpp"

namespace sweepvi {

MPI_Comm LagrangianSystem::comm() const {
  return PetscObjectComm(reinterpret_cast<PetscObject>(M.get()));
}

PetscInt LagrangianSystem::coordinates() const {
  PetscInt n = 0;
  check(MatGetSize(M.get(), &n, nullptr));
  return n;
}

PetscInt LagrangianSystem::constraints() const {
  PetscInt m = 0;
  check(MatGetSize(H.get(), &m, nullptr));
  return m;
}

namespace {

void check_sizes(const DenseLagrangian& given) {
  const auto need = [](const char* name, std::size_t found, std::size_t expected) {
    if (found != expected)
      throw InputError(fmt::format("{} has {} entries, expected {}", name, found, expected));
  };
  const std::size_t n = given.q0.size();
  if (n == 0 || given.H.size() < n)
    throw InputError("a Lagrangian system needs at least one coordinate and one constraint");
  const std::size_t m = given.H.size() / n;
  need("M", given.M.size(), n * n);
  need("K", given.K.size(), n * n);
  need("H", given.H.size(), m * n);
  need("v0", given.v0.size(), n);
  if (!given.C.empty()) need("C", given.C.size(), n * n);
  if (!given.f.empty()) need("f", given.f.size(), n);
  if (!given.g0.empty()) need("g0", given.g0.size(), m);
  if (!given.e.empty()) need("e", given.e.size(), m);
  for (const auto& [name, values] : {std::pair{"M", &given.M},
                                     {"K", &given.K},
                                     {"H", &given.H},
                                     {"C", &given.C},
                                     {"q0", &given.q0},
                                     {"v0", &given.v0},
                                     {"g0", &given.g0},
                                     {"e", &given.e}})
    for (const double value : *values)
      if (!std::isfinite(value)) throw InputError(fmt::format("{} holds a number that is not finite", name));
}

}  // namespace

LagrangianSystem LagrangianSystem::dense(MPI_Comm comm, const DenseLagrangian& given) {
  agreed(comm, [&] { check_sizes(given); });
  const auto n = static_cast<PetscInt>(given.q0.size());
  const auto m = static_cast<PetscInt>(given.H.size()) / n;
  const LocalRange coordinates = share(comm, n);
  const LocalRange constraints = share(comm, m);
  LagrangianSystem system;
  system.M = rows_of(comm, given.M, coordinates, n, coordinates.size());
  system.K = rows_of(comm, given.K, coordinates, n, coordinates.size());
  if (!given.C.empty()) system.C = rows_of(comm, given.C, coordinates, n, coordinates.size());
  system.H = rows_of(comm, given.H, constraints, n, coordinates.size());
  if (!given.f.empty()) system.f = Forcing::from(given.f, coordinates.first, coordinates.last);
  system.g0 = part_of(comm, given.g0, constraints);
  system.e = part_of(comm, given.e, constraints);
  system.q0 = part_of(comm, given.q0, coordinates);
  system.v0 = part_of(comm, given.v0, coordinates);
  system.coordinate_order = numbers(coordinates);
  system.constraint_order = numbers(constraints);
  system.block = system.coordinate_order;
  system.block_count = n;
  system.check_values();
  return system;
}

void LagrangianSystem::check_values() const {
  const Matrix skew = add(M.get(), -1.0, transpose(M.get()).get());
  const auto coordinate = [this](PetscInt row) {
    return coordinate_order[static_cast<std::size_t>(row - row_range(M.get()).first)];
  };
  agreed(comm(), [&] {
    for_each_row(M.get(), [&](PetscInt row, auto columns, auto values) {
      double diagonal = 0.0;
      for (std::size_t k = 0; k < columns.size(); ++k)
        if (columns[k] == row) diagonal = values[k];
      if (!(diagonal > 0.0))
        throw InputError(
            fmt::format("M has {} on the diagonal of row {}; expected a mass > 0: M is positive definite",
                        diagonal, coordinate(row)));
      for (const auto& [column, value] : get_row(skew.get(), row))
        if (std::abs(value) > rounding * diagonal)
          throw InputError(
              fmt::format("M is not symmetric: row {} differs from its column by {}; expected M = M'",
                          coordinate(row), value));
    });
    const ReadArray restitution(e.get());
    const PetscInt first = row_range(H.get()).first;
    for_each_row(H.get(), [&](PetscInt row, auto, auto values) {
      const PetscInt number = constraint_order[static_cast<std::size_t>(row - first)];
      if (std::all_of(values.begin(), values.end(), [](double value) { return value == 0.0; }))
        throw InputError(
            fmt::format("row {} of H is zero; expected a constraint on the coordinates", number));
      const double value = restitution[row - first];
      if (!(value >= 0.0 && value <= 1.0))
        throw InputError(fmt::format("e of constraint {} is {}; expected 0 to 1", number, value));
    });
  });
  const Definiteness mass = examine_definiteness(M.get());
  if (mass.definite) return;
  const std::string where =
      mass.largest.empty()
          ? fmt::format("its smallest eigenvalue is {:.3g} with a diagonal of ones", mass.form)
          : fmt::format("v' M v = {:.3g} for a v along {}", mass.form, coordinates_text(*this, mass.largest));
  throw InputError(
      "model.M is not positive definite (" + where +
      "): not every motion has a kinetic energy; give each coordinate a mass of its own, or leave out "
      "coordinates that follow from others");
}

namespace {

void refuse_mass_matrix(const LagrangianSystem& system) {
  agreed(system.comm(), [&] {
    for_each_row(system.M.get(), [&](PetscInt row, auto columns, auto values) {
      for (std::size_t k = 0; k < columns.size(); ++k)
        if (columns[k] != row && values[k] != 0.0)
          throw InputError(
              "M is not diagonal; the schemes homsp and hybrid work on x' = A x, where M^-1 K would be "
              "dense. "
              "Use moreau-jean, or lump the masses");
    });
  });
}

void refuse_restitution(const LagrangianSystem& system) {
  agreed(system.comm(), [&] {
    const ReadArray restitution(system.e.get());
    for (PetscInt a = 0; a < restitution.size(); ++a)
      if (restitution[a] != 0.0)
        throw InputError(
            fmt::format("e of constraint {} is {}; the scheme homsp takes all velocity into the constraint "
                        "and needs 0. Use moreau-jean",
                        system.constraint_order[static_cast<std::size_t>(a)], restitution[a]));
  });
}

// The coordinates of a rank become pairs (q, v).
PetscInt position(PetscInt coordinate) {
  return 2 * coordinate;
}
PetscInt velocity(PetscInt coordinate) {
  return 2 * coordinate + 1;
}

}  // namespace

LinearSystem to_linear(const LagrangianSystem& system) {
  refuse_restitution(system);
  return first_order_form(system);
}

LinearSystem first_order_form(const LagrangianSystem& system) {
  refuse_mass_matrix(system);
  const MPI_Comm comm = system.comm();
  const LocalRange coordinates = row_range(system.M.get());
  const LocalRange constraints = row_range(system.H.get());
  const Matrix pushes = transpose(system.H.get());
  LinearSystem linear;
  RowBuilder a;
  RowBuilder b;
  std::vector<double> mass;
  for (PetscInt j = coordinates.first; j < coordinates.last; ++j) {
    for (const auto& [column, value] : get_row(system.M.get(), j))
      if (column == j) mass.push_back(value);
    const double inverse = 1.0 / mass.back();
    a.add(velocity(j), 1.0);
    a.end_row();
    for (const auto& [column, value] : get_row(system.K.get(), j))
      a.add(position(column), -inverse * value);
    if (system.C)
      for (const auto& [column, value] : get_row(system.C.get(), j))
        a.add(velocity(column), -inverse * value);
    a.end_row();
    b.end_row();
    b.add(get_row(pushes.get(), j), inverse);
    b.end_row();
    const auto local = static_cast<std::size_t>(j - coordinates.first);
    const PetscInt number = system.coordinate_order[local];
    linear.state_order.insert(linear.state_order.end(), {number, system.coordinates() + number});
    linear.block.insert(linear.block.end(), {system.block[local], system.block[local]});
  }
  linear.A = a.finish(comm, 2 * coordinates.size());
  linear.B = b.finish(comm, constraints.size());
  RowBuilder c;
  for (PetscInt row = constraints.first; row < constraints.last; ++row) {
    for (const auto& [column, value] : get_row(system.H.get(), row))
      c.add(position(column), value);
    c.end_row();
  }
  linear.C = c.finish(comm, 2 * coordinates.size());

  linear.f = system.f;
  for (std::vector<Forcing::Entry>* entries : {&linear.f.constant, &linear.f.varying})
    for (Forcing::Entry& entry : *entries)
      entry = {velocity(entry.local), entry.signal.scaled(1.0 / mass[static_cast<std::size_t>(entry.local)])};
  linear.x0 = make_vector(comm, 2 * coordinates.size());
  {
    const ReadArray q(system.q0.get());
    const ReadArray v(system.v0.get());
    const WriteArray x(linear.x0.get());
    for (PetscInt j = 0; j < q.size(); ++j) {
      x[position(j)] = q[j];
      x[velocity(j)] = v[j];
    }
  }
  linear.w0 = duplicate(system.g0.get());
  check(VecCopy(system.g0.get(), linear.w0.get()));
  linear.constraint_order = system.constraint_order;
  linear.block_count = system.block_count;
  linear.layout = StateLayout::state_by_state;
  linear.state_names = {"q", "v"};
  return linear;
}

}  // namespace sweepvi
