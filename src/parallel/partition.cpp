#include "sweepvi/partition.hpp"

#include <algorithm>
#include <utility>

#include "parallel/row_move.hpp"
#include "parallel/share.hpp"

namespace sweepvi {

namespace {

/// The outputs of these constraints, in old numbers; levels and degrees are the constraints' new ones.
std::vector<PetscInt> outputs_of(const RelativeDegree& relative_degree, const RowMove& constraints) {
  const PetscInt first = row_range(relative_degree.Z.get()).first;
  std::vector<PetscInt> first_output;
  for (std::size_t a = 0; a < relative_degree.degree.size(); ++a)
    first_output.push_back(first + relative_degree.first_level[a]);
  first_output = constraints.moved(first_output);
  const std::vector<int> degree = constraints.moved(relative_degree.degree);
  std::vector<PetscInt> outputs;
  for (std::size_t a = 0; a < degree.size(); ++a)
    for (PetscInt i = 0; i < degree[a]; ++i)
      outputs.push_back(first_output[a] + i);
  return outputs;
}

/// Opposite rows follow the constraint they were merged into.
std::vector<OppositeRow> moved(const std::vector<OppositeRow>& opposite, std::size_t constraints,
                               const RowMove& move) {
  std::vector<OppositeRow> of_constraint(constraints, OppositeRow{-1, -1, 1.0, 1.0});
  for (const OppositeRow& row : opposite)
    of_constraint[static_cast<std::size_t>(row.constraint)] = row;
  of_constraint = move.moved(of_constraint);
  for (std::size_t a = 0; a < of_constraint.size(); ++a)
    if (of_constraint[a].constraint >= 0) of_constraint[a].constraint = static_cast<PetscInt>(a);
  std::erase_if(of_constraint, [](const OppositeRow& row) { return row.constraint < 0; });
  return of_constraint;
}

void move_rows(LinearSystem& system, const RowMove& states, const RowMove& constraints) {
  const MPI_Comm comm = system.comm();
  system.A = moved(system.A.get(), states, states);
  system.B = moved(system.B.get(), states, constraints);
  system.C = moved(system.C.get(), constraints, states);
  if (system.D) system.D = moved(system.D.get(), constraints, constraints);
  system.w0 = constraints.moved(system.w0.get());
  if (system.wmax) system.wmax = constraints.moved(system.wmax.get());
  system.opposite = moved(system.opposite, system.constraint_order.size(), constraints);
  system.x0 = states.moved(system.x0.get());
  system.f = moved(comm, system.f, states);
  system.state_order = states.moved(system.state_order);
  system.constraint_order = constraints.moved(system.constraint_order);
}

void move_rows(MPI_Comm comm, PetscInt old_states, RelativeDegree& relative_degree, const RowMove& states,
               const RowMove& constraints, const RowMove& outputs) {
  relative_degree.degree = constraints.moved(relative_degree.degree);
  relative_degree.markov_diagonal = constraints.moved(relative_degree.markov_diagonal);
  relative_degree.first_level.assign(1, 0);
  for (const int degree : relative_degree.degree)
    relative_degree.first_level.push_back(relative_degree.first_level.back() + degree);
  if (relative_degree.has_pivots) {
    const std::vector<PetscInt> pivots = outputs.moved(relative_degree.pivot);
    relative_degree.pivot = RowMove(comm, old_states, pivots).moved(states.new_numbers());
  }
  relative_degree.Z = moved(relative_degree.Z.get(), outputs, states);
  relative_degree.directions = moved(relative_degree.directions.get(), outputs, states);
  relative_degree.markov = moved(relative_degree.markov.get(), constraints, constraints);
}

}  // namespace

void distribute(LinearSystem& system, RelativeDegree& relative_degree) {
  const MPI_Comm comm = system.comm();
  Share share = share_out(comm, gather_element_graph(system, relative_degree));
  system.edge_cut = share.edge_cut;
  system.block_count = share.block_count;
  system.block = std::move(share.block);

  const PetscInt old_states = row_range(system.A.get()).size();
  const RowMove states(comm, old_states, share.states);
  const RowMove constraints(comm, row_range(system.C.get()).size(), share.constraints);
  if (!states.moves() && !constraints.moves()) return;
  const RowMove outputs(comm, row_range(relative_degree.Z.get()).size(),
                        outputs_of(relative_degree, constraints));
  move_rows(system, states, constraints);
  move_rows(comm, old_states, relative_degree, states, constraints, outputs);
}

}  // namespace sweepvi
