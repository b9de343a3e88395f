#include "parallel/components.hpp"

#include <algorithm>
#include <map>
#include <numeric>

#include "parallel/element_graph.hpp"
#include "parallel/gather.hpp"
#include "parallel/row_move.hpp"

namespace sweepvi {

namespace {

/// Disjoint sets; each is named after its smallest member.
class Sets {
public:
  explicit Sets(std::size_t count) : parent_(count) { std::iota(parent_.begin(), parent_.end(), 0); }
  std::size_t find(std::size_t i) {
    while (parent_[i] != i)
      i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  void unite(std::size_t a, std::size_t b) {
    a = find(a);
    b = find(b);
    parent_[std::max(a, b)] = std::min(a, b);
  }

private:
  std::vector<std::size_t> parent_;
};

/// A set of one rank, and the number all ranks give to what it belongs to.
struct Named {
  PetscInt root;
  PetscInt slot;
};

/// Joins sets of different ranks, given as pairs of roots. Every root that occurs is named, on every rank.
std::vector<Named> join(MPI_Comm comm, std::vector<Edge> pairs) {
  pairs = gather(comm, pairs);
  std::map<PetscInt, std::size_t> place;
  for (const Edge& pair : pairs)
    for (const PetscInt root : {pair.first, pair.second})
      place.try_emplace(root, place.size());
  Sets sets(place.size());
  for (const Edge& pair : pairs)
    sets.unite(place[pair.first], place[pair.second]);
  std::map<std::size_t, PetscInt> slot;
  std::vector<Named> named;
  for (const auto& [root, i] : place) {
    const auto number = static_cast<PetscInt>(slot.size());
    named.push_back({root, slot.try_emplace(sets.find(i), number).first->second});
  }
  broadcast(comm, named);
  return named;
}

}  // namespace

Components::Components(Mat matrix) : comm_(PetscObjectComm(reinterpret_cast<PetscObject>(matrix))) {
  const LocalRange rows = row_range(matrix);
  const auto local = [&](PetscInt row) { return static_cast<std::size_t>(row - rows.first); };
  Sets sets(static_cast<std::size_t>(rows.size()));
  std::vector<Edge> outside;  // own row, column of another rank
  for_each_row(matrix, [&](PetscInt row, auto columns, auto) {
    for (const PetscInt column : columns) {
      if (rows.contains(column))
        sets.unite(local(row), local(column));
      else
        outside.push_back({row, column});
    }
  });
  std::vector<PetscInt> roots;
  for (PetscInt row = rows.first; row < rows.last; ++row)
    roots.push_back(rows.first + static_cast<PetscInt>(sets.find(local(row))));

  std::vector<PetscInt> asked;
  asked.reserve(outside.size());
  for (const Edge& edge : outside)
    asked.push_back(edge.second);
  const std::vector<PetscInt> other_roots = RowMove(comm_, rows.size(), asked).moved(roots);
  for (std::size_t k = 0; k < outside.size(); ++k)
    outside[k] = {roots[local(outside[k].first)], other_roots[k]};
  std::sort(outside.begin(), outside.end());
  outside.erase(std::unique(outside.begin(), outside.end()), outside.end());
  const std::vector<Named> named = join(comm_, std::move(outside));
  std::map<PetscInt, std::size_t> slot_of;
  std::size_t slots = 0;
  for (const Named& set : named) {
    slot_of.emplace(set.root, static_cast<std::size_t>(set.slot));
    slots = std::max(slots, static_cast<std::size_t>(set.slot) + 1);
  }
  slots_.assign(slots + 1, 0.0);

  // Sets of this rank that are joined elsewhere are one component.
  constexpr std::size_t none = static_cast<std::size_t>(-1);
  std::vector<std::size_t> component_of_slot(slots, none);
  std::vector<std::size_t> component_of_root(roots.size(), none);
  for (const PetscInt root : roots) {
    std::size_t& component = component_of_root[local(root)];
    if (component == none) {
      const auto found = slot_of.find(root);
      if (found == slot_of.end()) {
        component = count_++;
      } else {
        std::size_t& known = component_of_slot[found->second];
        if (known == none) {
          known = count_++;
          shared_.push_back({known, found->second});
        }
        component = known;
      }
    }
    of_row_.push_back(component);
  }
}

void Components::sum(std::vector<double>& values) const {
  std::fill(slots_.begin(), slots_.end(), 0.0);
  for (const Shared& shared : shared_)
    slots_[shared.slot] = values[shared.component];
  slots_.back() = values[count_];
  MPI_Allreduce(MPI_IN_PLACE, slots_.data(), static_cast<int>(slots_.size()), MPI_DOUBLE, MPI_SUM, comm_);
  for (const Shared& shared : shared_)
    values[shared.component] = slots_[shared.slot];
  values[count_] = slots_.back();
}

}  // namespace sweepvi
