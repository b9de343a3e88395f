#include "model/opposite.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <tuple>

#include "parallel/gather.hpp"
#include "petsc/sparse.hpp"

namespace sweepvi {

namespace {

using Key = std::uint64_t;

/// Where a constraint reads and acts: opposite ones have the same.
Key pattern(const SparseRow& reads, const SparseRow& pushes) {
  Key key = 14695981039346656037U;  // FNV-1a
  const auto mix = [&](PetscInt value) { key = (key ^ static_cast<Key>(value)) * 1099511628211U; };
  for (const auto& [column, value] : reads)
    if (value != 0.0) mix(column);
  mix(-1);
  for (const auto& [column, value] : pushes)
    if (value != 0.0) mix(column);
  return key;
}

/// A constraint that shares its pattern with another one.
struct Candidate {
  PetscInt number = 0;  ///< global
  Key key = 0;
  double w0 = 0.0, wmax = PETSC_INFINITY;
  SparseRow reads, pushes;
};

/// The factor k < 0 with b = k a, if there is one.
std::optional<double> opposite_factor(const SparseRow& a, const SparseRow& b) {
  if (a.size() != b.size() || a.empty()) return {};
  const double factor = b.front().second / a.front().second;
  if (!(factor < 0.0)) return {};
  for (std::size_t k = 0; k < a.size(); ++k)
    if (a[k].first != b[k].first ||
        std::abs(b[k].second - factor * a[k].second) > rounding * std::abs(b[k].second))
      return {};
  return factor;
}

struct Merger {
  PetscInt kept, merged;  // global numbers
  double output_scale, multiplier_scale, wmax;
};

SparseRow without_zeros(SparseRow row) {
  std::erase_if(row, [](const auto& entry) { return entry.second == 0.0; });
  return row;
}

/// Rows of C and columns of B of the constraints whose pattern is not unique, on rank 0.
std::vector<Candidate> candidates(const LinearSystem& system) {
  struct Keyed {
    Key key;
    PetscInt number;
  };
  struct Entry {
    PetscInt number, column;
    int pushes;
    double value;
  };
  struct Walls {
    PetscInt number;
    Key key;
    double w0, wmax;
  };
  const MPI_Comm comm = system.comm();
  const LocalRange range = row_range(system.C.get());
  const Matrix pushed = transpose(system.B.get());
  std::vector<Keyed> keys;
  for (PetscInt a = range.first; a < range.last; ++a)
    keys.push_back({pattern(get_row(system.C.get(), a), get_row(pushed.get(), a)), a});
  std::vector<Keyed> all = gather(comm, keys);
  std::sort(all.begin(), all.end(), [](const Keyed& a, const Keyed& b) {
    return std::tie(a.key, a.number) < std::tie(b.key, b.number);
  });
  std::vector<PetscInt> shared;
  for (std::size_t i = 0; i < all.size(); ++i)
    if ((i > 0 && all[i - 1].key == all[i].key) || (i + 1 < all.size() && all[i + 1].key == all[i].key))
      shared.push_back(all[i].number);
  broadcast(comm, shared);
  std::sort(shared.begin(), shared.end());

  std::vector<Entry> entries;
  std::vector<Walls> walls;
  const ReadArray w0(system.w0.get());
  const std::optional<ReadArray> wmax = [&] {
    return system.wmax ? std::optional<ReadArray>(std::in_place, system.wmax.get()) : std::nullopt;
  }();
  for (auto a = std::lower_bound(shared.begin(), shared.end(), range.first);
       a != shared.end() && *a < range.last; ++a) {
    const PetscInt local = *a - range.first;
    walls.push_back(
        {*a, keys[static_cast<std::size_t>(local)].key, w0[local], wmax ? (*wmax)[local] : PETSC_INFINITY});
    for (const auto& [column, value] : without_zeros(get_row(system.C.get(), *a)))
      entries.push_back({*a, column, 0, value});
    for (const auto& [column, value] : without_zeros(get_row(pushed.get(), *a)))
      entries.push_back({*a, column, 1, value});
  }
  walls = gather(comm, walls);
  entries = gather(comm, entries);
  std::vector<Candidate> found;
  auto entry = entries.begin();
  for (const Walls& wall : walls) {
    Candidate& candidate = found.emplace_back();
    candidate.number = wall.number;
    candidate.key = wall.key;
    candidate.w0 = wall.w0;
    candidate.wmax = wall.wmax;
    for (; entry != entries.end() && entry->number == wall.number; ++entry)
      (entry->pushes != 0 ? candidate.pushes : candidate.reads).emplace_back(entry->column, entry->value);
  }
  return found;
}

Merger merge(const Candidate& kept, const Candidate& merged, double s, double t) {
  const double wmax = kept.w0 + merged.w0 / s;
  if (merged.wmax < PETSC_INFINITY || kept.wmax < PETSC_INFINITY)
    throw InputError(
        fmt::format("model.wmax: constraints {} and {} are opposite, and one has an upper limit too; "
                    "write them as one constraint with wmax",
                    kept.number, merged.number));
  if (!(wmax > 0.0))
    throw InputError(fmt::format(
        "model.w0: constraints {} and {} are opposite and leave no room between them: w_{} from 0 to "
        "{}; expected a positive distance",
        kept.number, merged.number, kept.number, wmax));
  return {kept.number, merged.number, s, t, wmax};
}

std::vector<Merger> find_mergers(const std::vector<Candidate>& found) {
  std::map<Key, std::vector<const Candidate*>> groups;
  for (const Candidate& candidate : found)
    groups[candidate.key].push_back(&candidate);
  std::vector<Merger> mergers;
  for (const auto& [key, group] : groups) {
    std::vector<char> taken(group.size(), 0);
    for (std::size_t i = 0; i < group.size(); ++i) {
      for (std::size_t j = i + 1; j < group.size() && taken[i] == 0; ++j) {
        if (taken[j] != 0) continue;
        const auto s = opposite_factor(group[i]->reads, group[j]->reads);
        const auto t = s ? opposite_factor(group[i]->pushes, group[j]->pushes) : std::nullopt;
        if (!t) continue;
        mergers.push_back(merge(*group[i], *group[j], -*s, -*t));
        taken[i] = taken[j] = 1;
      }
    }
  }
  std::sort(mergers.begin(), mergers.end(), [](const Merger& a, const Merger& b) { return a.kept < b.kept; });
  return mergers;
}

Matrix submatrix(Mat matrix, const std::vector<PetscInt>& rows, const std::vector<PetscInt>& columns) {
  const MPI_Comm comm = PetscObjectComm(reinterpret_cast<PetscObject>(matrix));
  const auto set = [comm](const std::vector<PetscInt>& numbers) {
    IndexSet result;
    check(ISCreateGeneral(comm, static_cast<PetscInt>(numbers.size()), numbers.data(), PETSC_COPY_VALUES,
                          result.put()));
    return result;
  };
  Matrix result;
  check(MatCreateSubMatrix(matrix, set(rows).get(), set(columns).get(), MAT_INITIAL_MATRIX, result.put()));
  return result;
}

std::vector<PetscInt> all_of(LocalRange range) {
  std::vector<PetscInt> numbers;
  for (PetscInt i = range.first; i < range.last; ++i)
    numbers.push_back(i);
  return numbers;
}

}  // namespace

void merge_opposite_constraints(LinearSystem& system) {
  if (system.D) return;
  const MPI_Comm comm = system.comm();
  std::vector<Merger> mergers;
  const std::vector<Candidate> found = candidates(system);
  agreed(comm, [&] { mergers = find_mergers(found); });  // rank 0 has them all
  broadcast(comm, mergers);
  if (mergers.empty()) return;

  std::vector<PetscInt> merged;
  merged.reserve(mergers.size());
  for (const Merger& merger : mergers)
    merged.push_back(merger.merged);
  std::sort(merged.begin(), merged.end());
  std::vector<PetscInt> order = gather(comm, system.constraint_order);
  broadcast(comm, order);

  const LocalRange range = row_range(system.C.get());
  std::vector<PetscInt> kept;
  for (PetscInt a = range.first; a < range.last; ++a)
    if (!std::binary_search(merged.begin(), merged.end(), a)) kept.push_back(a);
  Vector w0 = make_vector(comm, static_cast<PetscInt>(kept.size()));
  Vector wmax = duplicate(w0.get());
  check(VecSet(wmax.get(), PETSC_INFINITY));
  system.constraint_order.clear();
  {
    const ReadArray old_w0(system.w0.get());
    const WriteArray new_w0(w0.get());
    const WriteArray new_wmax(wmax.get());
    const std::optional<ReadArray> old_wmax = [&] {
      return system.wmax ? std::optional<ReadArray>(std::in_place, system.wmax.get()) : std::nullopt;
    }();
    for (std::size_t k = 0; k < kept.size(); ++k) {
      const auto local = static_cast<PetscInt>(k);
      new_w0[local] = old_w0[kept[k] - range.first];
      if (old_wmax) new_wmax[local] = (*old_wmax)[kept[k] - range.first];
      system.constraint_order.push_back(order[static_cast<std::size_t>(kept[k])]);
      const auto merger = std::lower_bound(mergers.begin(), mergers.end(), kept[k],
                                           [](const Merger& m, PetscInt number) { return m.kept < number; });
      if (merger == mergers.end() || merger->kept != kept[k]) continue;
      new_wmax[local] = merger->wmax;
      system.opposite.push_back({local, order[static_cast<std::size_t>(merger->merged)], merger->output_scale,
                                 merger->multiplier_scale});
    }
  }
  system.C = submatrix(system.C.get(), kept, all_of(row_range(system.A.get())));
  system.B = submatrix(system.B.get(), all_of(row_range(system.B.get())), kept);
  system.w0 = std::move(w0);
  system.wmax = std::move(wmax);
}

}  // namespace sweepvi
