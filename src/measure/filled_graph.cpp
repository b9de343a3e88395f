#include "sweepvi/filled_graph.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "measure/segment.hpp"
#include "measure/slab.hpp"
#include "parallel/gather.hpp"
#include "sweepvi/error.hpp"

namespace sweepvi {

namespace {

/// How long the graph is up to each of its rows. @note Collective.
std::vector<double> lengths(MPI_Comm comm, Trajectory& graph) {
  std::vector<double> length(graph.rows(), 0.0);
  const Slab mine(comm, graph.rows() - 1);
  for (std::size_t k = mine.first; k < mine.last; ++k)
    length[k + 1] =
        distance({graph.t()[k], graph.row(k)}, {graph.t()[k + 1], graph.row(k + 1)}, graph.components());
  MPI_Allreduce(MPI_IN_PLACE, length.data(), mpi_count(static_cast<std::int64_t>(length.size())), MPI_DOUBLE,
                MPI_SUM, comm);
  for (std::size_t k = 1; k < length.size(); ++k)
    length[k] += length[k - 1];
  return length;
}

/// Looks for the points of one graph that are nearest to points of another.
class Target {
public:
  Target(MPI_Comm comm, Trajectory& graph) : graph_(graph), length_(lengths(comm, graph)) {}

  struct Near {
    std::size_t segment;
    double distance;
  };

  double to_segment(const GraphPoint& p, std::size_t k) {
    if (graph_.rows() == 1) return distance(p, {graph_.t()[0], graph_.row(0)}, graph_.components());
    return distance_to_segment(p, {graph_.t()[k], graph_.row(k)}, {graph_.t()[k + 1], graph_.row(k + 1)},
                               graph_.components());
  }

  /// A segment at p's time, or the one next to it.
  std::size_t at(double t) const {
    const auto after = std::upper_bound(graph_.t().begin(), graph_.t().end(), t) - graph_.t().begin();
    return std::min(static_cast<std::size_t>(std::max<std::ptrdiff_t>(after - 1, 0)), last());
  }

  /// The nearest segment, or any that is `enough` or less away.
  Near nearest(const GraphPoint& p, std::size_t hint, double enough) {
    Near best{hint, to_segment(p, hint)};
    if (best.distance <= enough) return best;
    const std::size_t start = at(p.t);
    if (start != hint) improve(best, p, start);
    // Outwards on both sides by turns: where one of them finds something near, the other need not go on.
    std::size_t up = start, down = start;
    bool upwards = true, downwards = true;
    while ((upwards || downwards) && best.distance > enough) {
      if (upwards && (upwards = next_up(p, up, best.distance))) up_ = improve(best, p, up);
      if (downwards && (downwards = next_down(p, down, best.distance))) down_ = improve(best, p, down);
    }
    up_ = down_ = 0.0;
    return best;
  }

private:
  std::size_t last() const { return std::max<std::size_t>(graph_.rows(), 2) - 2; }

  double improve(Near& best, const GraphPoint& p, std::size_t k) {
    const double found = to_segment(p, k);
    if (found < best.distance) best = {k, found};
    return found;
  }

  // The next segment that may be nearer than `best`. The segment k is up_ away; points whose way along the
  // graph from it is shorter than up_ - best are not nearer than best.
  bool next_up(const GraphPoint& p, std::size_t& k, double best) const {
    if (k >= last()) return false;
    std::size_t next = k + 1;
    if (const double skip = up_ - best; skip > 0.0) {
      const auto from = length_.begin() + static_cast<std::ptrdiff_t>(k) + 1;
      next =
          static_cast<std::size_t>(gallop(from, length_.end(), length_[k + 1] + skip) - length_.begin()) - 1;
    }
    k = std::max(next, k + 1);
    return k <= last() && graph_.t()[k] - p.t < best;
  }
  bool next_down(const GraphPoint& p, std::size_t& k, double best) const {
    if (k == 0) return false;
    std::size_t next = k - 1;
    if (const double skip = down_ - best; skip > 0.0) {
      const auto from = std::make_reverse_iterator(length_.begin() + static_cast<std::ptrdiff_t>(k) + 1);
      const auto found = gallop_down(from, length_.rend(), length_[k] - skip);
      if (found == length_.rend()) return false;
      next = static_cast<std::size_t>(length_.rend() - found) - 1;
    }
    k = std::min(next, k - 1);
    return p.t - graph_.t()[k + 1] < best;
  }

  // First element above (below) the value in a sorted range; quick where it is near the beginning.
  template <class Iterator>
  static Iterator gallop(Iterator first, Iterator end, double value) {
    std::ptrdiff_t step = 1;
    while (step < end - first && first[step] <= value) {
      first += step;
      step *= 2;
    }
    return std::upper_bound(first, first + std::min(step, end - first), value);
  }
  template <class Iterator>
  static Iterator gallop_down(Iterator first, Iterator end, double value) {
    std::ptrdiff_t step = 1;
    while (step < end - first && first[step] >= value) {
      first += step;
      step *= 2;
    }
    return std::upper_bound(first, first + std::min(step, end - first), value, std::greater<>());
  }

  Trajectory& graph_;
  std::vector<double> length_;
  double up_ = 0.0, down_ = 0.0;  // distances of the segments last looked at
};

/// sup over one graph of the distance from the other, as this rank's part of it knows.
class Excess {
public:
  Excess(MPI_Comm comm, Trajectory& source, Trajectory& target, double tolerance)
      : comm_(comm),
        source_(source),
        target_(comm, target),
        tolerance_(tolerance),
        mine_(comm, std::max<std::size_t>(source.rows(), 2) - 1) {}

  /// Raises `worst` to the largest distance found anywhere. @note Collective.
  void raise(GraphDistance& worst, bool first) {
    worst_ = worst.value;
    // A few rows first: where the worst is nearly known, little remains to be looked at closely.
    const std::size_t rows = source_.rows(),
                      stride = std::max<std::size_t>(1, (mine_.last - mine_.first) / 1024);
    std::size_t hint = 0;
    for (std::size_t k = mine_.first; k < std::min(mine_.last, rows); k += stride)
      hint = look({source_.t()[k], source_.row(k)}, hint);
    share();
    if (rows == 1 && mine_.first == 0) look({source_.t()[0], source_.row(0)}, 0);
    for (std::size_t k = mine_.first; k < mine_.last && rows > 1; ++k) {
      const GraphPoint a{source_.t()[k], source_.row(k)}, b{source_.t()[k + 1], source_.row(k + 1)};
      const std::size_t near = look(a, k == mine_.first ? target_.at(a.t) : hint);
      // The next row's own near segment is often this one.
      hint = target_.to_segment(b, near) <= worst_ ? near : look(b, near);
      if (hint != near) piece(a, near, b, hint, 0);
    }
    share();
    if (worst_ > worst.value) worst = {worst_, tolerance_, where_, first};
  }

private:
  /// A segment that is no farther from p than `worst_`, which is raised where there is none.
  std::size_t look(const GraphPoint& p, std::size_t hint) {
    const Target::Near near = target_.nearest(p, hint, worst_);
    if (near.distance > worst_) {
      worst_ = near.distance;
      where_ = p.t;
    }
    return near.segment;
  }

  // The piece from a to b of a segment; its ends are no farther than `worst_` from those segments.
  void piece(const GraphPoint& a, std::size_t near_a, const GraphPoint& b, std::size_t near_b,
             std::size_t depth) {
    const double enough = worst_ + tolerance_;
    if (near_a == near_b || target_.to_segment(b, near_a) <= enough ||
        target_.to_segment(a, near_b) <= enough)
      return;
    const std::size_t n = source_.components();
    if (distance(a, b, n) <= 2.0 * tolerance_ || depth == 200) return;
    if (middle_.size() <= depth) middle_.emplace_back(n);
    std::vector<double>& x = middle_[depth];
    for (std::size_t i = 0; i < n; ++i)
      x[i] = 0.5 * a.x[i] + 0.5 * b.x[i];
    const GraphPoint m{0.5 * a.t + 0.5 * b.t, x.data()};
    const std::size_t near = look(m, near_a);
    piece(a, near_a, m, near, depth + 1);
    piece({m.t, middle_[depth].data()}, near, b, near_b, depth + 1);
  }

  void share() {
    struct {
      double value;
      int rank;
    } most{worst_, 0};
    MPI_Comm_rank(comm_, &most.rank);
    MPI_Allreduce(MPI_IN_PLACE, &most, 1, MPI_DOUBLE_INT, MPI_MAXLOC, comm_);
    worst_ = most.value;
    MPI_Bcast(&where_, 1, MPI_DOUBLE, most.rank, comm_);
  }

  MPI_Comm comm_;
  Trajectory& source_;
  Target target_;
  double tolerance_;
  Slab mine_;
  double worst_ = 0.0, where_ = 0.0;
  std::vector<std::vector<double>> middle_;  // by depth
};

}  // namespace

GraphDistance filled_graph_distance(MPI_Comm comm, Trajectory& a, Trajectory& b, double tolerance) {
  if (a.components() != b.components())
    throw InputError("trajectories of " + std::to_string(a.components()) + " and " +
                     std::to_string(b.components()) + " components have no distance");
  if (!(tolerance > 0.0)) throw InputError("the tolerance of a distance must be positive");
  GraphDistance worst;
  worst.tolerance = tolerance;
  Excess(comm, a, b, tolerance).raise(worst, true);
  Excess(comm, b, a, tolerance).raise(worst, false);
  return worst;
}

}  // namespace sweepvi
