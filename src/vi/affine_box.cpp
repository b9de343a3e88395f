#include "vi/affine_box.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "vi/affine_box_parts.hpp"
#include "vi/lemke.hpp"

namespace sweepvi {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

/// The linear complementarity problem that a box VI is. For each unknown with bounds the distance z >= 0 from
/// one of them; for those with two the multiplier y >= 0 of the other; for unknowns without bounds that were
/// not eliminated u = z - y. Rows:
///
///     S z + r + y >= 0 for z,    cap - z >= 0 for y,    or    F >= 0 for z, -F >= 0 for y.
///
/// Only rows of z, and both of the last kind, are covered by the artificial variable. If all have caps there
/// is no ray. Along one, z would stay, as it is bounded. If z_0 grows, all rows of z are positive at last,
/// hence z = 0, hence y = 0: the ray we came from. If it stays and some y_i grows, row i is positive, hence
/// z_i = 0, its cap is slack, hence y_i = 0.
struct Complementarity {
  MatrixXd M;
  VectorXd q, cover;
  Indices unknowns;       // of the box, one for each z
  Indices second;         // those z that have a y, in the order of the y
  VectorXd flip, origin;  // of each z: u = origin + flip z
};

// In [0, 1), by the engine alone: distributions differ from library to library.
double uniform(std::mt19937& engine) {
  return static_cast<double>(engine()) / 4294967296.0;
}

Complementarity formulate(const AffineBox& box, const MatrixXd& S, const VectorXd& r, const Indices& unknowns,
                          const VectorXd& cover) {
  Complementarity lcp;
  lcp.unknowns = unknowns;
  const auto m = static_cast<Index>(unknowns.size());
  lcp.flip = VectorXd::Ones(m);
  lcp.origin = VectorXd::Zero(m);
  for (Index k = 0; k < m; ++k) {
    const Index i = unknowns[static_cast<std::size_t>(k)];
    if (has_lower(box, i)) {
      lcp.origin[k] = box.lower[i];
    } else if (has_upper(box, i)) {
      lcp.flip[k] = -1.0;
      lcp.origin[k] = box.upper[i];
    }
    if (has_lower(box, i) == has_upper(box, i)) lcp.second.push_back(k);
  }
  const auto pairs = static_cast<Index>(lcp.second.size());
  lcp.M = MatrixXd::Zero(m + pairs, m + pairs);
  lcp.q = VectorXd::Zero(m + pairs);
  lcp.cover = VectorXd::Zero(m + pairs);
  lcp.M.topLeftCorner(m, m) = lcp.flip.asDiagonal() * S * lcp.flip.asDiagonal();
  lcp.q.head(m) = lcp.flip.cwiseProduct(r + S * lcp.origin);
  for (Index k = 0; k < m; ++k)
    lcp.cover[k] = cover[unknowns[static_cast<std::size_t>(k)]];
  for (Index c = 0; c < pairs; ++c) {
    const Index k = lcp.second[static_cast<std::size_t>(c)];
    const Index i = unknowns[static_cast<std::size_t>(k)];
    if (has_lower(box, i)) {
      lcp.M(k, m + c) = 1.0;
      lcp.M(m + c, k) = -1.0;
      lcp.q[m + c] = box.upper[i] - box.lower[i];
    } else {
      lcp.M.col(m + c) = -lcp.M.col(k);
      lcp.M.row(m + c) = -lcp.M.row(k);
      lcp.M(m + c, m + c) = lcp.M(k, k);
      lcp.q[m + c] = -lcp.q[k];
      lcp.cover[m + c] = lcp.cover[k];
    }
  }
  return lcp;
}

/// A block's problem, its scaling, and what is known of its unknowns before pivoting.
class Block {
public:
  Block(const AffineBox& given, const VectorXd& cover) : given_(given), scaled_(given) {
    const AffineBox& box = scaled_.box;
    const Index n = box.q.size();
    fixed_ = VectorXd::Zero(n);
    for (Index i = 0; i < n; ++i) {
      if (!has_lower(box, i) && !has_upper(box, i)) {
        open_.push_back(i);
      } else if (box.lower[i] == box.upper[i]) {
        fixed_[i] = box.lower[i];  // no unknown at all
      } else {
        bounded_.push_back(i);
      }
    }
    eliminate(cover);
  }

  /// @param perturbation  of q, relative to its largest entry: where many bases tie up to rounding, only this
  ///                      keeps the method from going round in circles
  AffineBoxSolution solve(double perturbation) const {
    AffineBoxSolution solution;
    if (!lcp_.M.allFinite() || !lcp_.q.allFinite()) return solution;
    VectorXd q = lcp_.q;
    std::mt19937 engine(1);
    if (perturbation > 0.0)
      for (double& value : q)
        value += perturbation * uniform(engine);
    Lemke lemke(lcp_.M, q, lcp_.cover);
    const LemkeEnd end = lemke.solve();
    solution.pivots = lemke.pivots();
    solution.ray = end == LemkeEnd::ray;
    solution.solved = end == LemkeEnd::solution;
    if (solution.solved) solution.u = point(lemke);
    return solution;
  }

private:
  // Without the open unknowns: their rows say what they are. Unless those are singular.
  void eliminate(const VectorXd& cover) {
    const AffineBox& box = scaled_.box;
    const VectorXd q = box.q + box.M * fixed_;
    MatrixXd S = box.M(bounded_, bounded_);
    VectorXd r = q(bounded_);
    if (!open_.empty()) {
      const Eigen::FullPivLU<MatrixXd> factor(box.M(open_, open_));
      if (factor.isInvertible() && !bounded_.empty()) {
        const MatrixXd rows = box.M(bounded_, open_);
        S -= rows * factor.solve(box.M(open_, bounded_).eval());
        r -= rows * factor.solve(q(open_).eval());
      } else if (!factor.isInvertible()) {
        bounded_.insert(bounded_.end(), open_.begin(), open_.end());
        open_.clear();
        S = box.M(bounded_, bounded_);
        r = q(bounded_);
      }
    }
    lcp_ = formulate(box, S, r, bounded_, cover);
    const double largest = lcp_.q.size() > 0 ? lcp_.q.cwiseAbs().maxCoeff() : 0.0;
    if (largest > 0.0 && std::isfinite(largest))
      lcp_.q = scaled_by(lcp_.q, -std::ilogb(largest));  // only the basis found is used
  }

  // From the sets found, by a fresh factorization: free of what the pivots have rounded.
  VectorXd point(const Lemke& lemke) const {
    const AffineBox& box = scaled_.box;
    const auto m = static_cast<Index>(bounded_.size());
    std::vector<char> at_upper(static_cast<std::size_t>(m), 0);
    for (std::size_t c = 0; c < lcp_.second.size(); ++c)
      at_upper[static_cast<std::size_t>(lcp_.second[c])] = lemke.basic(m + static_cast<Index>(c)) ? 1 : 0;
    VectorXd u = fixed_;
    Indices inside = open_;
    for (Index k = 0; k < m; ++k) {
      const Index i = bounded_[static_cast<std::size_t>(k)];
      const bool open = !has_lower(box, i) && !has_upper(box, i);
      if (!open && at_upper[static_cast<std::size_t>(k)] != 0) {
        u[i] = box.upper[i];
      } else if (open || lemke.basic(k)) {
        inside.push_back(i);
      } else {
        u[i] = lcp_.origin[k];
      }
    }
    solve_inside(box, inside, u);
    return scaled_.unscaled(u).cwiseMax(given_.lower).cwiseMin(given_.upper);
  }

  const AffineBox& given_;
  Equilibrated scaled_;
  VectorXd fixed_;          // their values; 0 elsewhere
  Indices open_, bounded_;  // eliminated; unknowns of the complementarity problem
  Complementarity lcp_;
};

AffineBoxSolution solve_block(const AffineBox& box, const VectorXd& cover) {
  const Block block(box, cover);
  AffineBoxSolution best;
  double reached = std::numeric_limits<double>::infinity();
  int pivots = 0;
  for (const double perturbation : {0.0, 1e-10, 1e-7}) {
    const AffineBoxSolution found = block.solve(perturbation);
    pivots += found.pivots;
    if (found.ray && !best.solved) best = found;
    if (found.ray) break;
    const double worst = found.solved ? violation(box, found.u) : std::numeric_limits<double>::infinity();
    if (worst < reached) {
      best = found;
      reached = worst;
    }
    if (reached <= solved_to) break;
  }
  best.pivots = pivots;
  return best;
}

}  // namespace

AffineBoxSolution solve_affine_box(const AffineBox& box) {
  AffineBoxSolution whole;
  if (!box.M.allFinite() || !box.q.allFinite()) return whole;
  const VectorXd ones = VectorXd::Ones(box.q.size());
  const std::vector<Indices> blocks = triangular_blocks(box.M);
  if (blocks.size() > 1) {
    whole.u = VectorXd::Zero(box.q.size());
    whole.solved = true;
    for (const Indices& block : blocks) {
      const AffineBoxSolution part = solve_block(part_of(box, block, whole.u), ones);
      whole.pivots += part.pivots;
      whole.solved = part.solved;
      if (!part.solved) break;
      whole.u(block) = part.u;
    }
    if (whole.solved) return whole;  // else a block may have had another solution, which suits those after it
  }
  AffineBoxSolution solution = solve_block(box, ones);
  solution.pivots += whole.pivots;
  return solution;
}

AffineBoxSolution search_affine_box(const AffineBox& box) {
  constexpr int starts = 20;
  AffineBoxSolution solution;
  if (!box.M.allFinite() || !box.q.allFinite()) return solution;
  const Index n = box.q.size();
  std::mt19937 engine(1);
  for (int start = 0; start < starts; ++start) {
    VectorXd cover(n);
    for (double& value : cover)
      value = std::exp(6.0 * uniform(engine) - 3.0);
    const AffineBoxSolution found = solve_block(box, cover);
    solution.pivots += found.pivots;
    if (found.solved && violation(box, found.u) <= solved_to) {
      solution.solved = true;
      solution.u = found.u;
      return solution;
    }
  }
  const AffineBoxSolution found = enumerate_affine_box(box);
  solution.solved = found.solved;
  solution.u = found.u;
  return solution;
}

}  // namespace sweepvi
