#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <limits>
#include <optional>

#include "app/failure.hpp"
#include "app/file_head.hpp"
#include "app/options.hpp"
#include "app/summary.hpp"
#include "app/verbs.hpp"
#include "dvi/affine_vi.hpp"
#include "io/printable.hpp"
#include "io/rungs_field.hpp"
#include "model/from_scene.hpp"
#include "petsc/sparse.hpp"

namespace sweepvi::app {

namespace {

// The solver's idea of "no bound".
std::vector<double> petsc_bounds(std::vector<double> bounds) {
  for (double& bound : bounds) {
    if (bound >= PETSC_INFINITY) bound = PETSC_INFINITY;
    if (bound <= PETSC_NINFINITY) bound = PETSC_NINFINITY;
  }
  return bounds;
}

const char* status_of(const StepReport& report, bool certifies) {
  if (!report.certified) return "failed";
  return certifies ? "done" : "done, not certified";
}

void record(MPI_Comm comm, const std::string& path, bool overwrite, const Problem& problem,
            const std::string& started, const StepReport& report, bool certifies, Vec u, Vec f,
            const std::optional<ErrorEstimate>& error) {
  PetscInt size = 0;
  PetscInt first = 0;
  PetscInt last = 0;
  check(VecGetSize(u, &size));
  check(VecGetOwnershipRange(u, &first, &last));
  const auto field = [&](const char* name, const char* description) {
    return FieldSpec{name,
                     FieldSpec::Type::real,
                     {static_cast<hsize_t>(size)},
                     static_cast<hsize_t>(first),
                     static_cast<hsize_t>(last - first),
                     "1",
                     description,
                     {}};
  };
  TableFile file(
      comm, path,
      {{"/t", FieldSpec::Type::real, {}, 0, 0, "s", "no time: one problem", {}},
       field("/solution", "u"),
       field("/F", "M u + q at the solution"),
       {"/solver/iterations", FieldSpec::Type::integer, {}, 0, 0, "1", "Newton iterations", {}},
       {"/solver/residual", FieldSpec::Type::real, {}, 0, 0, "1", "worst certificate ratio", {}},
       rungs_field(comm),
       field("/error", "how far u may be off: what the rounding of terms makes of it; nan: unknown")},
      {.expected_rows = 1, .overwrite = overwrite});
  file.real(0)[0] = 0.0;
  const ReadArray values(u);
  const ReadArray residual(f);
  std::copy_n(values.data(), values.size(), file.real(1));
  std::copy_n(residual.data(), residual.size(), file.real(2));
  file.integer(3)[0] = static_cast<std::int32_t>(report.iterations);
  file.real(4)[0] = report.residual;
  for (std::size_t k = 0; k < file.slice_size(5); ++k)
    file.integer(5)[k] = report.certified && k == static_cast<std::size_t>(report.rung) ? 1 : 0;
  if (error) {
    const ReadArray of_u(error->error.get());
    std::copy_n(of_u.data(), of_u.size(), file.real(6));
  } else {
    std::fill_n(file.real(6), values.size(), std::numeric_limits<double>::quiet_NaN());
  }
  file.commit_row();
  describe(file, comm, "", problem.text, {}, started);
  file.attribute("status", status_of(report, certifies));
  file.attribute("finished", timestamp());
  file.finish();
}

// What u is worth, in a line.
std::string told(const std::optional<ErrorEstimate>& error) {
  constexpr double ill_conditioned = 1e-6;
  if (!error)
    return "error of u unknown: the rows between bounds do not determine it (M is singular there, or next to "
           "it); other solutions may be far away";
  return fmt::format("error of u about {:.1e} of its largest entry if M and q are good to 16 digits{}",
                     error->of_largest,
                     error->of_largest > ill_conditioned ? ": the problem is ill-conditioned" : "");
}

}  // namespace

ExitCode solve(MPI_Comm comm, const CommandLine& line) {
  const double begin = MPI_Wtime();
  const std::string started = timestamp();
  Problem problem = read_problem(comm, line.scene);
  insert_scene_options(line, "", false);
  PetscInt size = static_cast<PetscInt>(problem.M.rows);
  MPI_Bcast(&size, 1, MPIU_INT, 0, comm);
  PetscInt local = PETSC_DECIDE;
  check(PetscSplitOwnership(comm, &local, &size));
  AffineVi vi(scatter_rows(comm, problem.M, local, local, true), scatter_vector(comm, problem.q, local),
              scatter_vector(comm, petsc_bounds(problem.lower), local),
              scatter_vector(comm, petsc_bounds(problem.upper), local),
              scatter_vector(comm, problem.u0, local), scatter_vector(comm, problem.terms, local));
  NonlinearSolver snes;
  check(SNESCreate(comm, snes.put()));
  StepSolver solver(snes.get(), vi);
  if (line.help_requested) return ExitCode::done;

  const std::string path =
      table_path(comm, line.output.value_or(std::filesystem::path(line.scene).stem().string() + ".h5"));
  check_distinct(
      comm, {{"the problem", line.scene}, {"the output", path}, {"--summary", line.summary.value_or("")}});
  check_writable(comm, path, line.force);
  if (line.summary) check_writable(comm, *line.summary, true);

  Summary summary;
  summary.describe(solver);
  summary.constraints = size;
  summary.seconds_setup = MPI_Wtime() - begin;
  const StepReport report = solver.solve(Step{1, 0.0, 0.0, 0.0});
  summary.seconds_stepping = MPI_Wtime() - begin - summary.seconds_setup;
  std::optional<ErrorEstimate> error;
  if (report.certified) error = solver.refine();
  vi.accept(solver.solution(), solver.residual());
  summary.steps = 1;
  const bool certifies = solver.certificate().certifies();
  summary.exit = !report.certified ? ExitCode::unsolved : certifies ? ExitCode::done : ExitCode::uncertified;
  summary.status = status_of(report, certifies);
  summary.snes_iterations = report.iterations;
  summary.predictor_hits = report.predicted ? 1 : 0;
  summary.max_residual = report.residual;
  if (error) summary.error_estimate = error->of_largest;
  summary.max_penetration = vi.penetration();
  if (report.certified) ++summary.rungs[static_cast<std::size_t>(report.rung)];
  const Vector forces = duplicate(solver.residual());
  check(VecCopy(solver.residual(), forces.get()));
  vi.unscale(forces.get());
  record(comm, path, line.force, problem, started, report, certifies, solver.solution(), forces.get(), error);
  summary.time_matmult(solver.jacobian());
  summary.mumps_flops = solver.mumps_flops();
  summary.unused_options = report_unused_options(comm);
  summary.seconds_total = MPI_Wtime() - begin;
  summary.write(comm, line.summary);
  if (!report.certified)
    throw Error(ExitCode::unsolved,
                fmt::format("{}: the problem {}. {}he best point is in {}", line.scene,
                            why_unsolved(report, solver.certificate()),
                            report.diagnosis.empty() ? "It may have no solution; t" : "T", path));
  int rank = 0;
  MPI_Comm_rank(comm, &rank);
  if (rank == 0)
    fmt::print("{}: {}certified, worst ratio {:.2g}, {} Newton iterations, {} unknowns\n{}\n",
               printable(path), certifies ? "" : "not ", report.residual, report.iterations, size,
               told(error));
  if (!certifies) throw Error(summary.exit, why_uncertified(solver.certificate()));
  return ExitCode::done;
}

}  // namespace sweepvi::app
