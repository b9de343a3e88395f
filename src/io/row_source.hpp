#pragma once

#include <mpi.h>

#include <string>
#include <vector>

#include "io/posix_file.hpp"
#include "io/table_file.hpp"
#include "io/table_mark.hpp"

namespace sweepvi {

/// The rows and events that a TableFile had when it was marked, read back from its bytes; whatever happened
/// to the file's writer later. Any number of ranks may read what any number wrote.
class RowSource {
public:
  /// Opens the file; it is only read, and may be renamed or replaced while this object lives.
  /// @param folder     where the marked file is
  /// @param mark       rank 0's is used
  /// @param otherwise  names in `folder` to try in this order if there is no file `mark.file`, because the
  ///                   writer was killed between renaming its file and saying so. Rank 0's are used.
  /// @throws Error (bad_input) on every rank if there is no such file, it is shorter than the mark says, or
  ///         the mark contradicts itself
  /// @note Collective on comm, which must outlive the object.
  RowSource(MPI_Comm comm, const std::string& folder, TableMark mark,
            std::vector<std::string> otherwise = {});

  /// Appends all rows and events to `file`, which must have the same fields, then compares checksums. Needs
  /// memory for one row, or a MiB, of each field.
  /// @throws Error (bad_input) if the fields differ, or the bytes are not those that were marked: `file` is
  ///         then worth nothing. Error (output) if `file` cannot be written.
  /// @note Collective.
  void copy_into(TableFile& file);

  /// The file that is read.
  std::string path() const { return path_; }
  /// TableOptions::partial for a run that writes `path` and goes on from these rows: not the file that is
  /// read, which is needed until the new rows are marked.
  std::string partial_beside(const std::string& path) const;

private:
  void check_fields(const TableFile& file) const;
  void compare(std::vector<std::uint64_t> sums) const;

  MPI_Comm comm_;
  TableMark mark_;
  std::string path_;
  PosixFile file_;
};

}  // namespace sweepvi
