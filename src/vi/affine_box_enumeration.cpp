#include <Eigen/LU>
#include <cmath>

#include "vi/affine_box_parts.hpp"

namespace sweepvi {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double most_choices = 16384.0;

enum class Place : char { inside, lower, upper };

/// The next way to say which unknowns are where; false after the last.
bool next_choice(const AffineBox& box, std::vector<Place>& places) {
  for (std::size_t k = 0; k < places.size(); ++k) {
    const auto i = static_cast<Index>(k);
    if (places[k] == Place::inside && has_lower(box, i)) {
      places[k] = Place::lower;
      return true;
    }
    if (places[k] != Place::upper && has_upper(box, i)) {
      places[k] = Place::upper;
      return true;
    }
    places[k] = Place::inside;
  }
  return false;
}

/// A point of the polyhedron of a choice whose system is singular: u between the bounds where inside, w >= 0
/// or <= 0 at a bound,  M u + q - w = 0: bounded least squares, a VI with a semidefinite matrix.
void solve_singular(const AffineBox& box, const std::vector<Place>& places, VectorXd& u) {
  const Index n = box.q.size();
  MatrixXd A(n, n);
  AffineBox least{MatrixXd(), VectorXd(), box.lower, box.upper};
  VectorXd known = VectorXd::Zero(n);
  for (Index i = 0; i < n; ++i) {
    const Place place = places[static_cast<std::size_t>(i)];
    if (place == Place::inside) {
      A.col(i) = box.M.col(i);
      continue;
    }
    A.col(i) = -VectorXd::Unit(n, i);
    known[i] = place == Place::lower ? box.lower[i] : box.upper[i];
    least.lower[i] = place == Place::lower ? 0.0 : -HUGE_VAL;
    least.upper[i] = place == Place::lower ? HUGE_VAL : 0.0;
  }
  const VectorXd right = box.q + box.M * known;
  least.M = A.transpose() * A;
  least.q = A.transpose() * right;
  const AffineBoxSolution found = solve_affine_box(least);
  u = known;
  if (!found.solved) return;
  for (Index i = 0; i < n; ++i)
    if (places[static_cast<std::size_t>(i)] == Place::inside) u[i] = found.u[i];
}

}  // namespace

AffineBoxSolution enumerate_affine_box(const AffineBox& box) {
  AffineBoxSolution best;
  const Index n = box.q.size();
  double choices = 1.0;
  for (Index i = 0; i < n; ++i)
    choices *= 1.0 + (has_lower(box, i) ? 1.0 : 0.0) + (has_upper(box, i) ? 1.0 : 0.0);
  if (choices > most_choices) return best;
  double reached = solved_to;
  std::vector<Place> places(static_cast<std::size_t>(n), Place::inside);
  do {
    VectorXd u = VectorXd::Zero(n);
    Indices inside;
    for (Index i = 0; i < n; ++i) {
      const Place place = places[static_cast<std::size_t>(i)];
      if (place == Place::inside) inside.push_back(i);
      if (place == Place::lower) u[i] = box.lower[i];
      if (place == Place::upper) u[i] = box.upper[i];
    }
    if (!inside.empty() && !Eigen::FullPivLU<MatrixXd>(box.M(inside, inside)).isInvertible()) {
      solve_singular(box, places, u);
    } else {
      solve_inside(box, inside, u);
    }
    u = u.cwiseMax(box.lower).cwiseMin(box.upper);
    const double worst = violation(box, u);
    if (worst > reached) continue;
    reached = worst;
    best.solved = true;
    best.u = u;
    if (worst <= 1e-15) return best;
  } while (next_choice(box, places));
  return best;
}

}  // namespace sweepvi
