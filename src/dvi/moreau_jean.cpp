#include "dvi/moreau_jean.hpp"

#include <algorithm>
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

void MoreauJean::advance(Vec u) {
  check(VecCopy(u, u_.get()));
  check(VecAXPY(q_.get(), 1.0, dq_.get()));
  if (u_.get() != v_.get()) {
    const ReadArray v_new(u);
    const WriteArray v(v_.get());
    std::copy_n(v_new.data(), local_, v.data());
  }
  knows_x_ = false;
}

// The unknowns are the velocities, and multipliers if there are any: where the next step starts from.
void MoreauJean::visit(StateVisitor& visitor) {
  visitor.visit("q", Belongs::state, q_.get());
  visitor.visit("v", Belongs::state, v_.get());
  contacts_.visit(visitor);
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
