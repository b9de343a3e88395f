#include "vi/judged_point.hpp"

#include <algorithm>

#include "petsc/sparse.hpp"

namespace sweepvi {

void JudgedPoint::Seen::take(Vec now) {
  vector = now;
  state = state_of(now);
}

bool JudgedPoint::Seen::untouched() const {
  return state_of(vector) == state;
}

void JudgedPoint::set(Vec point, Vec f, double ratio, bool inside) {
  point_.take(point);
  twin_.take(point);
  f_.take(f);
  ratio_ = ratio;
  inside_ = inside;
  projection_ = false;
}

bool JudgedPoint::same_here(Vec u) const {
  if (!f_.untouched()) return false;
  if (u == twin_.vector) {
    if (twin_.untouched()) return true;
    // A projection of what is inside its bounds changes nothing.
    if (projection_ && state_of(u) == twin_.state + 1) return true;
  }
  if (!point_.untouched()) return false;
  const ReadArray now(u);
  const ReadArray then(point_.vector);
  return std::equal(now.data(), now.data() + now.size(), then.data());
}

bool JudgedPoint::is(Vec u) {
  if (ratio_ < 0.0) return false;
  int same = same_here(u) ? 1 : 0;
  MPI_Allreduce(MPI_IN_PLACE, &same, 1, MPI_INT, MPI_LAND, comm_);
  projection_ = false;
  if (same == 0) return false;
  if (u == point_.vector) point_.take(u);
  twin_.take(u);
  return true;
}

}  // namespace sweepvi
