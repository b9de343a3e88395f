#pragma once

#include "io/table_file.hpp"
#include "sweepvi/step_solver.hpp"

namespace sweepvi {

/// The dataset /solver/rungs: how many steps each attempt of the ladder has solved since the last row. Rank 0
/// writes it.
inline FieldSpec rungs_field(MPI_Comm comm) {
  int rank = 0;
  MPI_Comm_rank(comm, &rank);
  constexpr hsize_t count = StepSolver::rung_names.size();
  return {"/solver/rungs",
          FieldSpec::Type::integer,
          {count},
          0,
          rank == 0 ? count : 0,
          "1",
          "steps since the last row by the attempt that solved them",
          {StepSolver::rung_names.begin(), StepSolver::rung_names.end()}};
}

}  // namespace sweepvi
