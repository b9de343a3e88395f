#include "vi/outer_linearisation.hpp"

#include <Eigen/Core>
#include <cmath>
#include <limits>
#include <vector>

#include "parallel/gather.hpp"
#include "petsc/sparse.hpp"
#include "vi/affine_box.hpp"

namespace sweepvi {

namespace {

std::vector<double> values_of(Vec vector) {
  const ReadArray array(vector);
  return {array.data(), array.data() + array.size()};
}

Eigen::VectorXd on_root(MPI_Comm comm, Vec vector) {
  const std::vector<double> all = gather(comm, values_of(vector));
  return Eigen::VectorXd::Map(all.data(), static_cast<Eigen::Index>(all.size()));
}

}  // namespace

const char* name_of(OuterLinearisation::Outcome outcome) {
  switch (outcome) {
    case OuterLinearisation::Outcome::converged:
      return "OUTER_CONVERGED";
    case OuterLinearisation::Outcome::stagnated:
      return "OUTER_STAGNATED";
    case OuterLinearisation::Outcome::limit:
      return "OUTER_ITERATION_LIMIT";
    case OuterLinearisation::Outcome::no_affine_solution:
      return "OUTER_NO_AFFINE_SOLUTION";
    case OuterLinearisation::Outcome::overflow:
      return "OUTER_OVERFLOW";
  }
  return "";
}

OuterLinearisation::OuterLinearisation(Dvi& problem)
    : problem_(problem), jacobian_(problem.create_jacobian()), f_(duplicate(problem.state())) {
  PetscInt size = 0;
  check(VecGetSize(problem.state(), &size));
  if (size > largest)
    throw InputError(
        "-sweepvi_linearisation outer solves its affine VIs by dense pivoting and takes at most " +
        std::to_string(largest) + " unknowns; this problem has " + std::to_string(size));
}

// u := the solution of the VI linearised at u. False if none was found; u is then as before.
bool OuterLinearisation::advance(Vec u, Vec lower, Vec upper) {
  MPI_Comm comm = problem_.comm();
  problem_.residual(u, f_.get());
  problem_.jacobian(u, jacobian_.get());
  const std::vector<Triplet> entries = gather_entries(jacobian_.get());
  const Eigen::VectorXd here = on_root(comm, u);
  AffineBox affine{Eigen::MatrixXd::Zero(here.size(), here.size()), on_root(comm, f_.get()),
                   on_root(comm, lower), on_root(comm, upper)};
  std::vector<double> next;  // empty: none
  if (here.size() > 0) {     // rank 0
    for (const Triplet& entry : entries)
      affine.M(entry.row, entry.column) = entry.value;
    affine.q -= affine.M * here;
    const AffineBoxSolution solution = solve_affine_box(affine);
    if (solution.solved) next.assign(solution.u.begin(), solution.u.end());
  }
  broadcast(comm, next);
  if (next.empty()) return false;
  PetscInt first = 0;
  check(VecGetOwnershipRange(u, &first, nullptr));
  const WriteArray values(u);
  for (PetscInt i = 0; i < values.size(); ++i)
    values[i] = next[static_cast<std::size_t>(first) + static_cast<std::size_t>(i)];
  return true;
}

OuterLinearisation::Result OuterLinearisation::iterate(Vec u, Vec lower, Vec upper, double target,
                                                       double stagnation, const Ratio& ratio) {
  Result result;
  double reached = ratio(u);
  while (result.iterations < most_iterations) {
    if (reached <= target) {
      result.outcome = Outcome::converged;
      return result;
    }
    if (!advance(u, lower, upper)) {
      result.outcome = Outcome::no_affine_solution;
      return result;
    }
    ++result.iterations;
    const double previous = reached;
    reached = ratio(u);
    if (!std::isfinite(reached)) {
      result.outcome = Outcome::overflow;
      return result;
    }
    if (reached > target && reached <= stagnation && reached > 0.9 * previous) {
      result.outcome = Outcome::stagnated;
      return result;
    }
  }
  result.outcome = reached <= target ? Outcome::converged : Outcome::limit;
  return result;
}

}  // namespace sweepvi
