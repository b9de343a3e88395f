#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace sweepvi {

/// Where the rows of a TableFile are on disk, as of one moment: enough to read them without HDF5, whose own
/// metadata a killed writer may leave half-written. Plain data.
///
/// Rows and events beyond `rows` and `events` may be in the file too; they are nobody's.
struct TableMark {
  /// A dataset, cut into chunks of equal size on disk, those at the edges included.
  struct Field {
    std::string name;                           ///< "/x"
    std::uint64_t entry_bytes = 8;              ///< of one number, or of one event
    std::vector<std::uint64_t> extents = {};    ///< shape of one row; empty: one entry per row
    std::vector<std::uint64_t> chunk = {};      ///< shape of a chunk: its rows, then along each extent
    std::vector<std::uint64_t> addresses = {};  ///< of the chunks from the start of the file [B], row-major
    std::uint64_t checksum = 0;                 ///< see io/checksum.hpp
  };

  std::string file;                ///< name, without folder, of the file that holds the bytes
  std::uint64_t rows = 0;          ///< of every field but `/events`
  std::uint64_t events = 0;        ///< rows of `/events`
  std::vector<Field> fields = {};  ///< in the file's order; `/events` last, if there is one
};

}  // namespace sweepvi
