#include "vi/outer_linearisation.hpp"

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <utility>
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

OuterLinearisation::OuterLinearisation(Dvi& problem)
    : problem_(problem), jacobian_(problem.create_jacobian()), f_(duplicate(problem.state())) {
  PetscInt size = 0;
  check(VecGetSize(problem.state(), &size));
  if (size > largest)
    throw InputError(
        "-sweepvi_linearisation outer solves its affine VIs by dense pivoting and takes at most " +
        std::to_string(largest) + " unknowns; this problem has " + std::to_string(size));
}

// u := the solution of the VI linearised at u. If none was found u is as before.
OuterLinearisation::Affine OuterLinearisation::advance(Vec u, Vec lower, Vec upper, AffineMethod method) {
  MPI_Comm comm = problem_.comm();
  problem_.residual(u, f_.get());
  problem_.jacobian(u, jacobian_.get());
  const std::vector<Triplet> entries = gather_entries(jacobian_.get());
  const Eigen::VectorXd here = on_root(comm, u);
  AffineBox affine{Eigen::MatrixXd::Zero(here.size(), here.size()), on_root(comm, f_.get()),
                   on_root(comm, lower), on_root(comm, upper)};
  std::vector<double> next;  // empty: none
  std::array<int, 2> flags = {0, 0};
  if (here.size() > 0) {  // rank 0
    for (const Triplet& entry : entries)
      affine.M(entry.row, entry.column) = entry.value;
    affine.q -= affine.M * here;
    const AffineBoxSolution solution =
        method == AffineMethod::lemke ? solve_affine_box(affine) : search_affine_box(affine);
    if (solution.solved) next.assign(solution.u.begin(), solution.u.end());
    const bool same = last_.rows() == affine.M.rows() && affine.M == last_;
    flags = {solution.ray ? 1 : 0, same ? 1 : 0};
    last_ = std::move(affine.M);
  }
  broadcast(comm, next);
  MPI_Bcast(flags.data(), 2, MPI_INT, 0, comm);
  repeated_ = flags[1] != 0;
  if (next.empty()) return flags[0] != 0 ? Affine::ray : Affine::none;
  PetscInt first = 0;
  check(VecGetOwnershipRange(u, &first, nullptr));
  const WriteArray values(u);
  for (PetscInt i = 0; i < values.size(); ++i)
    values[i] = next[static_cast<std::size_t>(first) + static_cast<std::size_t>(i)];
  return Affine::solved;
}

OuterLinearisation::Result OuterLinearisation::iterate(Vec u, Vec lower, Vec upper,
                                                       const CertificateOptions& options, const Ratio& ratio,
                                                       AffineMethod method) {
  Result result;
  double reached = ratio(u);
  while (reached > options.target) {
    if (result.iterations == most_iterations) {
      result.reason = "OUTER_ITERATION_LIMIT";
      return result;
    }
    const Affine outcome = advance(u, lower, upper, method);
    if (outcome != Affine::solved) {
      result.reason =
          outcome == Affine::ray ? "no solution found: secondary ray" : "OUTER_NO_AFFINE_SOLUTION";
      return result;
    }
    ++result.iterations;
    const double previous = reached;
    reached = ratio(u);
    if (!std::isfinite(reached)) {
      result.reason = "OUTER_OVERFLOW";
      return result;
    }
    const bool improved = reached <= 0.9 * previous;
    if (reached > options.target && !improved &&
        ((result.iterations > 1 && repeated_) || reached <= options.stagnation)) {
      result.reason = "OUTER_STAGNATED";  // the matrix repeats: the same VI again and again
      return result;
    }
  }
  result.reason = "OUTER_CONVERGED";
  return result;
}

}  // namespace sweepvi
