#include "io/field_reader.hpp"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <limits>
#include <string>

#include "io/checksum.hpp"
#include "sweepvi/error.hpp"

namespace sweepvi {
namespace {

constexpr std::uint64_t window_bytes = 1 << 20;

/// a*b; numbers from a file may be anything.
std::uint64_t times(std::uint64_t a, std::uint64_t b) {
  if (b != 0 && a > std::numeric_limits<std::int64_t>::max() / b)
    throw InputError("the checkpoint's list of rows makes no sense: sizes beyond 2^63");
  return a * b;
}

std::uint64_t quotient_up(std::uint64_t a, std::uint64_t b) {
  return a / b + (a % b != 0 ? 1 : 0);
}

}  // namespace

FieldLayout::FieldLayout(const TableMark& mark, const TableMark::Field& field)
    : column_bytes(field.entry_bytes) {
  rows = field.name == "/events" ? mark.events : mark.rows;
  const auto need = [&](bool good, const char* what) {
    if (!good) throw InputError("the checkpoint's list of rows makes no sense: " + field.name + what);
  };
  need(field.entry_bytes > 0 && field.entry_bytes % 4 == 0, " has entries of an odd size");
  need(field.chunk.size() == field.extents.size() + 1, " and its chunks differ in dimensions");
  need(std::count(field.extents.begin(), field.extents.end(), 0u) == 0, " has an extent of 0");
  need(std::count(field.chunk.begin(), field.chunk.end(), 0u) == 0, " has chunks of nothing");
  if (!field.extents.empty()) {
    columns = field.extents[0];
    chunk_columns = field.chunk[1];
    for (std::size_t i = 1; i < field.extents.size(); ++i) {
      column_bytes = times(column_bytes, field.extents[i]);
      need(field.chunk[i + 1] == field.extents[i], " is cut into chunks along a later extent");
    }
  }
  times(times(columns, column_bytes), rows);
  pieces = quotient_up(columns, chunk_columns);
  stride = times(chunk_columns, column_bytes);
  times(stride, field.chunk[0]);
  const std::uint64_t slabs = quotient_up(rows, field.chunk[0]);
  need(field.addresses.size() == times(slabs, pieces), " does not say where each chunk is");
}

FieldReader::FieldReader(const TableMark& mark, const TableMark::Field& field, int file, std::uint64_t first,
                         std::uint64_t count)
    : field_(field), layout_(mark, field), file_(file), first_(first), count_(count) {}

const std::byte* FieldReader::next() {
  if (row_ == end_) load();
  return buffer_.data() + (row_++ - begin_) * row_bytes();
}

/// Rows of one slab, as many as fit into the window. As we read all rows in order, each is loaded once.
void FieldReader::load() {
  begin_ = end_;
  const std::uint64_t to_next_slab = field_.chunk[0] - begin_ % field_.chunk[0];
  const std::uint64_t fitting = std::max<std::uint64_t>(window_bytes / layout_.stride, 1);
  end_ = begin_ + std::min({to_next_slab, fitting, layout_.rows - begin_});
  if (count_ == 0) return;
  buffer_.resize((end_ - begin_) * row_bytes());
  for (std::uint64_t piece = first_ / layout_.chunk_columns; piece * layout_.chunk_columns < first_ + count_;
       ++piece)
    load_piece(piece);
  for (std::uint64_t row = begin_; row < end_; ++row) {
    const std::uint64_t inner = layout_.column_bytes / field_.entry_bytes;
    sum_ += checksum(buffer_.data() + (row - begin_) * row_bytes(), count_ * inner, field_.entry_bytes,
                     (row * layout_.columns + first_) * inner);
  }
}

void FieldReader::load_piece(std::uint64_t piece) {
  const std::uint64_t corner = piece * layout_.chunk_columns;
  const std::uint64_t from = std::max(first_, corner);
  const std::uint64_t to = std::min(first_ + count_, corner + layout_.chunk_columns);
  const std::uint64_t bytes = (to - from) * layout_.column_bytes, rows = end_ - begin_;
  const std::uint64_t address = field_.addresses[begin_ / field_.chunk[0] * layout_.pieces + piece] +
                                begin_ % field_.chunk[0] * layout_.stride +
                                (from - corner) * layout_.column_bytes;
  std::byte* to_here = buffer_.data() + (from - first_) * layout_.column_bytes;
  if (layout_.stride - bytes > 4096) {  // less than a page is read faster than skipped
    for (std::uint64_t row = 0; row < rows; ++row)
      read(address + row * layout_.stride, bytes, to_here + row * row_bytes());
    return;
  }
  scratch_.resize((rows - 1) * layout_.stride + bytes);
  read(address, scratch_.size(), scratch_.data());
  for (std::uint64_t row = 0; row < rows; ++row)
    std::memcpy(to_here + row * row_bytes(), scratch_.data() + row * layout_.stride, bytes);
}

void FieldReader::read(std::uint64_t address, std::uint64_t bytes, std::byte* to) const {
  while (bytes > 0) {
    const ssize_t done = pread(file_, to, bytes, off_t(address));
    if (done < 0 && errno == EINTR) continue;
    if (done <= 0)
      throw InputError("cannot read the rows of " + field_.name + " at byte " + std::to_string(address) +
                       ": " + (done < 0 ? std::strerror(errno) : "the file ends there"));
    address += std::uint64_t(done);
    bytes -= std::uint64_t(done);
    to += done;
  }
}

}  // namespace sweepvi
