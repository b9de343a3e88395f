#pragma once

#include "vi/block_kernels.hpp"
#include "vi/lanes.hpp"

// The kernels, for each file that compiles them (lanes.hpp).
namespace sweepvi {
namespace {

/// Blocks of one kind from `first` on, as many as Number has lanes. Where their size is known at compile
/// time, loops are straight code; Fixed = 0: it is not.
template <class Number, int Fixed>
class Pack {
public:
  Pack(const BlockModel& model, const BlockModel::Run& run, std::int32_t at)
      : model_(model),
        run_(run),
        kind_(model.kinds[run.kind]),
        block_(run.block + at),
        first_(run.first + static_cast<std::ptrdiff_t>(at) * size()) {}

  int size() const { return Fixed > 0 ? Fixed : kind_.size; }
  std::ptrdiff_t first() const { return first_; }
  const BlockModel::Row* rows() const { return model_.rows + kind_.rows; }
  const BlockModel::Entry* entries() const { return model_.entries + kind_.entries; }
  Number load(const double* vector, int i) const { return Number::load(vector + first_ + i, size()); }
  void store(const Number& value, double* vector, int i) const { value.store(vector + first_ + i, size()); }

  /// Calls visit(row, sum of what it reads of other blocks, sum of the absolute values).
  template <class Visit>
  void each_reader(const double* own, const double* others, Visit&& visit) const {
    const std::int32_t* const reader = model_.readers + kind_.readers;
    const int readers = kind_.readers_end - kind_.readers;
    if (run_.reading < 0) return each_reader_apart(reader, readers, own, others, visit);
    const BlockModel::Reading& reading = model_.readings[run_.reading];
    const BlockModel::FarEntry* entry = model_.far + reading.entries;
    const std::int32_t* const ends = model_.ends + reading.ends;
    for (int j = 0; j < readers; ++j) {
      const BlockModel::FarEntry* const end = model_.far + ends[j];
      Number sum = 0.0, terms = 0.0;
      for (; entry < end; ++entry) {
        const Number product = Number(entry->value) * Number::load(own + first_ + entry->offset, size());
        sum = sum + product;
        terms = terms + product.absolute();
      }
      visit(reader[j], sum, terms);
    }
  }

private:
  template <class Visit>
  void each_reader_apart(const std::int32_t* reader, int readers, const double* own, const double* others,
                         Visit&& visit) const {
    double sums[BlockKernels::largest * Number::width];   // NOLINT
    double terms[BlockKernels::largest * Number::width];  // NOLINT
    for (int lane = 0; lane < Number::width; ++lane) {
      const BlockModel::Reading& reading = model_.readings[model_.reading[block_ + lane]];
      const BlockModel::FarEntry* entry = model_.far + reading.entries;
      const std::int32_t* const ends = model_.ends + reading.ends;
      const std::ptrdiff_t first = first_ + static_cast<std::ptrdiff_t>(lane) * size();
      for (int j = 0; j < readers; ++j) {
        const BlockModel::FarEntry* const end = model_.far + ends[j];
        double sum = 0.0, its_terms = 0.0;
        for (; entry < end; ++entry) {
          const std::ptrdiff_t column = first + entry->offset;
          const double product = entry->value * (column < model_.count ? own[column] : others[column - model_.count]);
          sum += product;
          its_terms += __builtin_fabs(product);
        }
        sums[j * Number::width + lane] = sum;
        terms[j * Number::width + lane] = its_terms;
      }
    }
    for (int j = 0; j < readers; ++j)
      visit(reader[j], Number::load(sums + j * Number::width, 1), Number::load(terms + j * Number::width, 1));
  }

  const BlockModel& model_;
  const BlockModel::Run& run_;
  const BlockModel::Kind kind_;
  std::ptrdiff_t block_, first_;
};

/// Rounds over the rows of a block; in the last one, where `Watches`, whether something has moved since
/// before. Returns that.
template <bool Watches, class Number, int Fixed>
bool sweep_pack(const Pack<Number, Fixed>& pack, const BlockSweep& sweep) {
  constexpr int most = Fixed > 0 ? Fixed : BlockKernels::largest;
  const int size = pack.size();
  Number u[most], right[most], lower[most], upper[most], before[most], known[most];  // NOLINT
  for (int i = 0; i < size; ++i) {
    u[i] = pack.load(sweep.u, i);
    right[i] = pack.load(sweep.b, i);
    lower[i] = pack.load(sweep.lower, i);
    upper[i] = pack.load(sweep.upper, i);
    if (!Watches) continue;
    before[i] = u[i];
    known[i] = right[i].absolute();
  }
  pack.each_reader(sweep.u, sweep.others,
                   [&](int row, const Number& read, const Number& terms) {
                     right[row] = right[row] - read;
                     if (Watches) known[row] = known[row] + terms;
                   });
  const BlockModel::Row* const rows = pack.rows();
  const BlockModel::Entry* const entries = pack.entries();
  const auto project = [&](int i, const Number& to) {
    return Number::smaller(Number::larger(to, lower[i]), upper[i]);
  };
  for (int round = Watches ? 1 : 0; round < sweep.rounds; ++round) {
    const BlockModel::Entry* entry = entries;
    for (const BlockModel::Row* row = rows; row < rows + size; ++row) {
      Number sum = right[row->row];
      for (const BlockModel::Entry* const end = entries + row->end; entry < end; ++entry)
        sum = sum - Number(entry->value) * u[entry->column];
      u[row->row] = project(row->row, Number(row->inverse) * sum);
    }
  }
  typename Number::Mask moved = Number(0.0) < Number(0.0);
  if (Watches) {
    const BlockModel::Entry* entry = entries;
    for (const BlockModel::Row* row = rows; row < rows + size; ++row) {
      const int i = row->row;
      Number sum = right[i];
      Number terms = known[i];
      for (const BlockModel::Entry* const end = entries + row->end; entry < end; ++entry) {
        const Number product = Number(entry->value) * u[entry->column];
        sum = sum - product;
        terms = terms + product.absolute();
      }
      const Number near = Number(sweep.near * row->inverse) * terms;
      const Number to = Number(row->inverse) * sum;
      u[i] = Number::choose(to < lower[i] + near, lower[i], Number::choose(upper[i] - near < to, upper[i], to));
      moved |= Number(sweep.still * row->inverse) * terms < (u[i] - before[i]).absolute();
    }
  }
  for (int i = 0; i < size; ++i)
    pack.store(u[i], sweep.u, i);
  return Watches && moved.any();
}

// As RowJudge does, row by row.
template <class Number, int Fixed>
void judge_pack(const Pack<Number, Fixed>& pack, BlockJudge& judge) {
  constexpr double huge = 1.7976931348623157e308 / 4;  // PETSC_INFINITY: no bound
  constexpr int most = Fixed > 0 ? Fixed : BlockKernels::largest;
  const double infinity = __builtin_inf();
  const int size = pack.size();
  Number u[most], sum[most], terms[most];  // NOLINT
  for (int i = 0; i < size; ++i) {
    u[i] = pack.load(judge.u, i);
    sum[i] = Number(0.0) - pack.load(judge.b, i);
    terms[i] = pack.load(judge.b_terms, i);
  }
  pack.each_reader(judge.u, judge.others, [&](int row, const Number& read, const Number& its_terms) {
    sum[row] = sum[row] + read;
    terms[row] = terms[row] + its_terms;
  });
  const BlockModel::Entry* const entries = pack.entries();
  const BlockModel::Entry* entry = entries;
  const Number worst = judge.worst;
  typename Number::Mask exceeds = Number(0.0) < Number(0.0);
  typename Number::Mask by_distance = exceeds;
  typename Number::Mask outside = exceeds;
  Number not_finite = 0.0;
  for (const BlockModel::Row* row = pack.rows(); row < pack.rows() + size; ++row) {
    const int i = row->row;
    Number product = Number(row->diagonal) * u[i];
    Number f = product;
    Number all = product.absolute();
    for (const BlockModel::Entry* const end = entries + row->end; entry < end; ++entry) {
      product = Number(entry->value) * u[entry->column];
      f = f + product;
      all = all + product.absolute();
    }
    f = f + sum[i];
    all = all + terms[i];
    pack.store(f, judge.f, i);
    pack.store(all, judge.terms, i);
    const Number lower = pack.load(judge.lower, i);
    const Number upper = pack.load(judge.upper, i);
    const Number from_lower = Number::choose(Number(-huge) < lower, u[i] - lower, Number(infinity));
    const Number from_upper = Number::choose(upper < Number(huge), u[i] - upper, Number(-infinity));
    const Number natural = Number::larger(Number::smaller(f, from_lower), from_upper).absolute();
    not_finite = not_finite + Number(0.0) * f + Number(0.0) * all;
    exceeds |= worst * all < natural;
    by_distance |= (natural < f.absolute()) & (Number(0.0) < natural);
    outside |= u[i] < lower;
    outside |= upper < u[i];
    sum[i] = natural;
    terms[i] = all;
  }
  judge.by_distance = judge.by_distance || by_distance.any();
  judge.outside = judge.outside || outside.any();
  for (int lane = 0; lane < Number::width; ++lane)
    judge.not_finite += not_finite[lane];
  if (!exceeds.any()) return;
  for (int i = 0; i < size; ++i)
    for (int lane = 0; lane < Number::width; ++lane)
      if (sum[i][lane] > judge.worst * terms[i][lane])
        judge.worst = sum[i][lane] / terms[i][lane];  // terms = 0: infinite, as it should be
}

template <int Fixed>
void sweep_run(const BlockModel& model, const BlockModel::Run& run, BlockSweep& sweep) {
  std::int32_t at = 0;
  if (sweep.moves == nullptr) {
    for (; at + Lanes::width <= run.count; at += Lanes::width)
      sweep_pack<false>(Pack<Lanes, Fixed>(model, run, at), sweep);
    for (; at < run.count; ++at)
      sweep_pack<false>(Pack<Single, Fixed>(model, run, at), sweep);
    return;
  }
  unsigned char* moves = sweep.moves + run.pack;
  for (; at + Lanes::width <= run.count; at += Lanes::width, ++moves) {
    if (*moves == 0) continue;
    *moves = sweep_pack<true>(Pack<Lanes, Fixed>(model, run, at), sweep) ? 1 : 0;
    sweep.moved |= *moves;
  }
  for (; at < run.count; ++at, ++moves) {
    if (*moves == 0) continue;
    *moves = sweep_pack<true>(Pack<Single, Fixed>(model, run, at), sweep) ? 1 : 0;
    sweep.moved |= *moves;
  }
}

template <int Fixed>
void judge_run(const BlockModel& model, const BlockModel::Run& run, BlockJudge& judge) {
  std::int32_t at = 0;
  for (; at + Lanes::width <= run.count; at += Lanes::width)
    judge_pack(Pack<Lanes, Fixed>(model, run, at), judge);
  for (; at < run.count; ++at)
    judge_pack(Pack<Single, Fixed>(model, run, at), judge);
}

void sweep_any(const BlockModel& model, const BlockModel::Run& run, BlockSweep& sweep) {
  switch (model.kinds[run.kind].size) {
    case 1:
      return sweep_run<1>(model, run, sweep);
    case 2:
      return sweep_run<2>(model, run, sweep);
    case 4:
      return sweep_run<4>(model, run, sweep);
    case 5:
      return sweep_run<5>(model, run, sweep);
    default:
      return sweep_run<0>(model, run, sweep);
  }
}

void judge_any(const BlockModel& model, const BlockModel::Run& run, BlockJudge& judge) {
  switch (model.kinds[run.kind].size) {
    case 1:
      return judge_run<1>(model, run, judge);
    case 2:
      return judge_run<2>(model, run, judge);
    case 4:
      return judge_run<4>(model, run, judge);
    case 5:
      return judge_run<5>(model, run, judge);
    default:
      return judge_run<0>(model, run, judge);
  }
}

}  // namespace
}  // namespace sweepvi
