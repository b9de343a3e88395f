#include "io/table_file.hpp"

#include <hdf5_hl.h>

#include <algorithm>
#include <functional>
#include <numeric>
#include <tuple>
#include <utility>

#include "io/hdf5_attribute.hpp"

namespace sweepvi {
namespace {

constexpr hsize_t mebibyte = 1 << 20;
constexpr std::size_t names_limit = 60 << 10;  // an attribute holds 64 KiB, its header included

hid_t entry_type(const FieldSpec& field) {
  return field.type == FieldSpec::Type::real ? H5T_IEEE_F64LE : H5T_STD_I32LE;
}

hsize_t entry_bytes(const FieldSpec& field) {
  return field.type == FieldSpec::Type::real ? sizeof(double) : sizeof(std::int32_t);
}

hsize_t product(std::span<const hsize_t> extents) {
  return std::accumulate(extents.begin(), extents.end(), hsize_t{1}, std::multiplies<>());
}

/// {rows, extents...}: a shape in the file.
std::vector<hsize_t> shape(hsize_t rows, const FieldSpec& field) {
  std::vector<hsize_t> result{rows};
  result.insert(result.end(), field.extents.begin(), field.extents.end());
  return result;
}

/// Chunks of 1/2 to 1 MiB: large enough to stream, small enough to read one column's history at a bearable
/// price. Rows wider than that are cut along their first extent; short files do not reserve rows they will
/// not have.
std::vector<hsize_t> chunk_shape(const FieldSpec& field, hsize_t expected_rows) {
  const hsize_t row_bytes = entry_bytes(field) * product(field.extents);
  const hsize_t expected = expected_rows > 0 ? expected_rows : 1024;
  std::vector<hsize_t> chunk = shape(std::clamp(mebibyte / 2 / row_bytes, hsize_t{1}, expected), field);
  if (row_bytes > mebibyte) {
    const hsize_t most = std::max(mebibyte / (row_bytes / chunk[1]), hsize_t{1});
    const hsize_t pieces = (chunk[1] + most - 1) / most;
    chunk[1] = (chunk[1] + pieces - 1) / pieces;
  }
  return chunk;
}

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

/// Selects [start, start + count) in both spaces, or nothing if count has a 0.
bool select_block(hid_t file, hid_t memory, const hsize_t* start, const std::vector<hsize_t>& count) {
  if (product(count) == 0) return H5Sselect_none(file) >= 0 && H5Sselect_none(memory) >= 0;
  return H5Sselect_hyperslab(file, H5S_SELECT_SET, start, nullptr, count.data(), nullptr) >= 0;
}

}  // namespace

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
  together([&] {
    const Hdf5Properties access(H5Pcreate(H5P_FILE_ACCESS));
    sure(H5Pset_fclose_degree(access.get(), H5F_CLOSE_STRONG), "prepare the file");
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
  agreed(comm_, [&] {
    if (rank_ == 0) reserve(0);
  });
}

void TableFile::make_column(std::size_t field) {
  const FieldSpec& spec = fields_[field];
  const std::string doing = "make " + spec.name;
  const std::vector<hsize_t> none = shape(0, spec), most = shape(H5S_UNLIMITED, spec);
  const Hdf5Space space(H5Screate_simple(int(none.size()), none.data(), most.data()));
  const std::vector<hsize_t> chunk = chunk_shape(spec, options_.expected_rows);
  Column& column = columns_[field];
  column.slab_rows = chunk[0];
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
  const hsize_t none = 0, most = H5S_UNLIMITED, chunk = events_per_chunk;
  const Hdf5Space space(H5Screate_simple(1, &none, &most));
  const Hdf5Properties properties = unfilled({&chunk, 1});
  event_type_ = make_event_type();
  sure(std::min(event_type_.get(), properties.get()), "make /events");
  event_dataset_ = Hdf5Dataset(H5Dcreate2(file_.get(), "/events", event_type_.get(), space.get(), H5P_DEFAULT,
                                          properties.get(), H5P_DEFAULT));
  sure(event_dataset_.get(), "make /events");
  const bool good =
      write_attribute(event_dataset_.get(), "description",
                      std::string("Every impact and lift-off, in the order of t, constraint, level.")) &&
      write_attribute(event_dataset_.get(), "units",
                      std::vector<std::string>{"s", "1", "1", "1", options_.impulse_units});
  sure(good ? 0 : -1, "describe /events");
}

void TableFile::commit_row() {
  if (++buffered_ == capacity_) write_rows();
}

void TableFile::flush() {
  write_rows();
  writing([&] { sure(H5Fflush(file_.get(), H5F_SCOPE_GLOBAL), "flush"); });
}

void TableFile::extend(hsize_t rows, hsize_t events) {
  for (std::size_t i = 0; i < fields_.size(); ++i)
    sure(H5Dset_extent(columns_[i].dataset.get(), shape(rows, fields_[i]).data()),
         "extend " + fields_[i].name);
  if (event_dataset_) sure(H5Dset_extent(event_dataset_.get(), &events), "extend /events");
}

void TableFile::write_rows() {
  if (!file_ || file_damaged_)
    throw Error(ExitCode::internal, "TableFile: " + path_ + " is written to after it was closed or failed");
  const hsize_t events = gather_events();
  agreed(comm_, [&] {
    if (rank_ == 0) reserve(events);
  });
  writing([&] { extend(written_ + buffered_, events_written_ + events); });
  if (events > 0) writing([&] { write_events(events); });
  if (buffered_ == 0) return;
  for (std::size_t i = 0; i < fields_.size(); ++i)
    writing([&] { write_column(i); });
  written_ += buffered_;
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
  const Hdf5Space file(H5Dget_space(event_dataset_.get()));
  const Hdf5Space memory(H5Screate_simple(1, count.data(), nullptr));
  select_block(file.get(), memory.get(), &events_written_, count);
  sure(H5Dwrite(event_dataset_.get(), event_type_.get(), memory.get(), file.get(), transfer_.get(),
                all_events_.data()),
       "write /events");
  events_written_ += total;
  events_.clear();
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
  hsize_t size = values.size();
  MPI_Bcast(&size, sizeof size, MPI_BYTE, 0, comm_);
  lists_bytes_ += size * sizeof(std::int64_t);
  agreed(comm_, [&] {
    if (rank_ == 0) reserve(0);
  });
  const Hdf5Space space(H5Screate_simple(1, &size, nullptr));
  Hdf5Dataset dataset;
  together([&] {
    dataset = Hdf5Dataset(H5Dcreate2(file_.get(), name.c_str(), H5T_STD_I64LE, space.get(),
                                     with_groups().get(), unfilled().get(), H5P_DEFAULT));
    sure(dataset.get(), "make " + name);
    sure(describe(dataset.get(), units, description, {}) ? 0 : -1, "describe " + name);
  });
  writing([&] {
    if (rank_ != 0) H5Sselect_none(space.get());
    sure(H5Dwrite(dataset.get(), H5T_STD_I64LE, space.get(), space.get(), transfer_.get(), values.data()),
         "write " + name);
  });
}

}  // namespace sweepvi
