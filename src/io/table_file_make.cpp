// What a TableFile has besides rows: the file itself, its datasets, attributes and lists.

#include <fcntl.h>
#include <hdf5_hl.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

#include "io/hdf5_attribute.hpp"
#include "io/mpi_io_failure.hpp"
#include "io/table_file.hpp"
#include "io/table_layout.hpp"

namespace sweepvi {
namespace {

constexpr std::size_t names_limit = 60 << 10;  // an attribute holds 64 KiB, its header included

bool describe(hid_t dataset, const std::string& units, const std::string& description,
              const std::vector<std::string>& names) {
  // In the file each name takes 16 bytes in the attribute, and its text elsewhere; text counts here too, so
  // that nobody's header gets heavier than the limit.
  std::size_t bytes = 0;
  for (const std::string& name : names)
    bytes += 16 + name.size();
  return write_attribute(dataset, "units", units) && write_attribute(dataset, "description", description) &&
         (names.empty() || bytes > names_limit || write_attribute(dataset, "names", names));
}

/// Properties for a dataset whose every entry gets written by us, so that HDF5 need not fill it first.
Hdf5Properties unfilled(std::span<const hsize_t> chunk = {}) {
  Hdf5Properties properties(H5Pcreate(H5P_DATASET_CREATE));
  bool good = properties && H5Pset_fill_time(properties.get(), H5D_FILL_TIME_NEVER) >= 0 &&
              // Ranks would note different seconds.
              H5Pset_obj_track_times(properties.get(), false) >= 0;
  if (!chunk.empty()) good = good && H5Pset_chunk(properties.get(), int(chunk.size()), chunk.data()) >= 0;
  return good ? std::move(properties) : Hdf5Properties();
}

Hdf5Properties with_groups() {
  Hdf5Properties properties(H5Pcreate(H5P_LINK_CREATE));
  H5Pset_create_intermediate_group(properties.get(), 1);
  return properties;
}

Hdf5Type make_event_type() {
  Hdf5Type kind(H5Tenum_create(H5T_STD_I32LE));
  const auto impact = std::int32_t(Event::Kind::impact), liftoff = std::int32_t(Event::Kind::liftoff);
  Hdf5Type type(H5Tcreate(H5T_COMPOUND, sizeof(Event)));
  const bool good = H5Tenum_insert(kind.get(), "impact", &impact) >= 0 &&
                    H5Tenum_insert(kind.get(), "liftoff", &liftoff) >= 0 &&
                    H5Tinsert(type.get(), "t", HOFFSET(Event, t), H5T_IEEE_F64LE) >= 0 &&
                    H5Tinsert(type.get(), "constraint", HOFFSET(Event, constraint), H5T_STD_I64LE) >= 0 &&
                    H5Tinsert(type.get(), "level", HOFFSET(Event, level), H5T_STD_I32LE) >= 0 &&
                    H5Tinsert(type.get(), "kind", HOFFSET(Event, kind), kind.get()) >= 0 &&
                    H5Tinsert(type.get(), "impulse", HOFFSET(Event, impulse), H5T_IEEE_F64LE) >= 0;
  return good ? std::move(type) : Hdf5Type();
}

}  // namespace

void TableFile::prepare_mpi_io(hid_t access) {
  sure(H5Pset_fapl_mpio(access, comm_, MPI_INFO_NULL), "prepare MPI-IO");
  // All metadata in one collective write: with the default each rank writes some entries itself, and one
  // that fails leaves the others in a barrier.
  sure(H5Pset_coll_metadata_write(access, true), "prepare MPI-IO");
  sure(H5Pset_dxpl_mpio(transfer_.get(), H5FD_MPIO_COLLECTIVE), "prepare MPI-IO");
  // One MPI write for all chunks, for the same reason, and because it is the fastest.
  sure(H5Pset_dxpl_mpio_chunk_opt(transfer_.get(), H5FD_MPIO_CHUNK_ONE_IO), "prepare MPI-IO");
}

void TableFile::create() {
  agreed(comm_, [&] {  // MPI-IO waits for ever for a rank that cannot open it
    if (!PosixFile(partial_, O_RDWR))
      throw Error(ExitCode::output, "cannot write " + partial_ + ": " + std::strerror(errno) +
                                        "; check that every rank sees its folder, or write elsewhere (-o)");
  });
  together([&] {
    const EndAtMpiIoFailure end(comm_, partial_);
    const Hdf5Properties access(H5Pcreate(H5P_FILE_ACCESS));
    sure(H5Pset_fclose_degree(access.get(), H5F_CLOSE_STRONG), "prepare the file");
    // Who looks into the growing file must not be able to stop us; several ranks do not lock it anyway.
    sure(H5Pset_file_locking(access.get(), false, true), "prepare the file");
    transfer_ = Hdf5Properties(H5Pcreate(H5P_DATASET_XFER));
    int ranks = 1;
    MPI_Comm_size(comm_, &ranks);
    if (ranks > 1) prepare_mpi_io(access.get());  // one rank needs none of it
    file_ = Hdf5File(H5Fcreate(partial_.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, access.get()));
    sure(file_.get(), "create the file");
  });
  for (std::size_t i = 0; i < fields_.size(); ++i)
    together([&] { make_column(i); });
  together([&] {
    const auto time = std::find_if(fields_.begin(), fields_.end(), [](auto& f) { return f.name == "/t"; });
    const hid_t scale = columns_[std::size_t(time - fields_.begin())].dataset.get();
    sure(H5DSset_scale(scale, "t"), "make the scale /t");
    for (const Column& column : columns_)
      if (column.dataset.get() != scale) sure(H5DSattach_scale(column.dataset.get(), scale, 0), "attach /t");
  });
  if (options_.events) together([&] { make_events(); });
  reserve(0);
  agreed(comm_, [&] {
    if (!shortage_.empty()) throw Error(ExitCode::output, shortage_);
  });
}

void TableFile::make_column(std::size_t field) {
  const FieldSpec& spec = fields_[field];
  const std::string doing = "make " + spec.name;
  const std::vector<hsize_t> none = shape(0, spec), most = shape(H5S_UNLIMITED, spec);
  const Hdf5Space space(H5Screate_simple(int(none.size()), none.data(), most.data()));
  const std::vector<hsize_t> chunk = chunk_shape(spec, options_.expected_rows);
  Column& column = columns_[field];
  column.chunk = chunk;
  column.slab_chunks = spec.extents.empty() ? 1 : (spec.extents[0] + chunk[1] - 1) / chunk[1];
  column.slab_bytes = column.slab_chunks * entry_bytes(spec) * product(chunk);
  const Hdf5Properties properties = unfilled(chunk);
  sure(properties.get(), doing);
  column.dataset = Hdf5Dataset(H5Dcreate2(file_.get(), spec.name.c_str(), entry_type(spec), space.get(),
                                          with_groups().get(), properties.get(), H5P_DEFAULT));
  const hid_t dataset = sure(column.dataset.get(), doing);
  const bool described = describe(dataset, spec.units, spec.description, spec.names) &&
                         (spec.order.empty() || write_attribute(dataset, "order", spec.order));
  sure(described ? 0 : -1, "describe " + spec.name);
}

void TableFile::make_events() {
  const hsize_t none = 0, most = H5S_UNLIMITED, chunk = 4096;
  event_list_.chunk = {chunk};
  event_list_.slab_chunks = 1;
  event_list_.slab_bytes = chunk * sizeof(Event);  // 128 KiB
  const Hdf5Space space(H5Screate_simple(1, &none, &most));
  const Hdf5Properties properties = unfilled({&chunk, 1});
  event_type_ = make_event_type();
  sure(std::min(event_type_.get(), properties.get()), "make /events");
  event_list_.dataset = Hdf5Dataset(H5Dcreate2(file_.get(), "/events", event_type_.get(), space.get(),
                                               H5P_DEFAULT, properties.get(), H5P_DEFAULT));
  sure(event_list_.dataset.get(), "make /events");
  const bool good =
      write_attribute(event_list_.dataset.get(), "description",
                      std::string("Every impact and lift-off, in the order of t, constraint, level.")) &&
      write_attribute(event_list_.dataset.get(), "units",
                      std::vector<std::string>{"s", "1", "1", "1", options_.impulse_units});
  sure(good ? 0 : -1, "describe /events");
}

template <class Value>
void TableFile::put_attribute(const std::string& name, const Value& value) {
  together([&] {
    sure(write_attribute(file_.get(), name, value) ? 0 : -1, "write the attribute '" + name + "'");
  });
}

void TableFile::attribute(const std::string& name, const std::string& value) {
  // Every rank keeps a copy of the metadata, and the copies have to be equal.
  auto size = std::uint64_t(value.size());
  MPI_Bcast(&size, 1, MPI_UINT64_T, 0, comm_);
  std::string shared = value;
  shared.resize(size);
  MPI_Bcast(shared.data(), int(size), MPI_CHAR, 0, comm_);
  text_bytes_ += size;
  put_attribute(name, shared);
}

void TableFile::attribute(const std::string& name, double value) {
  MPI_Bcast(&value, 1, MPI_DOUBLE, 0, comm_);
  put_attribute(name, value);
}

void TableFile::attribute(const std::string& name, std::int64_t value) {
  MPI_Bcast(&value, 1, MPI_INT64_T, 0, comm_);
  put_attribute(name, value);
}

void TableFile::list(const std::string& name, std::span<const std::int64_t> values, const std::string& units,
                     const std::string& description) {
  put_list(name, H5T_STD_I64LE, sizeof(std::int64_t), values.size(), values.data(), units, description);
}

void TableFile::embed(const std::string& name, std::span<const std::byte> bytes) {
  put_list(name, H5T_STD_U8LE, 1, bytes.size(), bytes.data(), "1", "bytes for the program itself");
}

void TableFile::put_list(const std::string& name, hid_t type, std::size_t entry, hsize_t size,
                         const void* values, const std::string& units, const std::string& description) {
  MPI_Bcast(&size, sizeof size, MPI_BYTE, 0, comm_);
  lists_bytes_ += size * entry;
  reserve(0);
  Hdf5Dataset dataset;
  together([&] {
    const Hdf5Space space(H5Screate_simple(1, &size, nullptr));
    dataset = Hdf5Dataset(H5Dcreate2(file_.get(), name.c_str(), type, space.get(), with_groups().get(),
                                     unfilled().get(), H5P_DEFAULT));
    sure(dataset.get(), "make " + name);
    sure(describe(dataset.get(), units, description, {}) ? 0 : -1, "describe " + name);
  });
  const hsize_t most = (hsize_t{256} << 20) / entry;  // MPI counts bytes in an int
  for (hsize_t first = 0; first < size; first += most) {
    const std::vector<hsize_t> count{rank_ == 0 ? std::min(most, size - first) : 0};
    const Hdf5Space space(H5Dget_space(dataset.get())), memory(H5Screate_simple(1, count.data(), nullptr));
    writing([&] {
      select_block(space.get(), memory.get(), &first, count);
      sure(H5Dwrite(dataset.get(), type, memory.get(), space.get(), transfer_.get(),
                    static_cast<const std::byte*>(values) + (rank_ == 0 ? first * entry : 0)),
           "write " + name);
    });
  }
}

}  // namespace sweepvi
