// Solves many box VIs, one after the other, as `sweepvi solve` does, without starting it for each.
// usage: many_problems_program PROBLEMS ANSWERS [PETSc options]
//
// PROBLEMS, binary, of each problem: int64 n, nonzeros; int64 rows[], columns[] (from 0, row by row); double
// values[], q[n], lower[n], upper[n], u0[n]. ANSWERS, of each: double certified (0 or 1), seconds, rung,
// u[n].
#include <chrono>
#include <cstdint>
#include <fstream>
#include <string>
#include <vector>

#include "dvi/affine_vi.hpp"
#include "petsc/sparse.hpp"
#include "sweepvi/petsc.hpp"
#include "sweepvi/step_solver.hpp"

namespace sweepvi {
namespace {

template <class T>
std::vector<T> take(std::istream& file, std::int64_t count) {
  std::vector<T> values(static_cast<std::size_t>(count));
  file.read(reinterpret_cast<char*>(values.data()), static_cast<std::streamsize>(values.size() * sizeof(T)));
  return values;
}

/// This rank's part of all n values.
Vector share(MPI_Comm comm, const std::vector<double>& all, PetscInt local, PetscInt first) {
  Vector part = make_vector(comm, local);
  const WriteArray to(part.get());
  for (PetscInt i = 0; i < local; ++i)
    to[i] = all[static_cast<std::size_t>(first + i)];
  return part;
}

void solve(MPI_Comm comm, std::istream& problems, std::ostream& answers) {
  const auto sizes = take<std::int64_t>(problems, 2);
  const auto rows = take<std::int64_t>(problems, sizes[1]);
  const auto columns = take<std::int64_t>(problems, sizes[1]);
  const auto values = take<double>(problems, sizes[1]);
  PetscInt size = static_cast<PetscInt>(sizes[0]);
  PetscInt local = PETSC_DECIDE;
  PetscInt last = 0;
  check(PetscSplitOwnership(comm, &local, &size));
  MPI_Scan(&local, &last, 1, MPIU_INT, MPI_SUM, comm);
  const PetscInt first = last - local;
  RowBuilder builder;
  std::size_t entry = 0;
  for (PetscInt i = 0; i < last; ++i) {
    for (; entry < rows.size() && rows[entry] == i; ++entry)
      if (i >= first) builder.add(static_cast<PetscInt>(columns[entry]), values[entry]);
    if (i < first) continue;
    builder.add(i, 0.0);  // the diagonal is stored, as the program stores it
    builder.end_row();
  }
  std::vector<Vector> vectors;  // q, lower, upper, u0
  for (int k = 0; k < 4; ++k)
    vectors.push_back(share(comm, take<double>(problems, size), local, first));
  const auto begin = std::chrono::steady_clock::now();
  AffineVi vi(builder.finish(comm, local), std::move(vectors[0]), std::move(vectors[1]),
              std::move(vectors[2]), std::move(vectors[3]));
  NonlinearSolver snes;
  check(SNESCreate(comm, snes.put()));
  StepSolver solver(snes.get(), vi);
  const StepReport report = solver.solve(Step{1, 0.0, 0.0, 0.0});
  const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - begin;

  std::vector<double> answer(static_cast<std::size_t>(size) + 3);
  const ReadArray mine(solver.solution());
  std::copy_n(mine.data(), mine.size(), answer.begin() + 3 + first);
  MPI_Allreduce(MPI_IN_PLACE, answer.data(), static_cast<int>(answer.size()), MPI_DOUBLE, MPI_SUM, comm);
  answer[0] = report.certified ? 1.0 : 0.0;
  answer[1] = seconds.count();
  answer[2] = static_cast<double>(report.rung);
  answers.write(reinterpret_cast<const char*>(answer.data()),
                static_cast<std::streamsize>(answer.size() * sizeof(double)));
  answers.flush();
}

}  // namespace
}  // namespace sweepvi

int main(int argc, char** argv) {
  sweepvi::Session session(argc, argv);
  int rank = 0;
  MPI_Comm_rank(session.comm(), &rank);
  std::ifstream problems(argv[1], std::ios::binary);
  std::ofstream answers(rank == 0 ? argv[2] : "/dev/null", std::ios::binary);
  while (problems.peek() != std::ifstream::traits_type::eof())
    sweepvi::solve(session.comm(), problems, answers);
  return 0;
}
