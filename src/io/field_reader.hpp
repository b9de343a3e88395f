#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "io/table_mark.hpp"

namespace sweepvi {

/// How the rows of a marked field lie in its file, in bytes.
/// @throws Error (bad_input) if the mark contradicts itself
struct FieldLayout {
  FieldLayout(const TableMark& mark, const TableMark::Field& field);

  std::uint64_t rows = 0;
  std::uint64_t columns = 1;        // entries of a row along its first extent
  std::uint64_t column_bytes = 0;   // of one of them
  std::uint64_t chunk_columns = 1;  // of a chunk
  std::uint64_t pieces = 1;         // chunks side by side
  std::uint64_t stride = 0;         // from one row to the next in a chunk [B]
};

/// Reads columns [first, first + count) of a marked field's rows in order, and sums up their checksum.
class FieldReader {
public:
  /// @param file  descriptor of the file with the rows
  /// `mark` and `file` must outlive the reader.
  FieldReader(const TableMark& mark, const TableMark::Field& field, int file, std::uint64_t first,
              std::uint64_t count);

  /// The next row: row_bytes() bytes, valid until the next call.
  /// @throws Error (bad_input) if the file cannot be read
  const std::byte* next();
  std::uint64_t row_bytes() const { return count_ * layout_.column_bytes; }
  /// Of the rows taken so far, when all of them have been taken.
  std::uint64_t sum() const { return sum_; }

private:
  void load();
  void load_piece(std::uint64_t piece);
  void read(std::uint64_t address, std::uint64_t bytes, std::byte* to) const;

  const TableMark::Field& field_;
  FieldLayout layout_;
  int file_;
  std::uint64_t first_, count_;
  std::uint64_t row_ = 0;              // the next one
  std::uint64_t begin_ = 0, end_ = 0;  // rows in the buffer
  std::uint64_t sum_ = 0;
  std::vector<std::byte> buffer_, scratch_;
};

}  // namespace sweepvi
