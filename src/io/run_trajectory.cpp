#include "io/run_trajectory.hpp"

#include <algorithm>
#include <cmath>

#include "io/hdf5_guard.hpp"
#include "sweepvi/error.hpp"

namespace sweepvi {

namespace {

constexpr std::size_t least_block = std::size_t{64} << 10;  // a read of less costs as much
constexpr std::size_t least_slots = 16;  // more than eight: row() says how long a row is valid

hsize_t chunk_rows(hid_t dataset) {
  const Hdf5Properties creation(H5Dget_create_plist(dataset));
  if (H5Pget_layout(creation.get()) != H5D_CHUNKED) return 1;
  hsize_t chunk[2] = {1, 1};
  H5Pget_chunk(creation.get(), 2, chunk);
  return std::max<hsize_t>(chunk[0], 1);
}

}  // namespace

RunTrajectory::RunTrajectory(std::string path, std::string where, Hdf5File file, Hdf5Object rows,
                             std::vector<double> t, const std::vector<std::int64_t>& columns,
                             std::size_t memory)
    : path_(std::move(path)), where_(std::move(where)), file_(std::move(file)), dataset_(std::move(rows)) {
  t_ = std::move(t);
  components_ = columns.size();
  for (const std::int64_t column : columns) {
    const auto c = static_cast<hsize_t>(column);
    if (ranges_.empty() || ranges_.back().first + ranges_.back().count != c) ranges_.push_back({c, 0});
    ++ranges_.back().count;
  }
  const std::size_t row_bytes = components_ * sizeof(double);
  const std::size_t most = std::max<std::size_t>(memory / least_slots / row_bytes, 1);
  const std::size_t least =
      std::max(static_cast<std::size_t>(chunk_rows(dataset_.get())), least_block / row_bytes);
  block_rows_ = std::min({std::max<std::size_t>(least, 1), most, t_.size()});
  most_slots_ = std::max(memory / (block_rows_ * row_bytes), least_slots);
  slot_of_.assign((t_.size() + block_rows_ - 1) / block_rows_, -1);
}

const double* RunTrajectory::row(std::size_t k) {
  const std::size_t block = k / block_rows_;
  const std::int32_t known = slot_of_[block];
  Slot& slot = slots_[known >= 0 ? static_cast<std::size_t>(known) : load(block)];
  slot.used = ++clock_;
  return slot.rows.data() + (k - block * block_rows_) * components_;
}

std::size_t RunTrajectory::load(std::size_t block) {
  std::size_t at = slots_.size();
  if (at < most_slots_) {
    slots_.emplace_back();
  } else {
    const auto oldest = std::min_element(slots_.begin(), slots_.end(),
                                         [](const Slot& p, const Slot& q) { return p.used < q.used; });
    at = static_cast<std::size_t>(oldest - slots_.begin());
    slot_of_[slots_[at].block] = -1;
  }
  slots_[at].block = block;
  read(block, slots_[at].rows);
  slot_of_[block] = static_cast<std::int32_t>(at);
  return at;
}

void RunTrajectory::read(std::size_t block, std::vector<double>& to) const {
  const QuietHdf5 quiet;
  const Hdf5Guard guard(path_);
  const hsize_t first = block * block_rows_, rows = std::min(block_rows_, t_.size() - block * block_rows_);
  const hsize_t width = components_, extent[] = {rows, width};
  to.resize(rows * width);
  const Hdf5Space file(H5Dget_space(dataset_.get())), buffer(H5Screate_simple(2, extent, nullptr));
  hsize_t column = 0;
  for (const Range& range : ranges_) {
    const hsize_t from[] = {first, range.first}, into[] = {0, column}, count[] = {rows, range.count};
    if (H5Sselect_hyperslab(file.get(), H5S_SELECT_SET, from, nullptr, count, nullptr) < 0 ||
        H5Sselect_hyperslab(buffer.get(), H5S_SELECT_SET, into, nullptr, count, nullptr) < 0 ||
        H5Dread(dataset_.get(), H5T_NATIVE_DOUBLE, buffer.get(), file.get(), H5P_DEFAULT, to.data()) < 0)
      throw InputError(where_ + " cannot be read: " + hdf5_reason());
    column += range.count;
  }
  const auto bad = std::find_if_not(to.begin(), to.end(), [](double value) { return std::isfinite(value); });
  if (bad == to.end()) return;
  auto index = static_cast<hsize_t>(bad - to.begin()) % width;
  auto range = ranges_.begin();
  for (; index >= range->count; ++range)
    index -= range->count;
  throw InputError(where_ + " should hold finite numbers, found " + std::to_string(*bad) + " at [" +
                   std::to_string(first + static_cast<hsize_t>(bad - to.begin()) / width) + ", " +
                   std::to_string(range->first + index) + "]");
}

}  // namespace sweepvi
