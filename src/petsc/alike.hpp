#pragma once

#include <cstdint>
#include <map>
#include <utility>
#include <vector>

namespace sweepvi {

/// Numbers what is equal; beyond so many different ones it is no longer looked for.
class Alike {
public:
  /// @return the number of `what`, and whether it is new
  std::pair<std::int32_t, bool> number(const std::vector<double>& what) {
    if (count_ > 0 && what == last_) return {last_number_, false};
    bool is_new = true;
    std::int32_t number = count_;
    if (known_.size() < most) {
      const auto [at, inserted] = known_.try_emplace(what, count_);
      is_new = inserted;
      number = at->second;
    }
    if (is_new) ++count_;
    last_ = what;
    last_number_ = number;
    return {number, is_new};
  }

private:
  static constexpr std::size_t most = 1000;
  std::map<std::vector<double>, std::int32_t> known_;
  std::vector<double> last_;
  std::int32_t last_number_ = 0, count_ = 0;
};

}  // namespace sweepvi
