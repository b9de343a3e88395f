#include "app/room.hpp"

#include <fmt/format.h>

#include <limits>

#include "parallel/memory.hpp"
#include "sweepvi/petsc.hpp"

namespace sweepvi::app {

namespace {

// Peak memory was measured (summary's peak_rss_bytes, two steps, one rank) with 1e5 elements of each kind and
// scheme, with 3e5 states in files, and with a dense matrix of 1500 rows. Less a program without data, a
// state took 513 B (bodies without coupling, moreau-jean) to 2260 B (contact, homsp), an entry of a dense
// matrix 95 B.
constexpr double least_per_state = 250.0;
constexpr double least_per_entry = 40.0;

// Of the same runs: 300 B times unknowns and nonzeros of the Jacobian is 0.5 to 2 times what they took.
constexpr double usual_per_number = 300.0;
constexpr double program_itself = 5e7;

struct Size {
  double states = 0.0, entries = 0.0;
  double unknowns = 0.0;  // at most, of a step
};

double entries(const SparseEntries& matrix) {
  return static_cast<double>(matrix.values.size());
}
double entries(const std::optional<SparseEntries>& matrix) {
  return matrix ? entries(*matrix) : 0.0;
}

// Multipliers: one for each output, of which there are no more than states, and one for each constraint of
// degree 0.
Size size_of(const LinearSpec& spec) {
  const auto n = static_cast<double>(spec.A.rows);
  return {n, entries(spec.A) + entries(spec.B) + entries(spec.C) + entries(spec.D),
          2.0 * n + static_cast<double>(spec.C.rows)};
}
Size size_of(const LagrangianSpec& spec) {
  const double states = 2.0 * static_cast<double>(spec.M.rows);
  return {states, entries(spec.M) + entries(spec.K) + entries(spec.C) + entries(spec.H),
          states + 2.0 * static_cast<double>(spec.H.rows)};
}
Size size_of(const SweepingSpec& spec) {
  const auto n = static_cast<double>(spec.u0.size());
  return {n, entries(spec.A) + entries(spec.G), n + (spec.G ? static_cast<double>(spec.G->rows) : 0.0)};
}
Size size_of(const ChainSpec& spec) {
  const double states = static_cast<double>(spec.count) * static_cast<double>(spec.element->states.size());
  return {states, entries(spec.weights), 2.0 * states};
}
Size size_of(const ImpactSpec& /*one oscillator*/) {
  return {};
}

/// available_memory() reads it; here it appears under -help.
PetscErrorCode show_option(MPI_Comm comm) {
  PetscReal gigabytes = 0.0;
  PetscFunctionBeginUser;
  PetscOptionsBegin(comm, nullptr, "sweepvi: memory", "sweepvi");
  PetscCall(PetscOptionsReal("-sweepvi_memory_limit",
                             "Memory of a node that this run may take [GB]; 0: what is there", "Memory",
                             gigabytes, &gigabytes, nullptr));
  PetscOptionsEnd();
  PetscFunctionReturn(static_cast<PetscErrorCode>(0));  // an enumeration in newer PETSc
}

}  // namespace

void require_room(MPI_Comm comm, const Scene& scene) {
  check_options(show_option(comm));
  // Only rank 0 has read matrices; chains every rank knows.
  const Size size = std::visit([](const auto& spec) { return size_of(spec); }, scene.model);
  agreed(comm, [&] {
    constexpr double most = std::numeric_limits<PetscInt>::max();
    if (size.unknowns > most)
      throw InputError(
          fmt::format("{}: the model makes up to {:.0f} unknowns; expected at most {:.0f}, as PETSc counts "
                      "them in {} bits",
                      scene.path, size.unknowns, most, 8 * sizeof(PetscInt)));
  });
  double bytes = least_per_state * size.states + least_per_entry * size.entries;  // ranks share them equally
  MPI_Bcast(&bytes, 1, MPI_DOUBLE, 0, comm);
  int ranks = 1;
  MPI_Comm_size(comm, &ranks);
  std::string what = fmt::format("{}: {:.0f} states", scene.path, size.states);
  if (const auto* chain = std::get_if<ChainSpec>(&scene.model))
    what = fmt::format("{}: model.count = {} elements with {} states each", scene.path, chain->count,
                       chain->element->states.size());
  if (size.entries > 0.0) what += fmt::format(" and {:.0f} entries of matrices", size.entries);
  require_memory(comm, bytes / ranks, what + " take");
}

double estimated_memory(int ranks, double unknowns, double jacobian_nonzeros) {
  return ranks * program_itself + usual_per_number * (unknowns + jacobian_nonzeros);
}

}  // namespace sweepvi::app
