#include "io/dealt.hpp"

#include "parallel/gather.hpp"

namespace sweepvi {

// Number by number of each entity, so that messages keep below 2^31 entries.
std::vector<double> bring_together(MPI_Comm comm, const Places& places, std::span<const double> mine,
                                   std::size_t width) {
  const std::vector<PetscInt> order = gather(comm, places.mine);
  int rank = 0;
  MPI_Comm_rank(comm, &rank);
  std::vector<double> all(rank == 0 ? static_cast<std::size_t>(places.total) * width : 0, 0.0);
  std::vector<double> column(places.mine.size());
  for (std::size_t k = 0; k < width; ++k) {
    for (std::size_t i = 0; i < column.size(); ++i)
      column[i] = mine[i * width + k];
    const std::vector<double> gathered = gather(comm, column);
    for (std::size_t i = 0; i < gathered.size(); ++i)
      if (order[i] >= 0) all[static_cast<std::size_t>(order[i]) * width + k] = gathered[i];
  }
  return all;
}

void deal_out(MPI_Comm comm, const Places& places, const std::vector<double>& all, std::size_t width,
              std::span<double> mine) {
  const std::vector<PetscInt> order = gather(comm, places.mine);
  const std::vector<int> counts = gather(comm, std::vector<int>{static_cast<int>(places.mine.size())});
  std::vector<double> column(order.size());
  for (std::size_t k = 0; k < width; ++k) {
    for (std::size_t i = 0; i < order.size(); ++i)
      column[i] = order[i] >= 0 ? all[static_cast<std::size_t>(order[i]) * width + k] : 0.0;
    const std::vector<double> own = scatter(comm, column, counts);
    for (std::size_t i = 0; i < own.size(); ++i)
      if (places.mine[i] >= 0) mine[i * width + k] = own[i];
  }
}

}  // namespace sweepvi
