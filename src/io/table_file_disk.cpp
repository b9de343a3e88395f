// TableFile's dealings with the user, the memory and the file system; its dealings with HDF5 are in
// table_file.cpp.

#include <fcntl.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <functional>
#include <numeric>
#include <system_error>
#include <utility>

#include "io/mpi_io_failure.hpp"
#include "io/output_file.hpp"
#include "io/table_file.hpp"

namespace sweepvi {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void refuse(const std::string& message) {
  throw Error(ExitCode::output, message);
}

fs::path folder_of(const std::string& path) {
  const fs::path folder = fs::path(path).parent_path();
  return folder.empty() ? fs::path(".") : folder;
}

std::string in_mebibytes(double bytes) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f MiB", bytes / (1 << 20));
  return text;
}

/// Makes the name of a file survive a power cut.
void synchronise(const std::string& path) {
  try {
    sync_folder_of(path);
  } catch (const std::system_error& error) {
    refuse("cannot make the name " + path + " durable: " + error.code().message() +
           "; check that disk, or write elsewhere (-o)");
  }
}

}  // namespace

TableFile::TableFile(MPI_Comm comm, std::string path, std::vector<FieldSpec> fields,
                     const TableOptions& options)
    : comm_(comm),
      path_(std::move(path)),
      partial_(options.partial.empty() ? path_ + ".partial" : options.partial),
      fields_(std::move(fields)),
      options_(options),
      columns_(fields_.size()) {
  MPI_Comm_rank(comm_, &rank_);
  agreed(comm_, [&] {
    check_fields();
    if (rank_ == 0) check_path();
  });
  make_buffers();
  agreed(comm_, [&] {
    if (rank_ == 0) probe();
  });
  try {
    create();
  } catch (...) {
    discard();
    throw;
  }
}

TableFile::~TableFile() {
  close();
}

void TableFile::check_fields() const {
  const auto need = [](bool good, const std::string& what) {
    if (!good) throw Error(ExitCode::internal, "TableFile: " + what);
  };
  bool time = false;
  for (const FieldSpec& field : fields_) {
    need(field.name.size() > 1 && field.name[0] == '/', "field '" + field.name + "' needs an absolute name");
    if (field.name == "/t") time = field.extents.empty() && field.type == FieldSpec::Type::real;
    if (field.extents.empty()) continue;
    need(std::find(field.extents.begin(), field.extents.end(), 0u) == field.extents.end(),
         field.name + " has an extent of 0; leave the field out");
    need(field.count <= field.extents[0] && field.first <= field.extents[0] - field.count,
         field.name + ": this rank's slice sticks out of the row");
  }
  need(time, "there must be a field /t, one real number per row");
}

void TableFile::check_path() const {
  std::error_code error;
  const fs::file_status status = fs::status(path_, error);
  if (fs::exists(status) && !fs::is_regular_file(status))
    refuse("cannot write " + path_ + ": it exists and is not a regular file; choose another name (-o)");
  if (fs::exists(status) && !options_.overwrite)
    refuse(path_ + " exists already and is kept; replace it with --force, or choose another name (-o)");
  const fs::path folder = folder_of(path_);
  if (!fs::is_directory(folder, error))
    refuse("cannot write " + path_ + ": there is no folder " + folder.string() +
           "; make it, or choose another (-o)");
}

// MPI-IO and HDF5 say little about why a file cannot be made, and cannot even close one for which there is no
// room. A file that an interrupted run left is removed and not emptied: somebody may be reading it.
void TableFile::probe() {
  std::error_code error;
  if (!fs::is_directory(partial_, error)) fs::remove(partial_, error);
  descriptor_ = PosixFile(partial_, O_CREAT | O_RDWR);
  if (error || !descriptor_)
    refuse("cannot write " + partial_ + ": " + (error ? error.message() : std::strerror(errno)) +
           "; check the permissions of folder " + folder_of(path_).string() + ", or choose another (-o)");
  try {
    if (const std::string shortage = take_room(0, 0); !shortage.empty()) refuse(shortage);
    synchronise(partial_);
  } catch (const Error&) {
    fs::remove(partial_, error);
    throw;
  }
}

/// Does the name of the partial file still mean the file that we write?
bool TableFile::is_ours() const {
  struct stat named {};
  struct stat ours {};
  return descriptor_ && stat(partial_.c_str(), &named) == 0 && fstat(descriptor_.get(), &ours) == 0 &&
         named.st_dev == ours.st_dev && named.st_ino == ours.st_ino;
}

void TableFile::refuse_stranger() const {
  refuse("the rows that were written to " + partial_ +
         " are lost: somebody has removed, renamed or replaced that file while the run was going on, perhaps "
         "another run with the same output; run again, and give each run a name of its own (-o)");
}

/// How many rows are to have room, beyond those that are buffered.
hsize_t TableFile::rows_ahead() const {
  const hsize_t now = written_ + buffered_, most = std::max(capacity_, rows_of_a_step);
  return options_.expected_rows > now ? std::min(most, options_.expected_rows - now) : most;
}

// HDF5 notices a full disk only in the middle of a write, and is then beyond repair. So before it writes the
// buffered rows and `events` we take the space for them on disk. And before they come, or there would be none
// for those that are in the buffers already when the disk is full.
void TableFile::reserve(hsize_t events) {
  agreed(comm_, [&] {
    if (rank_ != 0) return;
    const hsize_t wanted = buffered_ + rows_ahead();
    shortage_ = take_room(wanted, events + event_list_.chunk[0]);
    if (shortage_.empty()) {
      room_ = wanted;
    } else if (room_ <= buffered_ || !take_room(room_, events).empty()) {
      if (const std::string even_so = take_room(buffered_, events); !even_so.empty()) refuse(even_so);
      room_ = buffered_;
    }
  });
  std::array<std::uint64_t, 2> found = {room_, shortage_.empty() ? 0U : 1U};
  MPI_Bcast(found.data(), 2, MPI_UINT64_T, 0, comm_);
  room_ = found[0];
  short_ = found[1] != 0;
}

/// Takes space for rows and events beyond those in the file, and some more for attributes and for closing the
/// file. @return why there is none; empty if there is
std::string TableFile::take_room(hsize_t rows, hsize_t events) const {
  std::uint64_t held = lists_bytes_, end = lists_bytes_, chunks = 0;
  const auto count = [&](const Stored& stored, std::uint64_t now, std::uint64_t more) {
    const auto slabs = [&](std::uint64_t all) { return (all + stored.chunk[0] - 1) / stored.chunk[0]; };
    held += slabs(now) * stored.slab_bytes;
    end += slabs(now + more) * stored.slab_bytes;
    chunks += slabs(now + more) * stored.slab_chunks;
  };
  for (const Column& column : columns_)
    count(column, written_, rows);
  if (options_.events) count(event_list_, events_written_, events);
  held -= lists_bytes_;  // the newest list may not be there yet
  end += 128 * chunks + 2 * text_bytes_ + (std::uint64_t{1} << 20);

  const std::uint64_t more = end - held;  // the file is at least `held` long already
  int code = 0;
  do {
    code = fallocate(descriptor_.get(), 0, off_t(held), off_t(more)) == 0 ? 0 : errno;
  } while (code == EINTR);
  if (code == 0) return {};
  std::string why = std::strerror(code);
  if (code != ENOSPC && code != EDQUOT && code != EFBIG) {
    // This file system cannot reserve: be content if there is enough now.
    struct statvfs disk {};
    const bool known = statvfs(folder_of(path_).c_str(), &disk) == 0 && disk.f_blocks > 0;
    const double space = double(disk.f_bavail) * double(disk.f_frsize);
    if (!known || space >= double(more)) return {};
    why = in_mebibytes(space) + " are free";
  }
  return "no room for " + partial_ + ": it needs " + in_mebibytes(double(more)) + " more: " + why +
         "; make room, or write elsewhere (-o)";
}

/// Cuts off what was reserved and not used: only reads what HDF5 says, and leaves every byte as it is.
/// Without success the file is longer than it needs to be, and as good.
void TableFile::trim() const {
  const QuietHdf5 quiet;
  const Hdf5Properties access(H5Pcreate(H5P_FILE_ACCESS));
  H5Pset_file_locking(access.get(), false, true);  // somebody else may have locked it
  const Hdf5File file(H5Fopen(partial_.c_str(), H5F_ACC_RDONLY, access.get()));
  haddr_t end = 0;
  if (!file || H5Fget_eoa(file.get(), &end) < 0) return;
  [[maybe_unused]] const int ignored = ftruncate(descriptor_.get(), off_t(end));
}

void TableFile::make_buffers() {
  std::vector<std::uint64_t> counts;
  for (const FieldSpec& field : fields_)
    counts.push_back(field.count);
  MPI_Allreduce(MPI_IN_PLACE, counts.data(), int(counts.size()), MPI_UINT64_T, MPI_SUM, comm_);
  std::uint64_t row = 1;
  for (std::size_t i = 0; i < fields_.size(); ++i) {
    const FieldSpec& field = fields_[i];
    if (!field.extents.empty() && counts[i] != field.extents[0])
      throw Error(ExitCode::internal, "TableFile: " + field.name + ": the ranks' slices have " +
                                          std::to_string(counts[i]) + " entries together, not " +
                                          std::to_string(field.extents[0]));
    columns_[i].slice = field.extents.empty()
                            ? 1
                            : std::accumulate(field.extents.begin() + 1, field.extents.end(),
                                              std::size_t(field.count), std::multiplies<>());
    columns_[i].row_bytes =
        columns_[i].slice * (field.type == FieldSpec::Type::real ? sizeof(double) : sizeof(std::int32_t));
    row += columns_[i].row_bytes;
  }
  // The fullest rank decides, so that all ranks write after the same row without asking each other.
  MPI_Allreduce(MPI_IN_PLACE, &row, 1, MPI_UINT64_T, MPI_MAX, comm_);
  capacity_ = std::max<hsize_t>(options_.buffer_bytes / row, 1);
  if (options_.expected_rows > 0) capacity_ = std::min(capacity_, options_.expected_rows);
  agreed(comm_, [&] {
    for (Column& column : columns_)
      column.buffer.resize(capacity_ * column.row_bytes);
  });
}

void TableFile::refuse_row(std::size_t field, FieldSpec::Type type) const {
  throw Error(ExitCode::internal,
              "TableFile: " + fields_[field].name +
                  (fields_[field].type != type ? " is asked for with the wrong type"
                                               : ": no room for a row after a failed write"));
}

herr_t TableFile::close() noexcept {
  const QuietHdf5 quiet;
  const EndAtMpiIoFailure end(comm_, partial_);
  if (file_damaged_) {  // HDF5 would try to write on, on some ranks or others
    for (Column& column : columns_)
      column.dataset.release();
    event_list_.dataset.release();
    file_.release();
  }
  for (Column& column : columns_)
    column.dataset.close();
  event_list_.dataset.close();
  const herr_t closed = file_.close();
  if (closed < 0) damaged_ = file_damaged_ = true;
  return closed;
}

void TableFile::finish() {
  flush();
  writing([&] { sure(close(), "close the file"); });
  agreed(comm_, [&] {
    if (rank_ != 0) return;
    check_path();  // somebody else may have been quicker
    if (!is_ours()) refuse_stranger();
    trim();
  });
  make_durable(fsync);
  agreed(comm_, [&] {
    if (rank_ == 0) rename_to(path_);
  });
}

// Systems forget what they could not write: doing it once more and with success would prove nothing.
void TableFile::make_durable(int (*synchronise_file)(int)) {
  try {
    agreed(comm_, [&] {
      if (rank_ != 0) return;
      if (lost_ == 0 && synchronise_file(descriptor_.get()) != 0 && errno != EINVAL && errno != ENOSYS &&
          errno != ENOTSUP)
        lost_ = errno;
      if (lost_ != 0)
        refuse("cannot make " + partial_ + " durable: " + std::strerror(lost_) +
               "; check that disk, or write elsewhere (-o)");
    });
  } catch (const Error&) {
    if (lost_ == 0) lost_ = EIO;
    throw;
  }
}

void TableFile::rename_partial() {
  const std::string usual = path_ + ".partial";
  agreed(comm_, [&] {
    if (rank_ != 0) return;
    if (!is_ours()) refuse_stranger();
    rename_to(usual);
  });
  partial_ = usual;
}

void TableFile::rename_to(const std::string& name) const {
  std::error_code error;
  fs::rename(partial_, name, error);
  if (error)
    refuse("cannot rename " + partial_ + " to " + name + ": " + error.message() + "; rename it by hand");
  synchronise(name);
}

std::string TableFile::name() const {
  return fs::path(path_).filename().string();
}

void TableFile::discard() {
  close();
  std::error_code ignored;
  if (rank_ == 0 && is_ours()) fs::remove(partial_, ignored);
  MPI_Barrier(comm_);  // when we return it is gone for everyone
}

}  // namespace sweepvi
