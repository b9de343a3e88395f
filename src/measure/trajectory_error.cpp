#include "sweepvi/trajectory_error.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <string>

#include "measure/mean_norm.hpp"
#include "measure/slab.hpp"
#include "sweepvi/error.hpp"

namespace sweepvi {

namespace {

/// The last row before t and the first after it; at the ends of the trajectory the outermost one.
TimeSpan between_rows(const Trajectory& graph, const TimeSpan& span) {
  const std::vector<double>& t = graph.t();
  const auto first = std::lower_bound(t.begin(), t.end(), span.first);
  const auto last = std::upper_bound(t.begin(), t.end(), span.last);
  return {first == t.begin() ? t.front() : *(first - 1), last == t.end() ? t.back() : *last};
}

/// What is left out, as disjoint spans in order, cut to [start, end].
std::vector<TimeSpan> near_jumps(const Trajectory& a, const Trajectory& b, const std::vector<TimeSpan>& jumps,
                                 double start, double end) {
  std::vector<TimeSpan> wide;
  for (const TimeSpan& jump : jumps) {
    const TimeSpan in_a = between_rows(a, jump), in_b = between_rows(b, jump);
    const TimeSpan span{std::max(std::min(in_a.first, in_b.first), start),
                        std::min(std::max(in_a.last, in_b.last), end)};
    if (span.first <= span.last) wide.push_back(span);
  }
  std::sort(wide.begin(), wide.end(), [](const TimeSpan& p, const TimeSpan& q) { return p.first < q.first; });
  std::vector<TimeSpan> disjoint;
  for (const TimeSpan& span : wide) {
    if (disjoint.empty() || span.first > disjoint.back().last)
      disjoint.push_back(span);
    else
      disjoint.back().last = std::max(disjoint.back().last, span.last);
  }
  return disjoint;
}

/// A trajectory as time goes on.
class Walker {
public:
  /// At its segment around t, or after t where rows share that time.
  Walker(Trajectory& graph, double t) : graph_(graph) {
    const auto after = std::upper_bound(graph.t().begin(), graph.t().end(), t) - graph.t().begin();
    k_ = static_cast<std::size_t>(std::max<std::ptrdiff_t>(after, 1)) - 1;
  }
  bool at_end() const { return k_ + 1 == graph_.rows(); }
  double next() const { return graph_.t()[k_ + 1]; }
  void move_to(double t) {
    while (!at_end() && next() <= t)
      ++k_;
  }
  /// Adds sign x(t), t in this segment.
  void add(double t, double sign, std::vector<double>& to) {
    const double* x = graph_.row(k_);
    const double t0 = graph_.t()[k_];
    const double part = at_end() || t <= t0 ? 0.0 : (t - t0) / (next() - t0);
    if (part == 0.0) {
      for (std::size_t i = 0; i < to.size(); ++i)
        to[i] += sign * x[i];
      return;
    }
    const double* y = graph_.row(k_ + 1);
    for (std::size_t i = 0; i < to.size(); ++i)
      to[i] += sign * ((1.0 - part) * x[i] + part * y[i]);
  }

private:
  Trajectory& graph_;
  std::size_t k_;
};

double norm(const std::vector<double>& x) {
  return std::sqrt(std::inner_product(x.begin(), x.end(), x.begin(), 0.0));
}

/// The difference, from one row of either trajectory to the next.
class Difference {
public:
  Difference(Trajectory& a, Trajectory& b, double start)
      : a_(a, start), b_(b, start), begin_(a.components()), end_(a.components()) {}

  /// To the next row, but not beyond `last`.
  double next(double last) const { return std::min({a_.next(), b_.next(), last}); }

  /// Takes in the time from s to t, of which both trajectories are linear functions.
  void over(double s, double t) {
    find(s, begin_);
    find(t, end_);
    a_.move_to(t);
    b_.move_to(t);
  }
  const std::vector<double>& at_begin() const { return begin_; }
  const std::vector<double>& at_end() const { return end_; }
  double norm_at_begin() const { return norm(begin_); }
  double norm_at_end() const { return norm(end_); }
  double mean() const { return mean_norm(begin_.data(), end_.data(), begin_.size()); }

  double norm_at(double t) {
    find(t, begin_);
    return norm(begin_);
  }

private:
  void find(double t, std::vector<double>& to) {
    std::fill(to.begin(), to.end(), 0.0);
    a_.add(t, 1.0, to);
    b_.add(t, -1.0, to);
  }

  Walker a_, b_;
  std::vector<double> begin_, end_;
};

void take_larger(const std::vector<double>& values, std::vector<double>& largest) {
  for (std::size_t i = 0; i < values.size(); ++i)
    largest[i] = std::max(largest[i], std::abs(values[i]));
}

/// From where to where in time this rank works: equally many rows of the finer trajectory.
TimeSpan share_of_time(MPI_Comm comm, const Trajectory& a, const Trajectory& b, double start, double end) {
  const std::vector<double>& fine = a.rows() >= b.rows() ? a.t() : b.t();
  const auto first =
      static_cast<std::size_t>(std::upper_bound(fine.begin(), fine.end(), start) - fine.begin());
  const auto last = static_cast<std::size_t>(std::lower_bound(fine.begin(), fine.end(), end) - fine.begin());
  const std::size_t inside = std::max(first, last) - first;
  const Slab mine(comm, inside + 1);  // times before fine[first], fine[first + 1], ..., end
  const auto border = [&](std::size_t i) { return i == 0 ? start : i > inside ? end : fine[first + i - 1]; };
  return {border(mine.first), border(mine.last)};
}

}  // namespace

TrajectoryError trajectory_error(MPI_Comm comm, Trajectory& a, Trajectory& b,
                                 const std::vector<TimeSpan>& jumps) {
  if (a.components() != b.components())
    throw InputError("trajectories of " + std::to_string(a.components()) + " and " +
                     std::to_string(b.components()) + " components have no difference");
  TrajectoryError error;
  error.start = std::max(a.t().front(), b.t().front());
  error.end = std::min(a.t().back(), b.t().back());
  if (error.start > error.end) throw InputError("the trajectories have no time in common");
  const std::vector<TimeSpan> left_out = near_jumps(a, b, jumps, error.start, error.end);
  if (error.end > error.start)
    for (const TimeSpan& span : left_out)
      error.left_out += (span.last - span.first) / (error.end - error.start);
  error.final = Difference(a, b, error.end).norm_at(error.end);

  struct {
    double value;
    int rank;
  } worst{-1.0, 0};
  MPI_Comm_rank(comm, &worst.rank);
  const auto raise = [&](double value, double t) {
    if (value <= worst.value) return;
    worst.value = value;
    error.sup_t = t;
  };
  std::vector<double> apart(a.components(), 0.0);  // each component's largest difference
  const TimeSpan mine = share_of_time(comm, a, b, error.start, error.end);
  Difference difference(a, b, mine.first);
  auto jump = left_out.begin();
  for (double s = mine.first; s < mine.last;) {
    const double t = difference.next(mine.last);
    difference.over(s, t);
    error.l1 += (t - s) * difference.mean();
    while (jump != left_out.end() && jump->last <= s)
      ++jump;
    if (jump == left_out.end() || t <= jump->first) {  // a norm is convex: largest at an end
      raise(difference.norm_at_begin(), s);
      raise(difference.norm_at_end(), t);
      take_larger(difference.at_begin(), apart);
      take_larger(difference.at_end(), apart);
    }
    s = t;
  }
  if (error.start == error.end && left_out.empty()) {
    raise(error.final, error.end);
    Difference at_end(a, b, error.end);
    at_end.over(error.end, error.end);
    take_larger(at_end.at_end(), apart);
  }
  MPI_Allreduce(MPI_IN_PLACE, &error.l1, 1, MPI_DOUBLE, MPI_SUM, comm);
  MPI_Allreduce(MPI_IN_PLACE, &worst, 1, MPI_DOUBLE_INT, MPI_MAXLOC, comm);
  MPI_Bcast(&error.sup_t, 1, MPI_DOUBLE, worst.rank, comm);
  if (worst.value < 0.0) return error;
  error.sup = worst.value;
  MPI_Allreduce(MPI_IN_PLACE, apart.data(), static_cast<int>(apart.size()), MPI_DOUBLE, MPI_MAX, comm);
  std::vector<double> size = largest_entries(comm, a);
  take_larger(largest_entries(comm, b), size);
  error.relative = 0.0;
  for (std::size_t i = 0; i < apart.size(); ++i) {
    if (!(apart[i] > *error.relative * size[i])) continue;
    error.relative = apart[i] / size[i];
    error.relative_component = i;
  }
  return error;
}

}  // namespace sweepvi
