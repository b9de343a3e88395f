#include "io/row_source.hpp"

#include <fmt/format.h>
#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <optional>
#include <utility>

#include "io/field_reader.hpp"
#include "io/table_layout.hpp"

namespace sweepvi {
namespace {

constexpr const char* advice =
    "; put back the file that belongs to the checkpoint, or start again without it";

void check_size(const TableMark& mark, std::uint64_t size, const std::string& path) {
  for (const TableMark::Field& field : mark.fields) {
    const FieldLayout layout(mark, field);
    for (std::size_t i = 0; i < field.addresses.size(); ++i) {
      const std::uint64_t before = i / layout.pieces * field.chunk[0];
      const std::uint64_t bytes = std::min(field.chunk[0], layout.rows - before) * layout.stride;
      if (bytes > size || field.addresses[i] > size - bytes)
        throw InputError(path + " has been cut off or replaced: it has " + std::to_string(size) +
                         " bytes, but rows " + std::to_string(before) + " and up of dataset " + field.name +
                         " are at byte " + std::to_string(field.addresses[i]) + advice);
    }
  }
}

/// Gives rank 0's data to all ranks.
class Sharing {
public:
  explicit Sharing(MPI_Comm comm) : comm_(comm) {}
  void operator()(std::uint64_t& value) { MPI_Bcast(&value, 1, MPI_UINT64_T, 0, comm_); }
  void operator()(std::string& text) { share(text, MPI_CHAR); }
  void operator()(std::vector<std::uint64_t>& values) { share(values, MPI_UINT64_T); }
  void operator()(TableMark::Field& field) {
    (*this)(field.name);
    (*this)(field.entry_bytes);
    (*this)(field.extents);
    (*this)(field.chunk);
    (*this)(field.addresses);
  }
  void operator()(TableMark& mark) {
    (*this)(mark.rows);
    (*this)(mark.events);
    std::uint64_t fields = mark.fields.size();
    (*this)(fields);
    mark.fields.resize(fields);
    for (TableMark::Field& field : mark.fields)
      (*this)(field);
  }

private:
  template <class List>
  void share(List& list, MPI_Datatype type) {
    std::uint64_t size = list.size();
    (*this)(size);
    list.resize(size);
    MPI_Bcast(list.data(), int(size), type, 0, comm_);
  }
  MPI_Comm comm_;
};

}  // namespace

RowSource::RowSource(MPI_Comm comm, const std::string& folder, TableMark mark,
                     std::vector<std::string> otherwise)
    : comm_(comm), mark_(std::move(mark)) {
  namespace fs = std::filesystem;
  int rank = 0;
  MPI_Comm_rank(comm_, &rank);
  Sharing share(comm_);
  agreed(comm_, [&] {
    if (rank != 0) return;
    otherwise.insert(otherwise.begin(), mark_.file);
    std::string names;
    for (const std::string& name : otherwise) {
      const fs::path path = fs::path(folder) / name;
      names += (names.empty() ? "" : " or ") + path.string();
      if (path_.empty() && !name.empty() && fs::is_regular_file(path)) path_ = path.string();
    }
    if (path_.empty())
      throw InputError("the rows of the interrupted run are missing: no file " + names + advice);
  });
  share(path_);
  share(mark_);
  agreed(comm_, [&] {
    file_ = PosixFile(path_, O_RDONLY);
    struct stat found {};
    if (!file_ || fstat(file_.get(), &found) != 0)
      throw InputError("cannot read " + path_ + ": " + std::strerror(errno) +
                       "; check its permissions, and that every rank sees it");
    check_size(mark_, std::uint64_t(found.st_size), path_);
  });
}

std::string RowSource::partial_beside(const std::string& path) const {
  namespace fs = std::filesystem;
  const std::string usual = path + ".partial";
  std::error_code missing;
  return fs::equivalent(usual, path_, missing) ? path + ".restart" : usual;
}

void RowSource::check_fields(const TableFile& file) const {
  std::vector<TableMark::Field> now;
  for (const FieldSpec& field : file.fields())
    now.push_back({field.name, entry_bytes(field), {field.extents.begin(), field.extents.end()}});
  if (file.has_events()) now.push_back({"/events", sizeof(Event)});
  const std::vector<TableMark::Field>& then = mark_.fields;
  const auto tell = [](const auto& fields, std::size_t i) {
    return i < fields.size() ? fmt::format("{} [{}] of {} bytes each", fields[i].name,
                                           fmt::join(fields[i].extents, ", "), fields[i].entry_bytes)
                             : "nothing";
  };
  for (std::size_t i = 0; i < std::max(now.size(), then.size()); ++i)
    if (tell(now, i) != tell(then, i))
      throw InputError(path_ + " does not fit this scene: as dataset " + std::to_string(i + 1) + " it has " +
                       tell(then, i) + ", now it would be " + tell(now, i) +
                       "; go on with the scene and the version of the program that wrote it");
}

void RowSource::copy_into(TableFile& file) {
  int rank = 0;
  MPI_Comm_rank(comm_, &rank);
  agreed(comm_, [&] { check_fields(file); });
  std::vector<FieldReader> readers;
  for (std::size_t i = 0; i < mark_.fields.size(); ++i) {
    const bool whole = mark_.fields[i].extents.empty();  // rank 0 has it alone
    readers.emplace_back(mark_, mark_.fields[i], file_.get(), whole ? 0 : file.fields()[i].first,
                         whole ? (rank == 0 ? 1 : 0) : file.fields()[i].count);
  }
  // A rank that cannot read must still write with the others.
  std::optional<Error> trouble;
  const auto unless_trouble = [&](const auto& work) {
    try {
      if (!trouble) work();
    } catch (const Error& error) {
      trouble = InputError(path_ + ": " + error.what() + advice);
    }
  };
  const std::vector<FieldSpec>& fields = file.fields();
  for (std::uint64_t row = 0; row < mark_.rows; ++row) {
    for (std::size_t i = 0; i < fields.size(); ++i) {
      std::byte* to = fields[i].type == FieldSpec::Type::real ? reinterpret_cast<std::byte*>(file.real(i))
                                                              : reinterpret_cast<std::byte*>(file.integer(i));
      unless_trouble([&] { std::copy_n(readers[i].next(), readers[i].row_bytes(), to); });
    }
    file.commit_row();
  }
  for (std::uint64_t event = 0; event < mark_.events;) {
    const std::uint64_t block_end = std::min(event + (1 << 16), mark_.events);
    for (; event < block_end; ++event)
      unless_trouble([&] {
        const std::byte* bytes = readers.back().next();
        if (rank != 0) return;
        Event next;
        std::memcpy(&next, bytes, sizeof next);
        file.add_event(next);
      });
    file.flush();
  }
  agree(comm_, trouble);
  std::vector<std::uint64_t> sums(readers.size());
  std::transform(readers.begin(), readers.end(), sums.begin(), [](const FieldReader& r) { return r.sum(); });
  compare(sums);
}

void RowSource::compare(std::vector<std::uint64_t> sums) const {
  int rank = 0;
  MPI_Comm_rank(comm_, &rank);
  MPI_Allreduce(MPI_IN_PLACE, sums.data(), int(sums.size()), MPI_UINT64_T, MPI_SUM, comm_);
  agreed(comm_, [&] {
    for (std::size_t i = 0; rank == 0 && i < sums.size(); ++i)
      if (sums[i] != mark_.fields[i].checksum)
        throw InputError(
            fmt::format("{}: the rows of dataset {} are not those that the checkpoint continues "
                        "(checksum {:016x}, expected {:016x}): the file is damaged, or of another run{}",
                        path_, mark_.fields[i].name, sums[i], mark_.fields[i].checksum, advice));
  });
}

}  // namespace sweepvi
