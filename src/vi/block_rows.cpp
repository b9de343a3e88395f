#include "vi/block_rows.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "petsc/alike.hpp"
#include "petsc/sparse.hpp"
#include "vi/small_box.hpp"

namespace sweepvi {

namespace {

constexpr std::int32_t longest_run = 512;  // blocks: their part of a few vectors stays in the cache

}  // namespace

BlockRows::BlockRows(const AffineRows& rows, const std::vector<PetscInt>& block)
    : affine_(&rows), count_(rows.size()) {
  if (block.size() != static_cast<std::size_t>(count_)) return;
  Alike kinds, readings;
  std::vector<std::int32_t> kind_of;
  std::vector<char> reads_ghosts;  // by reading
  std::vector<double> own, read;
  for (PetscInt first = 0; first < count_;) {
    PetscInt end = first + 1;
    while (end < count_ && block[static_cast<std::size_t>(end)] == block[static_cast<std::size_t>(first)])
      ++end;
    if (end - first > BlockKernels::largest) return;
    const auto size = static_cast<int>(end - first);
    own.assign(static_cast<std::size_t>(size) * static_cast<std::size_t>(size), 0.0);
    std::vector<std::int32_t> readers, ends;
    std::vector<BlockModel::FarEntry> far;
    bool ghosts = false;
    for (PetscInt i = first; i < end; ++i) {
      for (const AffineRows::Entry& entry : rows.entries(i)) {
        const PetscInt column = i + entry.offset;
        if (column >= first && column < end) {
          own[static_cast<std::size_t>((i - first) * size + column - first)] = entry.value;
        } else if (entry.value != 0.0) {
          far.push_back({column - first, entry.value});
          ghosts = ghosts || column >= count_;
        }
      }
      if (far.size() == (ends.empty() ? 0 : static_cast<std::size_t>(ends.back()))) continue;
      readers.push_back(static_cast<std::int32_t>(i - first));
      ends.push_back(static_cast<std::int32_t>(far.size()));
    }

    std::vector<double> key = {static_cast<double>(size)};
    key.insert(key.end(), own.begin(), own.end());
    key.insert(key.end(), readers.begin(), readers.end());
    const auto [kind, new_kind] = kinds.number(key);
    if (new_kind) add_kind(size, own, readers);

    key.assign({ghosts ? 1.0 : 0.0, static_cast<double>(ends.size())});
    key.insert(key.end(), ends.begin(), ends.end());
    for (const BlockModel::FarEntry& entry : far)
      key.insert(key.end(), {static_cast<double>(entry.offset), entry.value});
    const auto [reading, new_reading] = readings.number(key);
    if (new_reading) {
      const auto begin = static_cast<std::int32_t>(far_.size());
      readings_.push_back({begin, static_cast<std::int32_t>(ends_.size())});
      for (const std::int32_t its_end : ends)
        ends_.push_back(begin + its_end);
      far_.insert(far_.end(), far.begin(), far.end());
      reads_ghosts.push_back(ghosts ? 1 : 0);
    }
    kind_of.push_back(kind);
    reading_.push_back(reading);
    first = end;
  }
  find_runs(kind_of, reads_ghosts);
  small_ = true;
}

void BlockRows::add_kind(int size, const std::vector<double>& own, const std::vector<std::int32_t>& readers) {
  Kind kind{size, static_cast<std::int32_t>(rows_.size()), static_cast<std::int32_t>(entries_.size()),
            static_cast<std::int32_t>(readers_.size()), 0};
  for (const int i : reading_order(own, size)) {
    const auto at = [&](int j) {
      return own[static_cast<std::size_t>(i) * static_cast<std::size_t>(size) + static_cast<std::size_t>(j)];
    };
    for (int j = 0; j < size; ++j)
      if (j != i && at(j) != 0.0) entries_.push_back({j, at(j)});
    rows_.push_back({i, static_cast<std::int32_t>(entries_.size()) - kind.entries, at(i), 1.0 / at(i)});
  }
  readers_.insert(readers_.end(), readers.begin(), readers.end());
  kind.readers_end = static_cast<std::int32_t>(readers_.size());
  kinds_.push_back(kind);
  matrices_.push_back(own);
}

// Long ones of equal readings; those between, of one kind.
void BlockRows::find_runs(const std::vector<std::int32_t>& kind_of, const std::vector<char>& reads_ghosts) {
  constexpr PetscInt worthwhile = 16;
  const auto blocks = static_cast<PetscInt>(kind_of.size());
  std::vector<PetscInt> same_until(kind_of.size());  // kind and reading, without ghosts
  for (PetscInt e = blocks; e-- > 0;) {
    const auto k = static_cast<std::size_t>(e);
    const bool goes_on = e + 1 < blocks && kind_of[k] == kind_of[k + 1] && reading_[k] == reading_[k + 1];
    same_until[k] = goes_on ? same_until[k + 1] : e + 1;
  }
  const auto is_long = [&](PetscInt e) {
    const auto k = static_cast<std::size_t>(e);
    return reads_ghosts[static_cast<std::size_t>(reading_[k])] == 0 && same_until[k] - e >= worthwhile;
  };
  PetscInt first = 0;
  for (PetscInt e = 0; e < blocks;) {
    const auto k = static_cast<std::size_t>(e);
    const bool alike = is_long(e);
    PetscInt end = alike ? std::min(same_until[k], e + longest_run) : e + 1;
    while (!alike && end < blocks && end < e + longest_run &&
           kind_of[static_cast<std::size_t>(end)] == kind_of[k] && !is_long(end))
      ++end;
    const auto kind = kind_of[k];
    const auto count = static_cast<std::int32_t>(end - e);
    runs_.push_back({first, e, packs_, count, kind, alike ? reading_[k] : -1});
    packs_ += count / BlockKernels::together + count % BlockKernels::together;
    first += (end - e) * kinds_[static_cast<std::size_t>(kind)].size;
    e = end;
  }
}

BlockModel BlockRows::model() const {
  return {kinds_.data(),    rows_.data(), entries_.data(), readers_.data(), reading_.data(),
          readings_.data(), ends_.data(), far_.data(),     count_};
}

double BlockRows::smallest_diagonal() const {
  double smallest = HUGE_VAL;
  for (const BlockModel::Row& row : rows_)
    smallest = row.diagonal < smallest ? row.diagonal : smallest;
  return smallest;
}

RowRatios BlockRows::judge(Vec u, Vec lower, Vec upper, Vec b, Vec b_terms, Vec f, Vec terms) const {
  if (!small_) return affine_->judge(u, lower, upper, b, b_terms, f, terms);
  const double* others = affine_->ghosts(u);
  const ReadArray own(u);
  const ReadArray l(lower);
  const ReadArray h(upper);
  const ReadArray right(b);
  const ReadArray right_terms(b_terms);
  const WriteArray result(f);
  const WriteArray size_of(terms);
  BlockJudge judge{own.data(),         others,        l.data(),      h.data(), right.data(),
                   right_terms.data(), result.data(), size_of.data()};
  const BlockKernels& kernels = block_kernels();
  const BlockModel model = this->model();
  for (const Run& run : runs_)
    kernels.judge(model, run, judge);
  const bool finite = !std::isnan(judge.not_finite);
  return {finite ? judge.worst : std::numeric_limits<double>::infinity(), judge.by_distance, judge.outside};
}

}  // namespace sweepvi
