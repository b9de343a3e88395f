#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <vector>

namespace sweepvi {

/// What a multiplier's row of the tridiagonal matrix holds, as ranks send it to rank 0.
struct PathRow {
  double number = 0.0;    // of the unknown
  double diagonal = 0.0;  // 0: the row does not fit
  std::array<double, 2> neighbour{-1.0, -1.0}, value{0.0, 0.0};
};

/// Multipliers on paths, in an order in which neighbours stand side by side.
class Paths {
public:
  /// @param rows  by increasing number
  explicit Paths(const std::vector<PathRow>& rows) : rows_(rows), links_(rows.size(), {-1, -1}) {
    fits_ = link() && walk();
  }
  bool fit() const { return fits_; }
  const std::vector<std::size_t>& order() const { return order_; }
  /// Entry of two that stand side by side.
  double value(std::size_t i, std::size_t j) const {
    for (int k = 0; k < 2; ++k)
      if (rows_[i].neighbour[static_cast<std::size_t>(k)] == rows_[j].number)
        return rows_[i].value[static_cast<std::size_t>(k)];
    return 0.0;
  }

private:
  bool add(std::size_t i, std::ptrdiff_t j) {
    for (std::ptrdiff_t& link : links_[i]) {
      if (link == j) return true;
      if (link < 0) {
        link = j;
        return true;
      }
    }
    return false;
  }
  bool link() {
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      if (!(rows_[i].diagonal > 0.0)) return false;
      for (const double number : rows_[i].neighbour) {
        if (number < 0.0) continue;
        const auto at = std::lower_bound(rows_.begin(), rows_.end(), number,
                                         [](const PathRow& row, double n) { return row.number < n; });
        if (at == rows_.end() || at->number != number) return false;
        const auto j = at - rows_.begin();
        if (!add(i, j) || !add(static_cast<std::size_t>(j), static_cast<std::ptrdiff_t>(i))) return false;
      }
    }
    return true;
  }
  bool walk() {
    std::vector<char> seen(rows_.size(), 0);
    for (std::size_t start = 0; start < rows_.size(); ++start) {
      if (seen[start] != 0 || links_[start][1] >= 0) continue;  // begins no path
      for (auto at = static_cast<std::ptrdiff_t>(start); at >= 0;) {
        const auto i = static_cast<std::size_t>(at);
        seen[i] = 1;
        order_.push_back(i);
        at = -1;
        for (const std::ptrdiff_t link : links_[i])
          if (link >= 0 && seen[static_cast<std::size_t>(link)] == 0) at = link;
      }
    }
    return order_.size() == rows_.size();  // what is left are rings
  }

  const std::vector<PathRow>& rows_;
  std::vector<std::array<std::ptrdiff_t, 2>> links_;
  std::vector<std::size_t> order_;
  bool fits_ = false;
};

}  // namespace sweepvi
