#include "vi/path_sweeps.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "petsc/sparse.hpp"
#include "vi/paths.hpp"

namespace sweepvi {

namespace {

constexpr int most_sweeps = 12;
constexpr double settled = 1e-16;  // change of a state over the terms of its row
constexpr double sum_rounding =
    2.0 * std::numeric_limits<double>::epsilon();  // of an output: nothing to push against, and a small
                                                   // state next to a large one would feel it

std::vector<double> ghost_values(const AffineRows& rows, Vec u, std::size_t count) {
  const double* others = rows.ghosts(u);
  return others == nullptr ? std::vector<double>{} : std::vector<double>(others, others + count);
}

}  // namespace

PathSweeps::PathSweeps(MPI_Comm comm, const AffineRows& rows, const std::vector<int>& level)
    : comm_(comm), rows_(rows), count_(rows.size()) {
  MPI_Comm_size(comm, &ranks_);
  change_ = make_vector(comm, count_);
  rate_ = find_phases(level) ? 0.0 : HUGE_VAL;
  if (rate_ == 0.0 && !exact_) find_rate();
  if (!worthwhile()) phases_.clear();
}

// Which unknowns are taken together, and whether they lie on paths.
bool PathSweeps::find_phases(const std::vector<int>& level) {
  const auto ghosts = static_cast<std::size_t>(rows_.ghost_count());
  int highest = level.empty() ? 0 : *std::max_element(level.begin(), level.end());
  MPI_Allreduce(MPI_IN_PLACE, &highest, 1, MPI_INT, MPI_MAX, comm_);
  if (highest == 0) return false;

  // Phase of each unknown: of a multiplier, that of its level; of a state, that of the highest level whose
  // outputs read it.
  const Vector marks = duplicate(change_.get());
  const auto local = [this](PetscInt column) { return column < count_; };
  std::vector<double> phase(static_cast<std::size_t>(count_), highest);
  std::vector<double> number;
  PetscInt first = 0;
  check(VecGetOwnershipRange(marks.get(), &first, nullptr));
  {
    const WriteArray values(marks.get());
    for (PetscInt i = 0; i < count_; ++i)
      values[i] = static_cast<double>(first + i);
  }
  const std::vector<double> ghost_number = ghost_values(rows_, marks.get(), ghosts);
  const auto number_of = [&](PetscInt column) {
    return local(column) ? first + column
                         : static_cast<PetscInt>(ghost_number[static_cast<std::size_t>(column - count_)]);
  };
  const auto each_entry = [&](PetscInt i, auto&& visit) {
    for (const auto& [offset, value] : rows_.entries(i))
      if (value != 0.0) visit(i + offset, value);
  };
  for (int now = 1; now <= highest; ++now) {
    check(VecSet(marks.get(), 0.0));
    for (PetscInt i = 0; i < count_; ++i) {
      if (level[static_cast<std::size_t>(i)] != now) continue;
      each_entry(i, [&](PetscInt column, double) {
        check(VecSetValue(marks.get(), number_of(column), 1.0, ADD_VALUES));
      });
    }
    check(VecAssemblyBegin(marks.get()));
    check(VecAssemblyEnd(marks.get()));
    const ReadArray read(marks.get());
    for (PetscInt i = 0; i < count_; ++i)
      if (level[static_cast<std::size_t>(i)] == 0 ? read[i] > 0.0 : level[static_cast<std::size_t>(i)] == now)
        phase[static_cast<std::size_t>(i)] = highest - now;
  }
  const auto ghosts_of = [&](auto&& of) {
    {
      const WriteArray values(marks.get());
      for (PetscInt i = 0; i < count_; ++i)
        values[i] = of(static_cast<std::size_t>(i));
    }
    return ghost_values(rows_, marks.get(), ghosts);
  };
  const std::vector<double> ghost_phase = ghosts_of([&](std::size_t i) { return phase[i]; });
  const std::vector<double> ghost_level =
      ghosts_of([&](std::size_t i) { return static_cast<double>(level[i]); });
  const auto phase_of = [&](PetscInt column) {
    return local(column) ? phase[static_cast<std::size_t>(column)]
                         : ghost_phase[static_cast<std::size_t>(column - count_)];
  };
  const auto is_state = [&](PetscInt column) {
    return (local(column) ? level[static_cast<std::size_t>(column)]
                          : ghost_level[static_cast<std::size_t>(column - count_)]) == 0;
  };

  phases_.resize(static_cast<std::size_t>(highest) + 1);
  int good = 1;
  int exact = 1;
  for (PetscInt i = 0; i < count_; ++i)
    if (level[static_cast<std::size_t>(i)] != 0) multiplier_.push_back(i);
  for (int p = 0; p <= highest; ++p) {
    Phase& here = phases_[static_cast<std::size_t>(p)];
    here.level = highest - p;
    for (PetscInt i = count_; i-- > 0;) {  // rates first, what they change after them
      if (phase[static_cast<std::size_t>(i)] != p || level[static_cast<std::size_t>(i)] != 0) continue;
      double diagonal = 0.0;
      each_entry(i, [&](PetscInt column, double value) {
        if (column == i) diagonal = value;
      });
      if (!(diagonal > 0.0)) good = 0;
      here.states.push_back(i);
      here.inverse.push_back(1.0 / diagonal);
      each_entry(i, [&](PetscInt column, double value) {
        if (column == i) return;
        here.reads.entries.push_back({column, value});
        const double of = phase_of(column);
        if (!is_state(column)) {
          if (of == p) here.pushes.entries.push_back({column, -value / diagonal});
          if (of > p) exact = 0;
        } else if (of > p || (of == p && !(p == highest && local(column) && column > i))) {
          exact = 0;
        }
      });
      here.reads.end_row();
      here.pushes.end_row();
    }
    for (std::size_t k = 0; k < multiplier_.size(); ++k) {
      const PetscInt i = multiplier_[k];
      if (phase[static_cast<std::size_t>(i)] != p) continue;
      here.multipliers.push_back(static_cast<PetscInt>(k));
      each_entry(i, [&](PetscInt column, double) {
        if (phase_of(column) > p) exact = 0;
      });
    }
  }
  MPI_Allreduce(MPI_IN_PLACE, &good, 1, MPI_INT, MPI_LAND, comm_);
  MPI_Allreduce(MPI_IN_PLACE, &exact, 1, MPI_INT, MPI_LAND, comm_);
  exact_ = exact != 0;
  if (good == 0) return false;
  for (Phase& here : phases_) {
    if (here.level == 0) continue;
    // G restricted to this phase's states, times D^-1 E, and H.
    RowBuilder G, E, H;
    std::size_t next = here.states.size();
    for (PetscInt i = 0; i < count_; ++i) {
      const bool of_phase = phase[static_cast<std::size_t>(i)] == highest - here.level;
      if (of_phase && level[static_cast<std::size_t>(i)] != 0)
        each_entry(i, [&](PetscInt column, double value) {
          if (phase_of(column) != highest - here.level) return;
          (is_state(column) ? G : H).add(number_of(column), value);
        });
      if (of_phase && level[static_cast<std::size_t>(i)] == 0) {
        --next;
        for (auto k = here.pushes.starts[next]; k < here.pushes.starts[next + 1]; ++k) {
          const Entry& entry = here.pushes.entries[static_cast<std::size_t>(k)];
          E.add(number_of(entry.column), entry.value);
        }
      }
      G.end_row();
      E.end_row();
      H.end_row();
    }
    const Matrix g = G.finish(comm_, count_);
    const Matrix e = E.finish(comm_, count_);
    const Matrix product = multiply_clean(g.get(), e.get());
    if (!find_paths(here, add(product.get(), 1.0, H.finish(comm_, count_).get()).get())) return false;
    // In their order.
    for (const PetscInt k : here.multipliers) {
      each_entry(multiplier_[static_cast<std::size_t>(k)], [&](PetscInt column, double value) {
        here.outputs.entries.push_back({column, value});
      });
      here.outputs.end_row();
    }
  }
  return true;
}

// On rank 0; on a single rank, the multipliers are put in the order of their paths.
bool PathSweeps::find_paths(Phase& phase, Mat tridiagonal) {
  const PetscInt first = row_range(tridiagonal).first;
  std::vector<PathRow> own;
  for (const PetscInt k : phase.multipliers) {
    const PetscInt number = first + multiplier_[static_cast<std::size_t>(k)];
    PathRow row{static_cast<double>(number), 0.0};
    std::size_t neighbours = 0;
    for (const auto& [column, value] : get_row(tridiagonal, number)) {
      if (column == number) {
        row.diagonal = value;
      } else if (value != 0.0 && neighbours < 2) {
        row.neighbour[neighbours] = static_cast<double>(column);
        row.value[neighbours++] = value;
      } else if (value != 0.0) {
        row.diagonal = 0.0;
        break;
      }
    }
    own.push_back(row);
  }
  constexpr int width = sizeof(PathRow) / sizeof(double);
  int rank = 0;
  MPI_Comm_rank(comm_, &rank);
  const int size = width * static_cast<int>(own.size());
  std::vector<int> sizes(static_cast<std::size_t>(ranks_)), starts(static_cast<std::size_t>(ranks_), 0);
  MPI_Gather(&size, 1, MPI_INT, sizes.data(), 1, MPI_INT, 0, comm_);
  for (std::size_t r = 1; r < sizes.size(); ++r)
    starts[r] = starts[r - 1] + sizes[r - 1];
  std::vector<PathRow> all(rank == 0 ? static_cast<std::size_t>((starts.back() + sizes.back()) / width) : 0);
  MPI_Gatherv(own.data(), size, MPI_DOUBLE, all.data(), sizes.data(), starts.data(), MPI_DOUBLE, 0, comm_);

  const Paths paths(all);
  int good = paths.fit() ? 1 : 0;
  std::vector<PetscInt> numbers;
  if (good != 0) {
    const std::vector<std::size_t>& order = paths.order();
    std::vector<double> lower, diagonal, upper;
    for (std::size_t i = 0; i < order.size(); ++i) {
      lower.push_back(i > 0 ? paths.value(order[i], order[i - 1]) : 0.0);
      diagonal.push_back(all[order[i]].diagonal);
      upper.push_back(i + 1 < order.size() ? paths.value(order[i], order[i + 1]) : 0.0);
      numbers.push_back(static_cast<PetscInt>(all[order[i]].number));
    }
    phase.paths = TridiagonalLcp(std::move(lower), std::move(diagonal), std::move(upper));
    good = phase.paths.is_m_matrix() ? 1 : 0;
  }
  MPI_Bcast(&good, 1, MPI_INT, 0, comm_);
  if (good == 0) return false;
  if (ranks_ == 1) {
    std::vector<PetscInt> in_order;
    for (const std::size_t i : paths.order())
      in_order.push_back(phase.multipliers[i]);
    phase.multipliers = std::move(in_order);
    return true;
  }
  const auto total = static_cast<PetscInt>(numbers.size());
  check(VecCreateSeq(PETSC_COMM_SELF, total, phase.gathered.put()));
  IndexSet from;
  check(ISCreateGeneral(PETSC_COMM_SELF, total, numbers.data(), PETSC_COPY_VALUES, from.put()));
  check(VecScatterCreate(change_.get(), from.get(), phase.gathered.get(), nullptr, phase.to_paths.put()));
  return true;
}

// How a vector that is any at first shrinks over three sweeps of the homogeneous problem, with all
// multipliers free and with none.
void PathSweeps::find_rate() {
  constexpr int sweeps = 3;
  constexpr double nothing = 1e-9;  // of what was there at first
  const Vector u = duplicate(change_.get());
  const Vector zero = duplicate(change_.get());
  check(VecSet(zero.get(), 0.0));
  int rank = 0;
  MPI_Comm_rank(comm_, &rank);
  const auto size_of = [&] {
    const ReadArray values(u.get());
    double largest = 0.0;
    for (const Phase& phase : phases_)
      for (const PetscInt i : phase.states)
        largest = std::max(largest, std::abs(values[i]));
    MPI_Allreduce(MPI_IN_PLACE, &largest, 1, MPI_DOUBLE, MPI_MAX, comm_);
    return largest;
  };
  for (const Bounds bounds : {Bounds::none, Bounds::all_at}) {
    {
      std::mt19937 generator(1U + static_cast<unsigned>(rank));
      std::uniform_real_distribution<double> number(-1.0, 1.0);
      const WriteArray values(u.get());
      for (PetscInt i = 0; i < count_; ++i)
        values[i] = number(generator);
      for (const PetscInt i : multiplier_)
        values[i] = 0.0;
    }
    double largest = 0.0;
    const double start = size_of();
    double before = start;
    for (int k = 0; k < sweeps; ++k) {
      sweep(u.get(), zero.get(), bounds, {});
      const double now = size_of();
      if (k > 0 && before > nothing * start) largest = std::max(largest, now / before);
      if (!std::isfinite(now)) largest = HUGE_VAL;
      before = now;
    }
    rate_ = std::max(rate_, largest);
  }
}

bool PathSweeps::fits(const double* lower, const double* upper, const std::vector<char>& pinned) {
  int good = 1;
  for (std::size_t k = 0; k < multiplier_.size(); ++k) {
    if (k < pinned.size() && pinned[k] != 0) continue;
    const PetscInt i = multiplier_[k];
    if (lower[i] != 0.0 || upper[i] < PETSC_INFINITY) good = 0;
  }
  if (ranks_ > 1) MPI_Allreduce(MPI_IN_PLACE, &good, 1, MPI_INT, MPI_LAND, comm_);
  return good != 0;
}

// Each state by its own row; Measured: the largest change over the terms of the row.
template <bool Measured>
double PathSweeps::take_states(const Phase& phase, double* u, const double* b, const double* others) const {
  double change = 0.0;
  for (std::size_t k = 0; k < phase.states.size(); ++k) {
    const PetscInt i = phase.states[k];
    double sum = b[i];
    double size = std::abs(b[i]);
    for (auto e = phase.reads.starts[k]; e < phase.reads.starts[k + 1]; ++e) {
      const Entry& entry = phase.reads.entries[static_cast<std::size_t>(e)];
      const double term = entry.value * value(entry.column, u, others);
      sum -= term;
      if constexpr (Measured) size += std::abs(term);
    }
    const double now = sum * phase.inverse[k];
    if constexpr (Measured) {
      const double moved = std::abs(now - u[i]);
      if (moved > change * size * phase.inverse[k]) change = moved / (size * phase.inverse[k]);
    }
    u[i] = now;
  }
  return change;
}

void PathSweeps::solve_paths(Phase& phase, Vec u, Vec b, Bounds bounds, const std::vector<char>& pinned) {
  const std::size_t own = phase.multipliers.size();
  w_.resize(own);
  x_.resize(own);
  y_.resize(own);
  const double* others = rows_.ghosts(u);
  {
    const ReadArray values(u);
    const ReadArray right(b);
    for (std::size_t k = 0; k < own; ++k) {
      const auto m = static_cast<std::size_t>(phase.multipliers[k]);
      const PetscInt i = multiplier_[m];
      double sum = -right[i];
      double size = std::abs(right[i]);
      for (auto e = phase.outputs.starts[k]; e < phase.outputs.starts[k + 1]; ++e) {
        const Entry& entry = phase.outputs.entries[static_cast<std::size_t>(e)];
        const double term = entry.value * value(entry.column, values.data(), others);
        sum += term;
        size += std::abs(term);
      }
      if (std::abs(sum) <= sum_rounding * size) sum = 0.0;
      w_[k] = m < pinned.size() && pinned[m] != 0 ? HUGE_VAL : sum;
      x_[k] = values[i];
    }
  }
  if (ranks_ == 1) {
    if (bounds == Bounds::of_step)
      phase.paths.solve(w_, x_, y_);
    else
      phase.paths.solve_free(w_, y_);
  } else {
    gather(phase, w_, all_w_);
    gather(phase, x_, all_x_);
    all_y_.resize(all_w_.size());
    if (bounds == Bounds::of_step)
      phase.paths.solve(all_w_, all_x_, all_y_);
    else
      phase.paths.solve_free(all_w_, all_y_);
    {
      const WriteArray values(phase.gathered.get());
      std::copy(all_y_.begin(), all_y_.end(), values.data());
    }
    check(VecScatterBegin(phase.to_paths.get(), phase.gathered.get(), change_.get(), INSERT_VALUES,
                          SCATTER_REVERSE));
    check(VecScatterEnd(phase.to_paths.get(), phase.gathered.get(), change_.get(), INSERT_VALUES,
                        SCATTER_REVERSE));
  }
  {
    const WriteArray values(u);
    const WriteArray change(change_.get());
    for (std::size_t k = 0; k < own; ++k) {
      const PetscInt i = multiplier_[static_cast<std::size_t>(phase.multipliers[k])];
      if (ranks_ == 1) change[i] = y_[k];
      values[i] += change[i];
    }
  }
  others = rows_.ghosts(change_.get());
  const WriteArray values(u);
  const ReadArray change(change_.get());
  for (std::size_t k = 0; k < phase.states.size(); ++k) {
    double sum = 0.0;
    for (auto e = phase.pushes.starts[k]; e < phase.pushes.starts[k + 1]; ++e) {
      const Entry& entry = phase.pushes.entries[static_cast<std::size_t>(e)];
      sum += entry.value * value(entry.column, change.data(), others);
    }
    values[phase.states[k]] += sum;
  }
}

// Numbers of this rank's multipliers of a phase, to rank 0 in the order of the paths.
void PathSweeps::gather(Phase& phase, const std::vector<double>& own, std::vector<double>& all) {
  {
    const WriteArray values(change_.get());
    for (std::size_t k = 0; k < own.size(); ++k)
      values[multiplier_[static_cast<std::size_t>(phase.multipliers[k])]] = own[k];
  }
  check(VecScatterBegin(phase.to_paths.get(), change_.get(), phase.gathered.get(), INSERT_VALUES,
                        SCATTER_FORWARD));
  check(VecScatterEnd(phase.to_paths.get(), change_.get(), phase.gathered.get(), INSERT_VALUES,
                      SCATTER_FORWARD));
  const ReadArray values(phase.gathered.get());
  all.assign(values.data(), values.data() + values.size());
}

double PathSweeps::sweep(Vec u, Vec b, Bounds bounds, const std::vector<char>& pinned) {
  double change = 0.0;
  for (Phase& phase : phases_) {
    {
      const double* others = rows_.ghosts(u);
      const WriteArray values(u);
      const ReadArray right(b);
      if (exact_)
        take_states<false>(phase, values.data(), right.data(), others);
      else
        change = std::max(change, take_states<true>(phase, values.data(), right.data(), others));
    }
    if (phase.level > 0 && bounds != Bounds::all_at) solve_paths(phase, u, b, bounds, pinned);
  }
  return change;
}

bool PathSweeps::solve(Vec u, Vec b, Vec lower, Vec upper, const std::vector<char>& pinned) {
  {
    const ReadArray l(lower);
    const ReadArray h(upper);
    if (!fits(l.data(), h.data(), pinned)) return false;
  }
  if (exact_) {
    sweep(u, b, Bounds::of_step, pinned);
    return true;
  }
  for (int k = 0; k < most_sweeps; ++k) {
    double change = sweep(u, b, Bounds::of_step, pinned);
    MPI_Allreduce(MPI_IN_PLACE, &change, 1, MPI_DOUBLE, MPI_MAX, comm_);
    if (!std::isfinite(change)) return false;
    if (k > 0 && change * rate_ <= settled) break;
  }
  return true;
}

bool PathPredictor::prepare(const AffineStep& step) {
  if (step.rows == nullptr || step.level == nullptr) return false;
  if (!sweeps_ || version_ != step.version) {
    sweeps_ = std::make_unique<PathSweeps>(problem_.comm(), *step.rows, *step.level);
    version_ = step.version;
  }
  return sweeps_->worthwhile();
}

}  // namespace sweepvi
