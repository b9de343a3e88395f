#pragma once

#include <mpi.h>

#include <cstddef>
#include <vector>

namespace sweepvi {

/// A trajectory in numbers: the polyline through (t_k, x_k). Times do not decrease; a jump is two rows with
/// the same time, or the segment between two rows, whichever the run recorded. Source: Acary & Brogliato
/// (AB), eq. (66)-(67), the filled-in graph.
class Trajectory {
public:
  virtual ~Trajectory() = default;

  /// Every row's time, on every rank.
  const std::vector<double>& t() const { return t_; }
  std::size_t rows() const { return t_.size(); }
  std::size_t components() const { return components_; }

  /// components() numbers, valid until eight other rows of this trajectory have been asked for.
  /// @note Not collective.
  virtual const double* row(std::size_t k) = 0;

protected:
  std::vector<double> t_;
  std::size_t components_ = 0;
};

/// One that is held in memory.
class StoredTrajectory final : public Trajectory {
public:
  /// @param x  row after row
  /// @throws Error (bad_input) if there is no row, sizes disagree, a number is not finite, or a time
  /// decreases
  StoredTrajectory(std::vector<double> t, std::vector<double> x);

  const double* row(std::size_t k) override { return x_.data() + k * components_; }

private:
  std::vector<double> x_;
};

/// The largest absolute value of any entry. Reads every row, each rank its share.
/// @throws Error on every rank, if a row cannot be read
/// @note Collective on comm.
double largest_entry(MPI_Comm comm, Trajectory& trajectory);
/// The same of each component. @note Collective on comm.
std::vector<double> largest_entries(MPI_Comm comm, Trajectory& trajectory);

}  // namespace sweepvi
