#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>
#include <vector>

#include "sweepvi/linear_system.hpp"

namespace sweepvi {

/// Position in the file of what is recorded of the elements of a chain, -1 elsewhere.
class Selection {
public:
  /// @param blocks  elements to record, ascending; none: all
  /// @param count   of elements
  /// @param states  of one element
  Selection(std::optional<std::vector<std::int64_t>> blocks, PetscInt count, PetscInt states,
            StateLayout layout)
      : blocks_(std::move(blocks)), count_(count), states_(states), layout_(layout) {}

  /// Elements recorded.
  PetscInt kept() const { return blocks_ ? static_cast<PetscInt>(blocks_->size()) : count_; }

  PetscInt element(PetscInt number) const {
    if (!blocks_) return number;
    const auto at = std::lower_bound(blocks_->begin(), blocks_->end(), number);
    return at == blocks_->end() || *at != number ? -1 : static_cast<PetscInt>(at - blocks_->begin());
  }

  /// @param number  of the state in the scene
  PetscInt state(PetscInt number) const {
    const bool whole = layout_ == StateLayout::element_by_element;
    const PetscInt kept_element = element(whole ? number / states_ : number % count_);
    if (kept_element < 0) return -1;
    return whole ? states_ * kept_element + number % states_ : kept() * (number / count_) + kept_element;
  }

private:
  std::optional<std::vector<std::int64_t>> blocks_;
  PetscInt count_, states_;
  StateLayout layout_;
};

}  // namespace sweepvi
