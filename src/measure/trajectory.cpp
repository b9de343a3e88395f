#include "sweepvi/trajectory.hpp"

#include <algorithm>
#include <cmath>

#include "sweepvi/error.hpp"

namespace sweepvi {

StoredTrajectory::StoredTrajectory(std::vector<double> t, std::vector<double> x) : x_(std::move(x)) {
  t_ = std::move(t);
  if (t_.empty()) throw InputError("a trajectory without rows has no graph");
  if (x_.empty() || x_.size() % t_.size() != 0) throw InputError("the rows of a trajectory differ in length");
  components_ = x_.size() / t_.size();
  const auto finite = [](double value) { return std::isfinite(value); };
  if (!std::all_of(t_.begin(), t_.end(), finite) || !std::all_of(x_.begin(), x_.end(), finite))
    throw InputError("a trajectory has an entry that is not a finite number");
  if (!std::is_sorted(t_.begin(), t_.end())) throw InputError("the times of a trajectory decrease");
}

}  // namespace sweepvi
