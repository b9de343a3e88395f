#pragma once

#include "vi/block_kernels.hpp"
#include "vi/lanes.hpp"
#include "vi/negligible_residual.hpp"

// The kernels, for each file that compiles them (lanes.hpp).
// NOLINTBEGIN(cert-dcl59-cpp,misc-definitions-in-headers,cppcoreguidelines-pro-type-member-init): as said;
// numbers are filled where they are made
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
  /// The row of its block, and where what it reads of its block ends: a block of one reads nothing.
  static int place(const BlockModel::Row& row) { return Fixed == 1 ? 0 : row.row; }
  const BlockModel::Entry* end_of(const BlockModel::Row& row) const {
    return entries() + (Fixed == 1 ? 0 : row.end);
  }
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
      visit(Fixed == 1 ? 0 : reader[j], sum, terms);
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
          const double product =
              entry->value * (column < model_.count ? own[column] : others[column - model_.count]);
          sum += product;
          its_terms += __builtin_fabs(product);
        }
        sums[j * Number::width + lane] = sum;
        terms[j * Number::width + lane] = its_terms;
      }
    }
    for (int j = 0; j < readers; ++j)
      visit(Fixed == 1 ? 0 : reader[j], Number::load(sums + j * Number::width, 1),
            Number::load(terms + j * Number::width, 1));
  }

  const BlockModel& model_;
  const BlockModel::Run& run_;
  const BlockModel::Kind kind_;
  std::ptrdiff_t block_, first_;
};

/// F and its terms in a row, and what they make of u, as RowJudge has it. The natural residual goes to
/// `natural`; flags are gathered.
template <class Number>
struct RowLook {
  typename Number::Mask exceeds = Number(0.0) < Number(0.0);
  typename Number::Mask by_distance = exceeds, outside = exceeds;
  Number not_finite = 0.0;
  Number worst;
  explicit RowLook(const BlockJudge& judge) : worst(judge.worst) {}

  [[gnu::always_inline]] Number look(const Number& u, const Number& f, const Number& terms,
                                     const Number& lower, const Number& upper) {
    constexpr double huge = 1.7976931348623157e308 / 4;  // PETSC_INFINITY: no bound
    const double infinity = __builtin_inf();
    const Number from_lower = Number::choose(Number(-huge) < lower, u - lower, Number(infinity));
    const Number from_upper = Number::choose(upper < Number(huge), u - upper, Number(-infinity));
    const Number natural = Number::larger(Number::smaller(f, from_lower), from_upper).absolute();
    not_finite = not_finite + Number(0.0) * f + Number(0.0) * terms;
    exceeds |= worst * terms < natural;
    by_distance |= (natural < f.absolute()) & (Number(0.0) < natural);
    outside |= Number::not_ordered(lower, u);
    outside |= Number::not_ordered(u, upper);
    return natural;
  }
  /// @return whether some row is worse than any before
  bool tell(BlockJudge& judge) const {
    judge.by_distance = judge.by_distance || by_distance.any();
    judge.outside = judge.outside || outside.any();
    for (int lane = 0; lane < Number::width; ++lane)
      judge.not_finite += not_finite[lane];
    return exceeds.any();
  }
  static void take_worst(const Number& natural, const Number& terms, BlockJudge& judge) {
    for (int lane = 0; lane < Number::width; ++lane)
      if (natural[lane] > judge.worst * terms[lane] && natural[lane] > negligible_residual)
        judge.worst = natural[lane] / terms[lane];  // terms = 0: infinite, as it should be
  }
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
  pack.each_reader(sweep.u, sweep.others, [&](int row, const Number& read, const Number& terms) {
    right[row] = right[row] - read;
    if (Watches) known[row] = known[row] + terms;
  });
  const BlockModel::Row* const rows = pack.rows();
  const auto project = [&](int i, const Number& to) {
    return Number::smaller(Number::larger(to, lower[i]), upper[i]);
  };
  for (int round = Watches ? 1 : 0; round < sweep.rounds; ++round) {
    const BlockModel::Entry* entry = pack.entries();
    for (const BlockModel::Row* row = rows; row < rows + size; ++row) {
      const int i = pack.place(*row);
      Number sum = right[i];
      for (const BlockModel::Entry* const end = pack.end_of(*row); entry < end; ++entry)
        sum = sum - Number(entry->value) * u[entry->column];
      u[i] = project(i, Number(row->inverse) * sum);
    }
  }
  typename Number::Mask moved = Number(0.0) < Number(0.0);
  if (Watches) {
    const BlockModel::Entry* entry = pack.entries();
    for (const BlockModel::Row* row = rows; row < rows + size; ++row) {
      const int i = pack.place(*row);
      Number sum = right[i];
      Number terms = known[i];
      for (const BlockModel::Entry* const end = pack.end_of(*row); entry < end; ++entry) {
        const Number product = Number(entry->value) * u[entry->column];
        sum = sum - product;
        terms = terms + product.absolute();
      }
      const Number near = Number(sweep.near * row->inverse) * terms;
      const Number to = Number(row->inverse) * sum;
      u[i] =
          Number::choose(to < lower[i] + near, lower[i], Number::choose(upper[i] - near < to, upper[i], to));
      moved |= Number(sweep.still * row->inverse) * terms < (u[i] - before[i]).absolute();
    }
  }
  for (int i = 0; i < size; ++i)
    pack.store(u[i], sweep.u, i);
  return Watches && moved.any();
}

template <class Number, int Fixed>
void judge_pack(const Pack<Number, Fixed>& pack, BlockJudge& judge) {
  constexpr int most = Fixed > 0 ? Fixed : BlockKernels::largest;
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
  const BlockModel::Entry* entry = pack.entries();
  RowLook<Number> rows_look(judge);
  for (const BlockModel::Row* row = pack.rows(); row < pack.rows() + size; ++row) {
    const int i = pack.place(*row);
    Number product = Number(row->diagonal) * u[i];
    Number f = product;
    Number all = product.absolute();
    for (const BlockModel::Entry* const end = pack.end_of(*row); entry < end; ++entry) {
      product = Number(entry->value) * u[entry->column];
      f = f + product;
      all = all + product.absolute();
    }
    f = f + sum[i];
    all = all + terms[i];
    pack.store(f, judge.f, i);
    pack.store(all, judge.terms, i);
    sum[i] = rows_look.look(u[i], f, all, pack.load(judge.lower, i), pack.load(judge.upper, i));
    terms[i] = all;
  }
  if (!rows_look.tell(judge)) return;
  for (int i = 0; i < size; ++i)
    RowLook<Number>::take_worst(sum[i], terms[i], judge);
}

/// Blocks of one unknown that read others alike: rows of one kind, Count entries besides the diagonal. What
/// is read of the model then stays in registers.
template <int Count>
struct SingleRows {
  SingleRows(const BlockModel& model, const BlockModel::Run& run) {
    const BlockModel::Row& row = model.rows[model.kinds[run.kind].rows];
    const BlockModel::FarEntry* const entries = model.far + model.readings[run.reading].entries;
    diagonal = row.diagonal;
    inverse = row.inverse;
    for (int k = 0; k < Count; ++k) {
      value[k] = entries[k].value;
      offset[k] = entries[k].offset;
    }
  }
  /// What the rows from `at` on read of others, and the sum of the absolute values.
  template <class Number>
  void read(const double* at, Number& sum, Number& terms) const {
    sum = terms = 0.0;
    for (int k = 0; k < Count; ++k) {
      const Number product = Number(value[k]) * Number::load(at + offset[k], 1);
      sum = sum + product;
      terms = terms + product.absolute();
    }
  }
  double diagonal, inverse;
  double value[Count > 0 ? Count : 1];           // NOLINT
  std::ptrdiff_t offset[Count > 0 ? Count : 1];  // NOLINT
};

template <bool Watches, class Number, int Count>
bool sweep_single(const SingleRows<Count>& rows, std::ptrdiff_t i, const BlockSweep& sweep) {
  const Number before = Number::load(sweep.u + i, 1);
  const Number right = Number::load(sweep.b + i, 1);
  const Number lower = Number::load(sweep.lower + i, 1);
  const Number upper = Number::load(sweep.upper + i, 1);
  Number read, terms;
  rows.read(sweep.u + i, read, terms);
  Number to = Number(rows.inverse) * (right - read);
  if (!Watches) {
    Number::smaller(Number::larger(to, lower), upper).store(sweep.u + i, 1);
    return false;
  }
  terms = Number(rows.inverse) * (terms + right.absolute());
  const Number near = Number(sweep.near) * terms;
  to = Number::choose(to < lower + near, lower, Number::choose(upper - near < to, upper, to));
  to.store(sweep.u + i, 1);
  return (Number(sweep.still) * terms < (to - before).absolute()).any();
}

template <bool Value>
struct Choice {
  static constexpr bool value = Value;
};

/// Calls one(whether it is to watch, a number of the kind to compute with, the first block) for the packs of
/// a run.
template <class One>
void sweep_packs(const BlockModel::Run& run, BlockSweep& sweep, One&& one) {
  std::int32_t at = 0;
  if (sweep.moves == nullptr) {
    for (; at + Lanes::width <= run.count; at += Lanes::width)
      one(Choice<false>(), Lanes(), at);
    for (; at < run.count; ++at)
      one(Choice<false>(), Single(), at);
    return;
  }
  unsigned char* moves = sweep.moves + run.pack;
  for (; at + Lanes::width <= run.count; at += Lanes::width, ++moves) {
    if (*moves == 0) continue;
    *moves = one(Choice<true>(), Lanes(), at) ? 1 : 0;
    sweep.moved |= *moves;
  }
  for (; at < run.count; ++at, ++moves) {
    if (*moves == 0) continue;
    *moves = one(Choice<true>(), Single(), at) ? 1 : 0;
    sweep.moved |= *moves;
  }
}
template <class Number, int Count>
void judge_single(const SingleRows<Count>& rows, std::ptrdiff_t i, BlockJudge& judge) {
  const Number u = Number::load(judge.u + i, 1);
  Number read, terms;
  rows.read(judge.u + i, read, terms);
  const Number own = Number(rows.diagonal) * u;
  const Number f = own + read - Number::load(judge.b + i, 1);
  terms = own.absolute() + terms + Number::load(judge.b_terms + i, 1);
  f.store(judge.f + i, 1);
  terms.store(judge.terms + i, 1);
  RowLook<Number> look(judge);
  const Number natural =
      look.look(u, f, terms, Number::load(judge.lower + i, 1), Number::load(judge.upper + i, 1));
  if (look.tell(judge)) RowLook<Number>::take_worst(natural, terms, judge);
}

template <int Count>
void sweep_singles(const BlockModel& model, const BlockModel::Run& run, BlockSweep& sweep) {
  const SingleRows<Count> rows(model, run);
  sweep_packs(run, sweep, [&](auto watches, auto number, std::int32_t at) {
    return sweep_single<decltype(watches)::value, decltype(number)>(rows, run.first + at, sweep);
  });
}

template <int Fixed>
void sweep_run(const BlockModel& model, const BlockModel::Run& run, BlockSweep& sweep) {
  sweep_packs(run, sweep, [&](auto watches, auto number, std::int32_t at) {
    return sweep_pack<decltype(watches)::value>(Pack<decltype(number), Fixed>(model, run, at), sweep);
  });
}

/// Calls one(a number of the kind to compute with, the first block) for the packs of a run.
template <class One>
void judge_packs(const BlockModel::Run& run, One&& one) {
  std::int32_t at = 0;
  for (; at + Lanes::width <= run.count; at += Lanes::width)
    one(Lanes(), at);
  for (; at < run.count; ++at)
    one(Single(), at);
}

template <int Count>
void judge_singles(const BlockModel& model, const BlockModel::Run& run, BlockJudge& judge) {
  const SingleRows<Count> rows(model, run);
  judge_packs(run, [&](auto number, std::int32_t at) {
    judge_single<decltype(number)>(rows, run.first + at, judge);
  });
}

template <int Fixed>
void judge_run(const BlockModel& model, const BlockModel::Run& run, BlockJudge& judge) {
  judge_packs(run, [&](auto number, std::int32_t at) {
    judge_pack(Pack<decltype(number), Fixed>(model, run, at), judge);
  });
}

/// What a row of rows of one kind reads of others: entries; below 0: not all alike.
int entries_of_singles(const BlockModel& model, const BlockModel::Run& run) {
  const BlockModel::Kind& kind = model.kinds[run.kind];
  if (kind.size != 1 || run.reading < 0) return -1;
  if (kind.readers == kind.readers_end) return 0;
  const BlockModel::Reading& reading = model.readings[run.reading];
  return model.ends[reading.ends] - reading.entries;
}

void sweep_any(const BlockModel& model, const BlockModel::Run& run, BlockSweep& sweep) {
  switch (entries_of_singles(model, run)) {
    case 0:
      return sweep_singles<0>(model, run, sweep);
    case 1:
      return sweep_singles<1>(model, run, sweep);
    case 2:
      return sweep_singles<2>(model, run, sweep);
    case 3:
      return sweep_singles<3>(model, run, sweep);
    case 4:
      return sweep_singles<4>(model, run, sweep);
    default:
      break;
  }
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
  switch (entries_of_singles(model, run)) {
    case 0:
      return judge_singles<0>(model, run, judge);
    case 1:
      return judge_singles<1>(model, run, judge);
    case 2:
      return judge_singles<2>(model, run, judge);
    case 3:
      return judge_singles<3>(model, run, judge);
    case 4:
      return judge_singles<4>(model, run, judge);
    default:
      break;
  }
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
// NOLINTEND(cert-dcl59-cpp,misc-definitions-in-headers,cppcoreguidelines-pro-type-member-init)
