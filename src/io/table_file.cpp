// How a TableFile writes its rows and events.

#include "io/table_file.hpp"

#include <algorithm>
#include <functional>
#include <numeric>
#include <tuple>

#include "io/checksum.hpp"
#include "io/mpi_io_failure.hpp"
#include "io/table_layout.hpp"

namespace sweepvi {
// A rank that throws must not leave the others waiting in the next collective call. So only the last HDF5
// call of one `together` may fail on a single rank; calls that only change metadata in memory fail alike
// everywhere.
void TableFile::together(const std::function<void()>& work) const {
  const QuietHdf5 quiet;
  agreed(comm_, work);
}

void TableFile::writing(const std::function<void()>& work) {
  try {
    together(work);
  } catch (...) {
    damaged_ = file_damaged_ = true;
    throw;
  }
}

void TableFile::fail(std::string_view doing) const {
  throw Error(ExitCode::output, "cannot " + std::string(doing) + " in " + partial_ + ": " + hdf5_reason() +
                                    "; check the space and permissions there, or write elsewhere (-o)");
}

void TableFile::commit_row() {
  ++buffered_;
  // Where room is short it may be there again by now.
  if (buffered_ == capacity_ || (short_ && buffered_ + rows_of_a_step >= room_)) write_rows();
}

void TableFile::flush() {
  write_rows();
  writing([&] {
    const EndAtMpiIoFailure end(comm_, partial_);
    sure(H5Fflush(file_.get(), H5F_SCOPE_GLOBAL), "flush");
  });
}

void TableFile::extend(hsize_t rows, hsize_t events) {
  for (std::size_t i = 0; i < fields_.size(); ++i)
    sure(H5Dset_extent(columns_[i].dataset.get(), shape(rows, fields_[i]).data()),
         "extend " + fields_[i].name);
  if (event_list_.dataset) sure(H5Dset_extent(event_list_.dataset.get(), &events), "extend /events");
}

void TableFile::write_rows() {
  if (!file_ || file_damaged_)
    throw Error(ExitCode::internal, "TableFile: " + path_ + " is written to after it was closed or failed");
  const hsize_t events = gather_events();
  if (buffered_ == 0 && events == 0) return;
  reserve(events);
  writing([&] { extend(written_ + buffered_, events_written_ + events); });
  if (events > 0) writing([&] { write_events(events); });
  if (buffered_ == 0) return;
  for (std::size_t i = 0; i < fields_.size(); ++i) {
    writing([&] { write_column(i); });
    add_checksums(i);
  }
  written_ += buffered_;
  room_ -= std::min(room_, buffered_);
  buffered_ = 0;
}

void TableFile::write_column(std::size_t field) {
  const FieldSpec& spec = fields_[field];
  const Column& column = columns_[field];
  const std::string doing = "write " + spec.name;
  std::vector<hsize_t> start(spec.extents.size() + 1, 0), count = shape(buffered_, spec);
  start[0] = written_;
  if (spec.extents.empty()) {
    if (rank_ != 0) count[0] = 0;
  } else {
    start[1] = spec.first;
    count[1] = spec.count;
  }
  // Memory has the rank and shape of the block in the file: HDF5 is fast when both match.
  const Hdf5Space file(H5Dget_space(column.dataset.get()));
  const Hdf5Space memory(H5Screate_simple(int(count.size()), count.data(), nullptr));
  // Not `sure`: a rank has to reach H5Dwrite, which then complains itself.
  select_block(file.get(), memory.get(), start.data(), count);
  sure(H5Dwrite(column.dataset.get(), entry_type(spec), memory.get(), file.get(), transfer_.get(),
                column.buffer.data()),
       doing);
}

void TableFile::add_checksums(std::size_t field) {
  const FieldSpec& spec = fields_[field];
  Column& column = columns_[field];
  if (spec.extents.empty() && rank_ != 0) return;
  const std::uint64_t bytes = entry_bytes(spec), row = product(spec.extents);
  const std::uint64_t first = spec.extents.empty() ? 0 : row / spec.extents[0] * spec.first;
  for (hsize_t i = 0; i < buffered_; ++i)
    column.checksum += checksum(column.buffer.data() + i * column.row_bytes, column.slice, bytes,
                                (written_ + i) * row + first);
}

hsize_t TableFile::gather_events() {
  if (!options_.events) return 0;
  int ranks = 0;
  MPI_Comm_size(comm_, &ranks);
  std::vector<int> counts(std::size_t(ranks), 0), offsets(std::size_t(ranks), 0);
  const int mine = int(events_.size());
  MPI_Allgather(&mine, 1, MPI_INT, counts.data(), 1, MPI_INT, comm_);
  std::exclusive_scan(counts.begin(), counts.end(), offsets.begin(), 0);
  const auto total = hsize_t(offsets.back()) + hsize_t(counts.back());
  if (total == 0) return 0;

  agreed(comm_, [&] { all_events_.resize(rank_ == 0 ? total : 0); });
  MPI_Datatype event = MPI_DATATYPE_NULL;
  MPI_Type_contiguous(sizeof(Event), MPI_BYTE, &event);
  MPI_Type_commit(&event);
  MPI_Gatherv(events_.data(), mine, event, all_events_.data(), counts.data(), offsets.data(), event, 0,
              comm_);
  MPI_Type_free(&event);
  std::stable_sort(all_events_.begin(), all_events_.end(), [](const Event& a, const Event& b) {
    return std::tie(a.t, a.constraint, a.level) < std::tie(b.t, b.constraint, b.level);
  });
  return total;
}

void TableFile::write_events(hsize_t total) {
  const std::vector<hsize_t> count{rank_ == 0 ? total : 0};
  const Hdf5Space file(H5Dget_space(event_list_.dataset.get()));
  const Hdf5Space memory(H5Screate_simple(1, count.data(), nullptr));
  select_block(file.get(), memory.get(), &events_written_, count);
  sure(H5Dwrite(event_list_.dataset.get(), event_type_.get(), memory.get(), file.get(), transfer_.get(),
                all_events_.data()),
       "write /events");
  event_list_.checksum += checksum(reinterpret_cast<const std::byte*>(all_events_.data()), count[0],
                                   sizeof(Event), events_written_);
  events_written_ += total;
  events_.clear();
}

}  // namespace sweepvi
