#pragma once

#include <mpi.h>

#include <concepts>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "io/hdf5_handle.hpp"
#include "io/posix_file.hpp"
#include "io/table_mark.hpp"
#include "sweepvi/error.hpp"

namespace sweepvi {

/// One dataset that grows by one row per recorded time. The same on every rank, except first and count.
struct FieldSpec {
  enum class Type { real, integer };  ///< float64 or int32, little-endian in the file

  std::string name;              ///< absolute, "/x" or "/solver/iterations"; groups are made
  Type type = Type::real;        ///< what one entry is
  std::vector<hsize_t> extents;  ///< shape of one row, every extent > 0; empty: one number per row
  hsize_t first = 0;             ///< this rank's slice of a row is [first, first + count) along extents[0];
  hsize_t count = 0;             ///< the ranks' slices tile it.  One number per row: ignored, rank 0 owns it
  std::string units;             ///< "m", "1" for pure numbers
  std::string description;       ///< one sentence
  /// What the columns are called. Shorter than a row: the names repeat, as `order` says.
  /// Left out of the file if they need more than 60 KiB, because an HDF5 attribute cannot be larger.
  std::vector<std::string> names = {};
  /// How names repeat: "element by element" (z1 z2 z1 z2 ...) or "state by state" (q q ... v v ...). An
  /// attribute where it is not empty.
  std::string order = {};
};

/// A row of `/events`: constraint `constraint` was hit (or released) on level `level` at time t.
struct Event {
  enum class Kind : std::int32_t { impact = 0, liftoff = 1 };

  double t = 0;                 ///< s
  std::int64_t constraint = 0;  ///< number of the constraint, from 0
  std::int32_t level = 0;       ///< relative-degree level, from 1
  Kind kind = Kind::impact;
  double impulse = 0;  ///< size of the jump, in TableOptions::impulse_units; 0 at lift-off
};

struct TableOptions {
  /// A guess; it only shapes the chunks on disk. 0: unknown.
  hsize_t expected_rows = 0;
  bool overwrite = false;                           ///< may finish() replace an existing file?
  bool events = false;                              ///< make `/events`?
  std::string impulse_units = "N s";                ///< units of Event::impulse
  std::size_t buffer_bytes = std::size_t{4} << 20;  ///< rows held per rank before they are written [B]
  /// Where the rows go until finish(), in the folder of the final file; empty: `path.partial`.
  std::string partial = {};
};

/// An HDF5 file of rows growing in time, written by all ranks together.
///
/// The file is `path.partial` until finish() gives it its name, so a file with its final name is complete.
///
///     TableFile file(comm, "run.h5", {{.name = "/t", .units = "s"}, {.name = "/x", .extents = {n}, ...}},
///                    {.expected_rows = 1001});
///     file.real(0)[0] = t;
///     std::copy_n(x, file.slice_size(1), file.real(1));
///     file.commit_row();
///     file.finish();
///
/// Axis 0 of every field is tied to `/t` by an HDF5 dimension scale; so one field must be `/t`, one real
/// number per row.
///
/// Everything is collective on comm, the destructor included, except real(), integer(), slice_size(),
/// rows() and add_event(). Rows are buffered and written when the buffers are full; commit_row() does not
/// communicate in between, and needs no memory.
///
/// Space on disk is reserved before it is written, so a full disk is an ordinary error. There is always room
/// for a buffer full of rows more than there are: when the disk has no more, whoever writes can still take in
/// what it has and mark() it, see short_of_room().
///
/// @throws Error ExitCode::output, the same on every rank, when the file cannot be made or written. If space
///         is lacking, the rows stay buffered: flush() may be tried again, or the file discarded, or
///         destroyed, which leaves path.partial readable up to the last write. See damaged() for worse cases.
class TableFile {
public:
  /// @throws Error ExitCode::output if path exists and may not be overwritten, is no regular file, or its
  ///         folder is missing or not writable; ExitCode::internal if the fields make no sense. In both cases
  ///         no new file is left.
  /// @note comm must outlive the object.
  TableFile(MPI_Comm comm, std::string path, std::vector<FieldSpec> fields, const TableOptions& options = {});
  /// Closes the file. Without finish() or discard() it stays behind as path.partial, without the rows that
  /// were still in the buffers.
  ~TableFile();
  TableFile(const TableFile&) = delete;
  TableFile& operator=(const TableFile&) = delete;

  /// Where this rank's slice of the next row goes, row-major: slice_size(field) entries, all of which have to
  /// be set for every row. For one number per row every rank may write, and rank 0's number is stored.
  /// Valid until commit_row().
  double* real(std::size_t field) { return next_row<double>(field, FieldSpec::Type::real); }
  std::int32_t* integer(std::size_t field) { return next_row<std::int32_t>(field, FieldSpec::Type::integer); }
  /// Entries of one row on this rank; 1 for one number per row.
  std::size_t slice_size(std::size_t field) const { return columns_.at(field).slice; }

  /// Ends a row of all fields. Every rank calls it equally often.
  void commit_row();
  /// Rows committed so far, written or not.
  hsize_t rows() const { return written_ + buffered_; }
  const std::vector<FieldSpec>& fields() const { return fields_; }
  bool has_events() const { return options_.events; }

  /// Notes an event; any rank, not collective. Sorted by (t, constraint, level) among the events since the
  /// last write; so the whole list is in order if an event is added before the row that ends its step.
  void add_event(const Event& event) { events_.push_back(event); }

  /// An attribute of the root group; replaces one of the same name. Rank 0's value is stored.
  void attribute(const std::string& name, const std::string& value);
  void attribute(const std::string& name, const char* value) { attribute(name, std::string(value)); }
  void attribute(const std::string& name, double value);
  void attribute(const std::string& name, std::int64_t value);
  template <std::integral I>
  void attribute(const std::string& name, I value) {
    attribute(name, static_cast<std::int64_t>(value));
  }

  /// A list that does not grow, such as `/element`. Rank 0's values are stored.
  void list(const std::string& name, std::span<const std::int64_t> values, const std::string& units,
            const std::string& description);

  /// A dataset of bytes, such as `/checkpoint`. Rank 0's bytes are stored.
  void embed(const std::string& name, std::span<const std::byte> bytes);

  /// Writes what is buffered and makes the partial file readable as it stands.
  void flush();
  /// Writes what is buffered, waits until the disk has it, and says where it is: all rows and events up to
  /// now can be read by RowSource from then on, even if the program is killed in the middle of later writes,
  /// of finish() or of anything else. Rank 0's mark is complete. It names the partial file; after finish()
  /// the same bytes are in file name().
  TableMark mark();
  /// Whether the disk has no room for more than the rows of this step: it is time to mark() them and to end.
  /// Equal on every rank.
  bool short_of_room() const { return short_ && room_ <= rows_of_a_step; }
  /// Why, on rank 0.
  const std::string& shortage() const { return shortage_; }
  /// Gives the partial file its usual name, `path.partial`, in place of TableOptions::partial.
  void rename_partial();
  /// Name, without folder, that finish() gives to the file.
  std::string name() const;
  /// Writes what is buffered, closes the file and gives it its name.
  void finish();
  /// Closes and removes the partial file.
  void discard();

  /// Did the storage fail in the middle of a write? HDF5 1.10 can then neither close the file nor end without
  /// a crash or a deadlock: the object lets go of the file as it is, and the program should say what it has
  /// to say and leave with MPI_Abort. Equal on every rank of that file.
  static bool damaged() { return damaged_; }
  /// Whether the disk failed to take what it had been given: then nobody knows what it has of the rows since
  /// the last mark(), and there will be no other mark. Equal on every rank.
  bool lost() const { return lost_ != 0; }

private:
  /// A dataset that grows, and how it lies in the file.
  struct Stored {
    Hdf5Dataset dataset;
    std::vector<hsize_t> chunk = {1};      // shape of a chunk; those side by side are a slab
    std::uint64_t slab_chunks = 0;         // their number
    std::uint64_t slab_bytes = 0;          // their size
    std::uint64_t checksum = 0;            // of what this rank has written
    std::vector<std::uint64_t> addresses;  // of the chunks, as far as mark() has asked; rank 0
  };
  /// A field's dataset and the rows waiting for it.
  struct Column : Stored {
    std::size_t slice = 0;          // entries of one row on this rank
    std::size_t row_bytes = 0;      // of one row on this rank
    std::vector<std::byte> buffer;  // capacity_ rows
  };

  template <class T>
  T* next_row(std::size_t field, FieldSpec::Type type) {
    Column& column = columns_.at(field);
    if (fields_[field].type != type || buffered_ == capacity_) refuse_row(field, type);
    return reinterpret_cast<T*>(column.buffer.data()) + buffered_ * column.slice;
  }
  [[noreturn]] void refuse_row(std::size_t field, FieldSpec::Type type) const;

  void check_fields() const;
  void check_path() const;
  void probe();
  bool is_ours() const;
  [[noreturn]] void refuse_stranger() const;
  void make_durable(int (*synchronise_file)(int));
  void rename_to(const std::string& name) const;
  void make_buffers();
  hsize_t rows_ahead() const;
  std::string take_room(hsize_t rows, hsize_t events) const;
  void reserve(hsize_t events);
  void trim() const;
  void prepare_mpi_io(hid_t access);
  void create();
  void make_column(std::size_t field);
  void make_events();
  void extend(hsize_t rows, hsize_t events);
  void write_rows();
  void write_column(std::size_t field);
  void add_checksums(std::size_t field);
  TableMark::Field locate(Stored& stored, const std::string& name, std::uint64_t entry,
                          const std::vector<hsize_t>& shape) const;
  void put_list(const std::string& name, hid_t type, std::size_t entry, hsize_t size, const void* values,
                const std::string& units, const std::string& description);
  hsize_t gather_events();
  void write_events(hsize_t total);
  herr_t close() noexcept;

  /// Runs `work` on every rank and makes the ranks agree on how it went.
  void together(const std::function<void()>& work) const;
  /// The same for work that writes to the disk: if it fails, the file is damaged.
  void writing(const std::function<void()>& work);
  /// Passes on what an HDF5 call returned, or throws if it failed.
  template <class Result>
  Result sure(Result result, std::string_view doing) const {
    if (result < 0) fail(doing);
    return result;
  }
  [[noreturn]] void fail(std::string_view doing) const;
  template <class Value>
  void put_attribute(const std::string& name, const Value& value);

  MPI_Comm comm_;
  int rank_ = 0;
  std::string path_;
  std::string partial_;
  std::vector<FieldSpec> fields_;
  TableOptions options_;
  hsize_t capacity_ = 1;  // rows the buffers hold, equal on every rank
  hsize_t written_ = 0;   // rows in the file
  hsize_t buffered_ = 0;  // rows in the buffers
  hsize_t events_written_ = 0;
  static constexpr hsize_t rows_of_a_step = 4;  // its own and those of its events, unless they are many
  hsize_t room_ = 0;                            // rows that the disk has room for, beyond those in the file
  bool short_ = false;                          // the disk had none for as many as there should be
  std::string shortage_;                        // why; rank 0
  std::uint64_t lists_bytes_ = 0;               // of list()
  std::uint64_t text_bytes_ = 0;                // of attributes
  std::vector<Event> events_;                   // of this rank, since the last write
  std::vector<Event> all_events_;               // of all ranks, sorted; rank 0, during a write
  inline static bool damaged_ = false;
  bool file_damaged_ = false;
  int lost_ = 0;          // why; errno of rank 0
  PosixFile descriptor_;  // the partial file; rank 0
  Hdf5File file_;         // before the datasets, so that it is closed after them
  Hdf5Properties transfer_;
  Hdf5Type event_type_;
  Stored event_list_;
  std::vector<Column> columns_;
};

}  // namespace sweepvi
