#include "dvi/level_dvi.hpp"

#include <fmt/format.h>

#include <array>

namespace sweepvi {

bool LevelDvi::admissible(Vec) {
  if (!two_sided_) return true;
  int rank = 0;
  MPI_Comm_rank(comm(), &rank);
  int owner = crowded_.wmax > 0.0 ? rank : -1;
  MPI_Allreduce(MPI_IN_PLACE, &owner, 1, MPI_INT, MPI_MAX, comm());
  if (owner < 0) return true;
  std::array<double, 3> numbers = {static_cast<double>(crowded_.constraint), crowded_.wmax,
                                   crowded_.known_to};
  MPI_Bcast(numbers.data(), 3, MPI_DOUBLE, owner, comm());
  refusal_ = fmt::format(
      "constraint {:.0f} stands at one of its walls, which are {:.3g} apart, but its outputs are only known "
      "up to "
      "{:.3g} in this step: at which one cannot be told. Use a larger wmax, or an equation in its place",
      numbers[0], numbers[1], numbers[2]);
  return false;
}

}  // namespace sweepvi
