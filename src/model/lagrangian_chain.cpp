#include <fmt/format.h>

#include <cmath>
#include <utility>

#include "model/chain.hpp"
#include "petsc/sparse.hpp"

namespace sweepvi {

namespace {

// Rows of a chain's LinearSystem stand as pairs (q, v), element by element.
bool is_velocity(PetscInt state) {
  return state % 2 == 1;
}

/// The lambdas push as the constraints read, over the mass: B = M^-1 H'.
void check_pushes(const LinearSystem& chain, const std::vector<double>& mass, const std::string& element) {
  const Matrix reads = transpose(chain.C.get());  // rows of states
  agreed(chain.comm(), [&] {
    for_each_row(chain.B.get(), [&](PetscInt row, auto columns, auto values) {
      if (!is_velocity(row)) return;
      const PetscInt first = row_range(chain.B.get()).first;
      const double m = mass[static_cast<std::size_t>((row - first) / 2)];
      SparseRow pushes;
      for (std::size_t k = 0; k < columns.size(); ++k)
        pushes.emplace_back(columns[k], m * values[k]);
      double scale = 0.0;
      for (const auto& [constraint, value] : pushes)
        scale = std::max(scale, std::abs(value));
      for (const auto& [constraint, value] : add(pushes, -1.0, get_row(reads.get(), row - 1)))
        if (!(std::abs(value) <= rounding * scale))
          throw InputError(fmt::format(
              "element \"{}\" pushes otherwise than it reads: mass times the push of lambda_{} on element {} "
              "differs from the reading by {}; moreau-jean needs B = M^-1 H'",
              element, constraint, row / 2, value));
    });
  });
}

}  // namespace

LagrangianSystem make_lagrangian_chain(MPI_Comm comm, const ChainSpec& spec) {
  LinearSystem chain = make_chain(comm, spec);
  const LocalRange states = row_range(chain.A.get());
  const PetscInt count = states.size() / 2;
  std::vector<double> mass;
  for (PetscInt i = states.first / 2; i < states.last / 2; ++i)
    mass.push_back(spec.keys[*spec.element->mass][i]);
  check_pushes(chain, mass, spec.element->name);

  LagrangianSystem system;
  RowBuilder m;
  RowBuilder k;
  RowBuilder c;
  for (PetscInt i = 0; i < count; ++i) {
    const PetscInt element = states.first / 2 + i;
    const double inertia = mass[static_cast<std::size_t>(i)];
    m.add(element, inertia);
    for (const auto& [state, value] : get_row(chain.A.get(), 2 * element + 1))
      (is_velocity(state) ? c : k).add(state / 2, -inertia * value);
    for (RowBuilder* rows : {&m, &k, &c})
      rows->end_row();
    system.coordinate_order.push_back(element);
  }
  system.M = m.finish(comm, count);
  system.K = k.finish(comm, count);
  system.C = c.finish(comm, count);
  PetscReal damping = 0.0;
  check(MatNorm(system.C.get(), NORM_INFINITY, &damping));
  if (damping == 0.0) system.C.reset();
  RowBuilder h;
  for_each_row(chain.C.get(), [&](PetscInt, auto columns, auto values) {
    for (std::size_t n = 0; n < columns.size(); ++n)
      h.add(columns[n] / 2, values[n]);
    h.end_row();
  });
  system.H = h.finish(comm, count);

  system.f = chain.f;
  for (std::vector<Forcing::Entry>* entries : {&system.f.constant, &system.f.varying})
    for (Forcing::Entry& entry : *entries)
      entry = {entry.local / 2, entry.signal.scaled(mass[static_cast<std::size_t>(entry.local / 2)])};
  system.q0 = make_vector(comm, count);
  system.v0 = make_vector(comm, count);
  system.g0 = std::move(chain.w0);
  system.e = make_vector(comm, count);
  const ReadArray x(chain.x0.get());
  const WriteArray q(system.q0.get());
  const WriteArray v(system.v0.get());
  const WriteArray e(system.e.get());
  for (PetscInt i = 0; i < count; ++i) {
    q[i] = x[2 * i];
    v[i] = x[2 * i + 1];
    if (spec.element->restitution) e[i] = spec.keys[*spec.element->restitution][states.first / 2 + i];
  }
  system.constraint_order = std::move(chain.constraint_order);
  system.block = system.coordinate_order;
  system.block_count = static_cast<PetscInt>(spec.count);
  return system;
}

}  // namespace sweepvi
