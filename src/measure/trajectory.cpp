#include "sweepvi/trajectory.hpp"

#include <algorithm>
#include <cmath>

#include "measure/slab.hpp"
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

std::vector<double> largest_entries(MPI_Comm comm, Trajectory& trajectory) {
  std::vector<double> largest(trajectory.components(), 0.0);
  agreed(comm, [&] {
    const Slab mine(comm, trajectory.rows());
    for (std::size_t k = mine.first; k < mine.last; ++k) {
      const double* x = trajectory.row(k);
      for (std::size_t i = 0; i < largest.size(); ++i)
        largest[i] = std::max(largest[i], std::abs(x[i]));
    }
  });
  MPI_Allreduce(MPI_IN_PLACE, largest.data(), static_cast<int>(largest.size()), MPI_DOUBLE, MPI_MAX, comm);
  return largest;
}

double largest_entry(MPI_Comm comm, Trajectory& trajectory) {
  const std::vector<double> largest = largest_entries(comm, trajectory);
  return largest.empty() ? 0.0 : *std::max_element(largest.begin(), largest.end());
}

}  // namespace sweepvi
