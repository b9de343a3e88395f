#include "dvi/moreau_jean.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <utility>

#include "petsc/sparse.hpp"
#include "sweepvi/scheme.hpp"

namespace sweepvi {

Energy summed(MPI_Comm comm, const Energy& mine) {
  double sums[] = {mine.kinetic, mine.potential, mine.dissipated, mine.damping, mine.work, mine.scheme};
  MPI_Allreduce(MPI_IN_PLACE, sums, 6, MPI_DOUBLE, MPI_SUM, comm);
  return {sums[0], sums[1], sums[2], sums[3], sums[4], sums[5]};
}

MoreauJean::MoreauJean(MPI_Comm comm, const MoreauJeanOptions& options, double h, Vec q0, Vec v0)
    : comm_(comm), h_(h), theta_(options.theta), detection_(options.detection) {
  require_weight("theta of moreau-jean", theta_);
  for (Vector* vector : {&q_, &v_, &dq_})
    *vector = duplicate(q0);
  check(VecCopy(q0, q_.get()));
  check(VecCopy(v0, v_.get()));
  check(VecGetLocalSize(q0, &local_));
  x_ = make_vector(comm, 2 * local_);
}

// When somebody asks.
Vec MoreauJean::x() const {
  if (std::exchange(knows_x_, true)) return x_.get();
  const ReadArray q(q_.get());
  const ReadArray v(v_.get());
  const WriteArray x(x_.get());
  std::copy_n(q.data(), local_, x.data());
  std::copy_n(v.data(), local_, x.data() + local_);
  return x_.get();
}

void MoreauJean::find_increment(Vec u) {
  const ReadArray v_new(u);
  const ReadArray v_old(v_.get());
  const WriteArray dq(dq_.get());
  for (PetscInt j = 0; j < local_; ++j)
    dq[j] = h_ * (theta_ * v_new[j] + (1.0 - theta_) * v_old[j]);
}

void MoreauJean::move() {
  check(VecAXPY(q_.get(), 1.0, dq_.get()));
  knows_x_ = false;
}

void MoreauJean::take_velocity(Vec u) {
  check(VecCopy(u, u_.get()));
  if (u_.get() != v_.get()) {
    const ReadArray v_new(u);
    const WriteArray v(v_.get());
    std::copy_n(v_new.data(), local_, v.data());
  }
  knows_x_ = false;
}

void MoreauJean::look_at_contacts(bool at_start) {
  double largest[] = {contacts_.depth(), contacts_.speed()};
  MPI_Allreduce(MPI_IN_PLACE, largest, 2, MPI_DOUBLE, MPI_MAX, comm_);
  depth_ = largest[0];
  if (at_start) start_depth_ = depth_;
  top_speed_ = std::max(top_speed_, largest[1]);
}

// A contact is seen one step late at most, and then no velocity leads further in: ten steps of the fastest
// one leave room for everything that a scheme of order one does.
constexpr double steps_of_room = 10.0;

double MoreauJean::limit() const {
  return start_depth_ + steps_of_room * h_ * top_speed_;
}

// In one step a gap moves by h |g'| at most: from half as deep the limit is not reached.
bool MoreauJean::suspect() const {
  return depth_ > start_depth_ + 0.5 * steps_of_room * h_ * top_speed_;
}

std::string MoreauJean::defect() {
  if (!(depth_ > limit())) return {};
  struct {
    double gap;
    int number;
  } worst = {std::numeric_limits<double>::infinity(), std::numeric_limits<int>::max()};
  for (std::size_t a = 0; a < contacts_.size(); ++a)
    if (contacts_.gap[a] < worst.gap) worst = {contacts_.gap[a], static_cast<int>(scene_number(a))};
  MPI_Allreduce(MPI_IN_PLACE, &worst, 1, MPI_DOUBLE_INT, MPI_MINLOC, comm_);
  return fmt::format(
      "the step would leave constraint {} {:.3g} m behind its wall, more than it started with and {} steps "
      "of the "
      "fastest constraint so far ({:.3g} m/s): no contact goes in so far. Try a smaller time.step",
      worst.number, -worst.gap, steps_of_room, top_speed_);
}

// The unknowns are the velocities, and multipliers if there are any: where the next step starts from.
void MoreauJean::visit(StateVisitor& visitor) {
  visitor.visit("q", Belongs::state, q_.get());
  visitor.visit("v", Belongs::state, v_.get());
  contacts_.visit(visitor);
  {
    int rank = 0;
    MPI_Comm_rank(comm_, &rank);
    std::vector<double> reached = {0.0, 0.0};
    if (rank == 0) reached = {start_depth_, top_speed_};
    visitor.visit("deepest and fastest", Belongs::rank, reached, 2);
    if (visitor.replaces()) {
      MPI_Allreduce(MPI_IN_PLACE, reached.data(), 2, MPI_DOUBLE, MPI_MAX, comm_);
      start_depth_ = reached[0];
      top_speed_ = reached[1];
      look_at_contacts();
    }
  }
  double* parts[] = {&lost_.kinetic, &lost_.potential, &lost_.dissipated,
                     &lost_.damping, &lost_.work,      &lost_.scheme};
  std::vector<double> lost;
  for (const double* part : parts)
    lost.push_back(*part);
  visitor.visit("energy lost", Belongs::rank, lost, std::size(parts));
  for (std::size_t i = 0; i < std::size(parts); ++i)
    *parts[i] = lost[i];
  {
    const WriteArray u(u_.get());
    if (u_.get() != v_.get()) {
      const ReadArray v(v_.get());
      std::copy_n(v.data(), local_, u.data());
    }
    std::vector<double> nu(contacts_.size(), 0.0);
    const bool dual = u.size() > local_;
    if (dual) std::copy_n(u.data() + local_, nu.size(), nu.begin());
    visitor.visit("nu", Belongs::constraint, nu);
    if (dual) std::copy(nu.begin(), nu.end(), u.data() + local_);
  }
  knows_x_ = false;
}

}  // namespace sweepvi
