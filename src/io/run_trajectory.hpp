#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "io/hdf5_handle.hpp"
#include "sweepvi/trajectory.hpp"

namespace sweepvi {

/// Columns of a matrix in an HDF5 file, row after row of which is read when it is asked for: in blocks, the
/// latest of which stay in memory.
class RunTrajectory final : public Trajectory {
public:
  /// @param rows     a dataset of shape t.size() x any
  /// @param columns  ascending
  /// @param memory   for blocks [B]; sixteen of a row each are kept in any case
  /// @param where    what messages call the dataset
  RunTrajectory(std::string path, std::string where, Hdf5File file, Hdf5Object rows, std::vector<double> t,
                const std::vector<std::int64_t>& columns, std::size_t memory = std::size_t{128} << 20);

  /// @throws Error (bad_input) if an entry is not finite, or cannot be read
  const double* row(std::size_t k) override;

private:
  struct Range {  // columns side by side
    hsize_t first, count;
  };
  struct Slot {
    std::size_t block = 0;
    std::uint64_t used = 0;  // when it was last asked for
    std::vector<double> rows;
  };
  std::size_t load(std::size_t block);
  void read(std::size_t block, std::vector<double>& to) const;

  std::string path_, where_;
  Hdf5File file_;
  Hdf5Object dataset_;
  std::vector<Range> ranges_;
  std::size_t block_rows_ = 1;
  std::size_t most_slots_ = 16;
  std::vector<Slot> slots_;
  std::vector<std::int32_t> slot_of_;  // of each block; -1: not in memory
  std::uint64_t clock_ = 0;
};

}  // namespace sweepvi
