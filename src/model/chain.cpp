#include "model/chain.hpp"

#include <cmath>
#include <numeric>

#include "petsc/sparse.hpp"

namespace sweepvi {

namespace {

constexpr PetscInt states_per_element = 5;
constexpr double golden_fraction = 0.6180339887498949;

// Row of the element's j-th state: own entries, then the neighbours'.
void add_row(RowBuilder& rows, const ChainSpec& spec, PetscInt i, PetscInt j) {
  const PetscInt own = states_per_element * i;
  switch (j) {
    case 0:
      rows.add(own + 1, 1.0);
      break;
    case 1:
      rows.add(own + 2, 1.0);
      break;
    case 2: {
      rows.add(own, spec.a1[i] - 2.0 * spec.coupling);
      rows.add(own + 1, spec.a2[i]);
      rows.add(own + 2, spec.a3[i]);
      rows.add(own + 4, 1.0);
      if (spec.coupling == 0.0) break;
      const auto last = static_cast<PetscInt>(spec.count) - 1;
      if (i > 0) rows.add(own - states_per_element, spec.coupling);
      if (i < last) rows.add(own + states_per_element, spec.coupling);
      if (spec.ring && i == 0) rows.add(states_per_element * last, spec.coupling);
      if (spec.ring && i == last) rows.add(0, spec.coupling);
      break;
    }
    case 3:
      rows.add(own + 4, 1.0);
      break;
    default:
      rows.add(own, 1.0);
      rows.add(own + 3, -1.0);
  }
  rows.end_row();
}

}  // namespace

LinearSystem make_chain(MPI_Comm comm, const ChainSpec& spec) {
  PetscInt count = static_cast<PetscInt>(spec.count);
  PetscInt elements = PETSC_DECIDE;
  check(PetscSplitOwnership(comm, &elements, &count));
  PetscInt last = 0;
  MPI_Scan(&elements, &last, 1, MPIU_INT, MPI_SUM, comm);
  const PetscInt first = last - elements;
  const PetscInt local_states = states_per_element * elements;

  LinearSystem system;
  RowBuilder a;
  RowBuilder b;
  RowBuilder c;
  for (PetscInt i = first; i < last; ++i) {
    for (PetscInt j = 0; j < states_per_element; ++j) {
      add_row(a, spec, i, j);
      if (j == 2) b.add(i, 1.0);
      b.end_row();
      system.block.push_back(i);
      system.state_order.push_back(states_per_element * i + j);
    }
    c.add(states_per_element * i, 1.0);
    c.end_row();
    system.constraint_order.push_back(i);
  }
  system.A = a.finish(comm, local_states);
  system.B = b.finish(comm, elements);
  system.C = c.finish(comm, local_states);
  system.block_count = count;
  system.state_names = {"z1", "z2", "z3", "xi1", "xi2"};
  system.w0 = make_vector(comm, elements);
  system.x0 = make_vector(comm, local_states);
  {
    const WriteArray x(system.x0.get());
    for (PetscInt i = first; i < last; ++i) {
      const double golden = static_cast<double>(i) * golden_fraction;
      if (spec.x0.empty())
        x[states_per_element * (i - first)] = spec.base[i] + spec.spread[i] * (golden - std::floor(golden));
    }
    if (!spec.x0.empty())
      for (PetscInt k = 0; k < local_states; ++k)
        x[k] = spec.x0[static_cast<std::size_t>(states_per_element) * static_cast<std::size_t>(first) +
                       static_cast<std::size_t>(k)];
  }
  for (const Signal& force : spec.force.values) {
    system.f.any = system.f.any || !force.is_zero();
    system.f.varies = system.f.varies || force.varies();
  }
  for (PetscInt i = first; i < last && system.f.any; ++i) {
    const Signal& force = spec.force[i];
    if (force.is_zero()) continue;
    (force.varies() ? system.f.varying : system.f.constant)
        .push_back({states_per_element * (i - first) + 2, force});
  }
  return system;
}

}  // namespace sweepvi
