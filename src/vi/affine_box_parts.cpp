#include "vi/affine_box_parts.hpp"

#include <Eigen/LU>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <limits>

#include "vi/certificate.hpp"

namespace sweepvi {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

Eigen::VectorXd scaled_by(const Eigen::VectorXd& v, int exponent) {
  return v.unaryExpr([exponent](double value) { return std::ldexp(value, exponent); });
}

// Sweeps of dividing rows and columns by the roots of their largest entries (D. Ruiz, 2001).
Equilibrated::Equilibrated(const AffineBox& given) : box(given), columns(VectorXd::Ones(given.q.size())) {
  constexpr int sweeps = 8;
  const Index n = given.q.size();
  const auto root = [](double largest) {
    return largest > 0.0 ? std::ldexp(1.0, -static_cast<int>(std::lround(0.5 * std::log2(largest)))) : 1.0;
  };
  for (int sweep = 0; sweep < sweeps; ++sweep) {
    VectorXd row(n), column(n);
    for (Index i = 0; i < n; ++i) {
      row[i] = root(box.M.row(i).cwiseAbs().maxCoeff());
      column[i] = root(box.M.col(i).cwiseAbs().maxCoeff());
    }
    if ((row.array() == 1.0).all() && (column.array() == 1.0).all()) break;
    box.M = row.asDiagonal() * box.M * column.asDiagonal();
    box.q = box.q.cwiseProduct(row);
    columns = columns.cwiseProduct(column);
  }
  for (Index i = 0; i < n; ++i) {
    if (has_lower(given, i)) box.lower[i] = given.lower[i] / columns[i];
    if (has_upper(given, i)) box.upper[i] = given.upper[i] / columns[i];
  }
}

namespace {

/// Tarjan's algorithm, without recursion.
class Blocks {
public:
  explicit Blocks(const MatrixXd& M) : M_(M), state_(static_cast<std::size_t>(M.rows())) {
    for (Index i = 0; i < M.rows(); ++i)
      if (state_[static_cast<std::size_t>(i)].number < 0) visit(i);
  }
  std::vector<Indices> found;

private:
  struct State {
    Index number = -1, lowest = -1, next = 0;
    bool open = false;
  };
  State& of(Index i) { return state_[static_cast<std::size_t>(i)]; }
  void enter(Index i) {
    of(i).number = of(i).lowest = counter_++;
    of(i).open = true;
    path_.push_back(i);
    open_.push_back(i);
  }
  void visit(Index first) {
    enter(first);
    while (!path_.empty()) {
      const Index i = path_.back();
      Index j = of(i).next;
      while (j < M_.cols() && (j == i || M_(i, j) == 0.0))
        ++j;
      of(i).next = j + 1;
      if (j < M_.cols()) {
        if (of(j).number < 0) {
          enter(j);
        } else if (of(j).open) {
          of(i).lowest = std::min(of(i).lowest, of(j).number);
        }
        continue;
      }
      path_.pop_back();
      if (!path_.empty()) of(path_.back()).lowest = std::min(of(path_.back()).lowest, of(i).lowest);
      if (of(i).lowest == of(i).number) close(i);
    }
  }
  void close(Index root) {
    Indices block;
    do {
      block.push_back(open_.back());
      of(open_.back()).open = false;
      open_.pop_back();
    } while (block.back() != root);
    found.push_back(std::move(block));
  }

  const MatrixXd& M_;
  std::vector<State> state_;
  Index counter_ = 0;
  Indices path_, open_;
};

}  // namespace

std::vector<Indices> triangular_blocks(const MatrixXd& M) {
  return Blocks(M).found;
}

AffineBox part_of(const AffineBox& box, const Indices& unknowns, const VectorXd& u) {
  VectorXd others = u;
  others(unknowns).setZero();
  return {box.M(unknowns, unknowns), box.q(unknowns) + box.M(unknowns, Eigen::all) * others,
          box.lower(unknowns), box.upper(unknowns)};
}

void solve_inside(const AffineBox& box, const Indices& inside, VectorXd& u) {
  constexpr int refinements = 5;
  if (inside.empty()) return;
  using Extended = Eigen::Matrix<long double, Eigen::Dynamic, 1>;
  using ExtendedRows = Eigen::Matrix<long double, Eigen::Dynamic, Eigen::Dynamic>;
  const MatrixXd matrix = box.M(inside, inside);
  const ExtendedRows rows = box.M(inside, Eigen::all).template cast<long double>();
  const Extended q = box.q(inside).template cast<long double>();
  const auto residual = [&]() -> VectorXd { return (rows * u.cast<long double>() + q).cast<double>(); };
  u(inside).setZero();
  const VectorXd start = -residual();
  const auto improve = [&](const auto& factor) {
    const VectorXd first = factor.solve(start);
    u(inside) = first;
    double previous = std::numeric_limits<double>::infinity();
    for (int k = 0; k < refinements; ++k) {
      const VectorXd step = factor.solve(residual());
      const double size = step.cwiseAbs().maxCoeff();
      if (!(size < 0.5 * previous)) break;
      u(inside) -= step;
      previous = size;
    }
  };
  const Extended terms_of_q = q.cwiseAbs();
  const auto solved = [&] {
    const VectorXd terms = (rows.cwiseAbs() * u.cast<long double>().cwiseAbs() + terms_of_q).cast<double>();
    const VectorXd left = residual();
    for (Index i = 0; i < left.size(); ++i)
      if (!(std::abs(left[i]) <= solved_to * terms[i])) return false;
    return true;
  };
  improve(Eigen::PartialPivLU<MatrixXd>(matrix));
  if (!solved()) improve(Eigen::CompleteOrthogonalDecomposition<MatrixXd>(matrix));
}

double violation(const AffineBox& box, const VectorXd& u) {
  const VectorXd F = box.M * u + box.q;
  const VectorXd terms = box.M.cwiseAbs() * u.cwiseAbs() + box.q.cwiseAbs();
  double worst = 0.0;
  for (Index i = 0; i < u.size(); ++i) {
    const double natural = std::abs(natural_residual(u[i], F[i], box.lower[i], box.upper[i]));
    if (natural == 0.0) continue;
    worst = std::isfinite(natural) ? std::max(worst, natural / terms[i])
                                   : std::numeric_limits<double>::infinity();
  }
  return worst;
}

}  // namespace sweepvi
