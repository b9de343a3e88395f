#pragma once

#include <fmt/format.h>

#include <string_view>
#include <vector>

#include "io/toml_table.hpp"

namespace sweepvi {

/// Complains unless `found` is rows x cols; `why` says where the sizes come from.
inline void expect_shape(const TomlValue& key, const SparseEntries& found, std::int64_t rows,
                         std::int64_t cols, std::string_view why) {
  if (found.rows != rows || found.cols != cols)
    key.fail(fmt::format("is {} x {}; expected {} x {}, as {}", found.rows, found.cols, rows, cols, why));
}

/// Complains unless `found` has `length` entries; `what` names the length.
template <class T>
void expect_length(const TomlValue& key, const std::vector<T>& found, std::int64_t length,
                   std::string_view what) {
  if (static_cast<std::int64_t>(found.size()) != length)
    key.fail(fmt::format("has {} entries; expected {} = {}", found.size(), what, length));
}

}  // namespace sweepvi
