// Where the rows of a TableFile are on disk, for those who come after a crash.
//
// Why the marked bytes stay what they are, whatever interrupts the program later: HDF5 neither moves a chunk
// that has no filter nor uses its space for anything else while the dataset grows. Later rows of the same
// chunk are written beside the marked ones, or together with them in the same place, so that each marked byte
// is only ever overwritten by itself. Closing, cutting off unused space and renaming touch no chunk.

#include <unistd.h>

#include <filesystem>

#include "io/table_file.hpp"
#include "io/table_layout.hpp"

namespace sweepvi {

TableMark TableFile::mark() {
  flush();
  reserve(0);  // MPI-IO has cut off what was reserved
  TableMark mark;
  mark.file = std::filesystem::path(partial_).filename().string();
  mark.rows = written_;
  mark.events = events_written_;
  together([&] {
    if (rank_ != 0) return;
    if (!is_ours()) refuse_stranger();
    for (std::size_t i = 0; i < fields_.size(); ++i)
      mark.fields.push_back(
          locate(columns_[i], fields_[i].name, entry_bytes(fields_[i]), shape(written_, fields_[i])));
    if (options_.events)
      mark.fields.push_back(locate(event_list_, "/events", sizeof(Event), {events_written_}));
  });
  make_durable(fdatasync);  // HDF5 has done this for several ranks
  // Every rank has the checksums of what it wrote itself.
  std::vector<std::uint64_t> sums;
  for (const Column& column : columns_)
    sums.push_back(column.checksum);
  if (options_.events) sums.push_back(event_list_.checksum);
  MPI_Allreduce(MPI_IN_PLACE, sums.data(), int(sums.size()), MPI_UINT64_T, MPI_SUM, comm_);
  for (std::size_t i = 0; i < mark.fields.size(); ++i)
    mark.fields[i].checksum = sums[i];
  return mark;
}

/// Asks for the chunks that are new since the last time. They are on disk, because the file has been flushed.
TableMark::Field TableFile::locate(Stored& stored, const std::string& name, std::uint64_t entry,
                                   const std::vector<hsize_t>& shape) const {
  const std::uint64_t slabs = (shape[0] + stored.chunk[0] - 1) / stored.chunk[0];
  while (stored.addresses.size() < slabs * stored.slab_chunks) {
    std::vector<hsize_t> corner(shape.size(), 0);
    corner[0] = stored.addresses.size() / stored.slab_chunks * stored.chunk[0];
    if (corner.size() > 1) corner[1] = stored.addresses.size() % stored.slab_chunks * stored.chunk[1];
    unsigned filters = 0;
    haddr_t address = HADDR_UNDEF;
    hsize_t size = 0;
    sure(H5Dget_chunk_info_by_coord(stored.dataset.get(), corner.data(), &filters, &address, &size),
         "find the rows of " + name);
    if (address == HADDR_UNDEF || size * stored.slab_chunks != stored.slab_bytes)
      throw Error(ExitCode::internal, "TableFile: a chunk of " + name + " is not where it should be");
    stored.addresses.push_back(address);
  }
  return {.name = name,
          .entry_bytes = entry,
          .extents = {shape.begin() + 1, shape.end()},
          .chunk = {stored.chunk.begin(), stored.chunk.end()},
          .addresses = stored.addresses};
}

}  // namespace sweepvi
