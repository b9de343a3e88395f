// How the fields of a TableFile lie in the file.
#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <numeric>
#include <span>
#include <vector>

#include "io/table_file.hpp"

namespace sweepvi {

inline hid_t entry_type(const FieldSpec& field) {
  return field.type == FieldSpec::Type::real ? H5T_IEEE_F64LE : H5T_STD_I32LE;
}

inline hsize_t entry_bytes(const FieldSpec& field) {
  return field.type == FieldSpec::Type::real ? sizeof(double) : sizeof(std::int32_t);
}

inline hsize_t product(std::span<const hsize_t> extents) {
  return std::accumulate(extents.begin(), extents.end(), hsize_t{1}, std::multiplies<>());
}

/// {rows, extents...}: a shape in the file.
inline std::vector<hsize_t> shape(hsize_t rows, const FieldSpec& field) {
  std::vector<hsize_t> result{rows};
  result.insert(result.end(), field.extents.begin(), field.extents.end());
  return result;
}

/// Selects [start, start + count) in both spaces, or nothing if count has a 0.
inline bool select_block(hid_t file, hid_t memory, const hsize_t* start, const std::vector<hsize_t>& count) {
  if (product(count) == 0) return H5Sselect_none(file) >= 0 && H5Sselect_none(memory) >= 0;
  return H5Sselect_hyperslab(file, H5S_SELECT_SET, start, nullptr, count.data(), nullptr) >= 0;
}

/// Chunks of 1/2 to 1 MiB: large enough to stream, small enough to read one column's history at a bearable
/// price. Rows wider than that are cut along their first extent; short files do not reserve rows they will
/// not have. Above 8 GiB chunks grow instead of becoming more, because HDF5 1.10 finds a chunk's address by
/// counting through all before it, and mark() asks for each.
inline std::vector<hsize_t> chunk_shape(const FieldSpec& field, hsize_t expected_rows) {
  constexpr hsize_t mebibyte = 1 << 20, most_chunks = 8192;
  const hsize_t row_bytes = entry_bytes(field) * product(field.extents);
  const hsize_t expected = expected_rows > 0 ? expected_rows : 1024;
  const hsize_t bytes = std::clamp(expected * row_bytes / most_chunks, mebibyte, 256 * mebibyte);
  std::vector<hsize_t> chunk = shape(std::clamp(bytes / 2 / row_bytes, hsize_t{1}, expected), field);
  if (row_bytes > bytes) {
    const hsize_t most = std::max(bytes / (row_bytes / chunk[1]), hsize_t{1});
    const hsize_t pieces = (chunk[1] + most - 1) / most;
    chunk[1] = (chunk[1] + pieces - 1) / pieces;
  }
  return chunk;
}

}  // namespace sweepvi
