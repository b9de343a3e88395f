#include "app/summary.hpp"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <system_error>

#include "io/output_file.hpp"
#include "parallel/gather.hpp"
#include "petsc/event_counts.hpp"
#include "petsc/sparse.hpp"

namespace sweepvi::app {

namespace {

// JSON has no infinity; a run without steps has no ratio.
nlohmann::json number(double value) {
  return std::isfinite(value) ? nlohmann::json(value) : nlohmann::json(nullptr);
}

}  // namespace

std::int64_t linear_solves() {
  return event_count("KSPSolve");
}

std::int64_t factorizations() {
  return event_count("MatLUFactorNum") + event_count("MatCholFctrNum") + event_count("MatILUFactorNum");
}

std::int64_t peak_rss_bytes(MPI_Comm comm) {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  std::int64_t bytes = static_cast<std::int64_t>(usage.ru_maxrss) * 1024;
  MPI_Allreduce(MPI_IN_PLACE, &bytes, 1, MPI_INT64_T, MPI_MAX, comm);
  return bytes;
}

namespace {

/// What can be known before anything is computed. @throws Error (output)
void check_target(const std::string& path, const OutputTarget& target, bool overwrite) {
  namespace fs = std::filesystem;
  std::error_code status;
  if (fs::is_directory(target.path, status))
    throw Error(ExitCode::output, path + " is a folder; name a file");
  if (target.kind == OutputTarget::Kind::descriptor) return;
  if (target.kind == OutputTarget::Kind::stream) {
    if (access(target.path.c_str(), W_OK) != 0)
      throw Error(ExitCode::output, path + " cannot be written: " + std::strerror(errno));
    return;
  }
  if (!overwrite && fs::exists(target.path, status))
    throw Error(ExitCode::output, path + " exists; give another name, or --force to replace it");
  fs::path folder = target.path.parent_path();
  if (folder.empty()) folder = ".";
  if (!fs::is_directory(folder, status))
    throw Error(ExitCode::output,
                path + " cannot be written: there is no folder " + folder.string() + "; make it first");
  if (access(folder.c_str(), W_OK) != 0)
    throw Error(ExitCode::output, path + " cannot be written: no permission in " + folder.string());
}

OutputTarget target_of(const std::string& path) {
  try {
    return output_target(path);
  } catch (const std::system_error& error) {
    throw Error(ExitCode::output, path + " cannot be written: " + error.code().message());
  }
}

}  // namespace

void check_writable(MPI_Comm comm, const std::string& path, bool overwrite) {
  int rank = 0;
  MPI_Comm_rank(comm, &rank);
  agreed(comm, [&] {
    if (rank == 0) check_target(path, target_of(path), overwrite);
  });
}

std::string table_path(MPI_Comm comm, const std::string& path) {
  int rank = 0;
  MPI_Comm_rank(comm, &rank);
  std::vector<char> name;
  agreed(comm, [&] {
    if (rank != 0) return;
    const OutputTarget target = target_of(path);
    if (target.kind != OutputTarget::Kind::regular)
      throw Error(ExitCode::output,
                  path +
                      " is a device, a pipe or an open file, and HDF5 needs a regular file: "
                      "choose another name (-o)");
    const std::string followed = target.path.string();
    name.assign(followed.begin(), followed.end());
  });
  broadcast(comm, name);
  return {name.begin(), name.end()};
}

void Summary::count_jacobian(Mat jacobian) {
  MatInfo info;
  check(MatGetInfo(jacobian, MAT_GLOBAL_SUM, &info));
  jacobian_nonzeros = static_cast<std::int64_t>(info.nz_used);
  PetscInt size = 0;
  check(MatGetSize(jacobian, &size, nullptr));
  unknowns = size;
}

void Summary::describe(StepSolver& solver) {
  count_jacobian(solver.jacobian());
  SNESType type = nullptr;
  check(SNESGetType(solver.snes(), &type));
  snes_type = type;
  predictor = solver.predictor();
}

void Summary::time_matmult(Mat jacobian) {
  Vector x;
  Vector y;
  check(MatCreateVecs(jacobian, x.put(), y.put()));
  check(VecSet(x.get(), 1.0));
  const MPI_Comm comm = PetscObjectComm(reinterpret_cast<PetscObject>(jacobian));
  std::vector<double> samples;
  for (int i = 0; i < 12; ++i) {
    MPI_Barrier(comm);
    double seconds = MPI_Wtime();
    check(MatMult(jacobian, x.get(), y.get()));
    seconds = MPI_Wtime() - seconds;
    MPI_Allreduce(MPI_IN_PLACE, &seconds, 1, MPI_DOUBLE, MPI_MAX, comm);
    if (i >= 2) samples.push_back(seconds);  // the first ones warm the caches
  }
  std::sort(samples.begin(), samples.end());
  matmult_seconds = samples[samples.size() / 2];
}

std::string Summary::text(MPI_Comm comm) const {
  int ranks = 1;
  MPI_Comm_size(comm, &ranks);
  const double per_step = steps > 0 ? seconds_stepping / static_cast<double>(steps) : 0.0;
  nlohmann::ordered_json json;
  json["exit"] = static_cast<int>(exit);
  json["status"] = status;
  json["steps"] = steps;
  json["seconds_total"] = seconds_total;
  json["seconds_setup"] = seconds_setup;
  json["seconds_stepping"] = seconds_stepping;
  json["seconds_per_step"] = per_step;
  json["matmult_seconds"] = matmult_seconds;
  json["matmults_per_step"] = number(per_step / matmult_seconds);
  json["ranks"] = ranks;
  json["unknowns"] = unknowns;
  json["constraints"] = constraints;
  json["jacobian_nonzeros"] = jacobian_nonzeros;
  json["edge_cut"] = edge_cut;
  json["snes_type"] = snes_type;
  json["predictor"] = predictor;
  json["snes_iterations"] = snes_iterations;
  json["predictor_hits"] = predictor_hits;
  json["factorizations"] = earlier_factorizations + factorizations();
  json["linear_solves"] = earlier_linear_solves + linear_solves();
  json["mumps_flops"] = mumps_flops;
  json["active_changes"] = active_changes;
  for (std::size_t i = 0; i < rungs.size(); ++i)
    json["rungs"][StepSolver::rung_names[i]] = rungs[i];
  json["notes"] = nlohmann::ordered_json::array();
  for (const Note& note : notes)
    json["notes"].push_back({{"kind", note.kind}, {"count", note.count}, {"text", note.text}});
  if (hybrid)
    json["hybrid"] = {{"expansions", hybrid->expansions},
                      {"coefficients", hybrid->coefficients},
                      {"events", hybrid->events},
                      {"resets", hybrid->resets},
                      {"closed", hybrid->closed},
                      {"error", number(hybrid->error)},
                      {"relative_error", number(hybrid->relative_error)},
                      {"steps", hybrid->closed},  // a contact closed at once is a step that takes no time
                      {"seconds_stepped", 0.0}};
  json["max_residual"] = number(max_residual);
  json["max_penetration"] = number(max_penetration);
  if (error_estimate) json["error_estimate"] = number(*error_estimate);
  json["peak_rss_bytes"] = peak_rss_bytes(comm);
  json["unused_options"] = unused_options;
  return json.dump(2) + "\n";
}

std::pair<std::vector<std::int64_t>, std::vector<double>> Summary::to_go_on(MPI_Comm comm) const {
  std::int64_t events[] = {factorizations(), linear_solves()};
  MPI_Bcast(events, 2, MPI_INT64_T, 0, comm);
  std::vector<std::int64_t> counts = {snes_iterations,
                                      predictor_hits,
                                      active_changes,
                                      earlier_factorizations + events[0],
                                      earlier_linear_solves + events[1],
                                      most_parts};
  counts.insert(counts.end(), rungs.begin(), rungs.end());
  return {counts, {max_residual, max_penetration, seconds_stepping}};
}

bool Summary::fits(const std::vector<std::int64_t>& counts, const std::vector<double>& measures) {
  return counts.size() == 6 + StepSolver::Rungs{}.size() && measures.size() == 3;
}

void Summary::go_on_from(const std::vector<std::int64_t>& counts, const std::vector<double>& measures) {
  snes_iterations = counts[0];
  predictor_hits = counts[1];
  active_changes = counts[2];
  earlier_factorizations = counts[3];
  earlier_linear_solves = counts[4];
  most_parts = counts[5];
  std::copy(counts.begin() + 6, counts.end(), rungs.begin());
  max_residual = measures[0];
  max_penetration = measures[1];
  seconds_stepping = measures[2];
}

void Summary::write(MPI_Comm comm, const std::optional<std::string>& path) const {
  if (path) write_text(comm, *path, text(comm));
}

void write_text(MPI_Comm comm, const std::string& path, const std::string& text) {
  int rank = 0;
  MPI_Comm_rank(comm, &rank);
  agreed(comm, [&] {
    if (rank != 0) return;
    try {
      write_output(path, text);
    } catch (const std::system_error& error) {
      throw Error(ExitCode::output, path + " could not be written: " + error.code().message());
    }
  });
}

}  // namespace sweepvi::app
