#include "hybrid/contact_forces.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include "dvi/affine_vi.hpp"
#include "petsc/agreement.hpp"
#include "petsc/direct_solver.hpp"
#include "petsc/sparse.hpp"
#include "sweepvi/step_solver.hpp"

namespace sweepvi {

namespace {

constexpr std::size_t largest_group = 64;
constexpr std::size_t most_factors = 6;  // kept
constexpr int most_guesses = 20;         // active sets tried from a start

void put(const std::vector<double>& values, Vec to) {
  const WriteArray array(to);
  std::copy(values.begin(), values.end(), array.data());
}

void get(Vec from, std::vector<double>& values) {
  const ReadArray array(from);
  values.assign(array.data(), array.data() + array.size());
}

// All entries, on every rank.
std::vector<double> everywhere(Vec vector) {
  Scatter scatter;
  Vector all;
  check(VecScatterCreateToAll(vector, scatter.put(), all.put()));
  check(VecScatterBegin(scatter.get(), vector, all.get(), INSERT_VALUES, SCATTER_FORWARD));
  check(VecScatterEnd(scatter.get(), vector, all.get(), INSERT_VALUES, SCATTER_FORWARD));
  std::vector<double> values;
  get(all.get(), values);
  return values;
}

}  // namespace

ContactForces::ContactForces(const LinearSystem& system, const RelativeDegree& degree)
    : comm_(system.comm()),
      degree_(degree),
      in_(duplicate(system.w0.get())),
      out_(duplicate(system.w0.get())) {
  upper_.assign(degree.degree.size(), PETSC_INFINITY);
  if (system.wmax) get(system.wmax.get(), upper_);
  bool coupled = false, zero = false;
  for_each_row(degree.markov.get(), [&](PetscInt row, auto columns, auto values) {
    double diagonal = 0.0;
    for (std::size_t k = 0; k < columns.size(); ++k) {
      if (columns[k] == row) diagonal = values[k];
      coupled = coupled || (columns[k] != row && values[k] != 0.0);
    }
    zero = zero || diagonal == 0.0;
  });
  abs_markov_ = absolute_copy(degree.markov.get());
  zero_diagonal_ = anywhere(comm_, zero);
  coupled_ = anywhere(comm_, coupled) || zero_diagonal_;
  if (!coupled_) return;
  find_groups();
}

void ContactForces::find_rest(const std::vector<double>& a, const std::vector<double>& lambda,
                              std::vector<double>& rest) {
  rest.resize(a.size());
  if (!coupled_) {
    for (std::size_t b = 0; b < a.size(); ++b)
      rest[b] = a[b] + degree_.markov_diagonal[b] * lambda[b];
    return;
  }
  put(lambda, in_.get());
  check(MatMult(degree_.markov.get(), in_.get(), out_.get()));
  get(out_.get(), rest);
  for (std::size_t b = 0; b < a.size(); ++b)
    rest[b] += a[b];
}

// Rows outside of the set are the identity's.
Matrix ContactForces::masked(const std::vector<char>& set) const {
  const LocalRange range = row_range(degree_.markov.get());
  const Vector members = duplicate(in_.get());
  {
    const WriteArray values(members.get());
    for (std::size_t a = 0; a < set.size(); ++a)
      values[static_cast<PetscInt>(a)] = set[a] != 0 ? 1.0 : 0.0;
  }
  Matrix columns;  // only columns of the set
  check(MatDuplicate(degree_.markov.get(), MAT_COPY_VALUES, columns.put()));
  check(MatDiagonalScale(columns.get(), nullptr, members.get()));
  RowBuilder rows;
  for (std::size_t a = 0; a < set.size(); ++a) {
    const PetscInt row = range.first + static_cast<PetscInt>(a);
    if (set[a] != 0)
      for (const auto& [column, value] : get_row(columns.get(), row)) {
        if (value != 0.0 || column == row) rows.add(column, value);
      }
    else
      rows.add(row, 1.0);
    rows.end_row();
  }
  return rows.finish(comm_, range.size());
}

// Of all ranks, one after the other.
std::vector<double> ContactForces::from_all(const std::vector<double>& own) const {
  std::vector<double> all(static_cast<std::size_t>(begins_.back() + counts_.back()));
  MPI_Allgatherv(own.data(), static_cast<int>(own.size()), MPI_DOUBLE, all.data(), counts_.data(),
                 begins_.data(), MPI_DOUBLE, comm_);
  return all;
}

// One group of all constraints on every rank.
void ContactForces::gather_all() {
  const auto total = static_cast<std::size_t>(begins_.back()) + static_cast<std::size_t>(counts_.back());
  const LocalRange range = row_range(degree_.markov.get());
  Group all;
  for (std::size_t column = 0; column < total; ++column)
    all.members.push_back(column);
  all.matrix.assign(total, std::vector<double>(total));
  for (std::size_t column = 0; column < total; ++column) {
    std::vector<double> own(grouped_.size(), 0.0);
    for (std::size_t a = 0; a < own.size(); ++a)
      for (const auto& [j, value] : get_row(degree_.markov.get(), range.first + static_cast<PetscInt>(a)))
        if (j == static_cast<PetscInt>(column)) own[a] = value;
    const std::vector<double> entries = from_all(own);
    for (std::size_t row = 0; row < total; ++row)
      all.matrix[row][column] = entries[row];
  }
  groups_.push_back(std::move(all));
  grouped_.assign(grouped_.size(), 1);
}

// The connected parts of M's graph, where they are small and this rank's own.
void ContactForces::find_groups() {
  const LocalRange range = row_range(degree_.markov.get());
  const std::size_t count = degree_.degree.size();
  grouped_.assign(count, 0);
  int ranks = 1;
  MPI_Comm_size(comm_, &ranks);
  counts_.resize(static_cast<std::size_t>(ranks));
  const auto own = static_cast<int>(count);
  MPI_Allgather(&own, 1, MPI_INT, counts_.data(), 1, MPI_INT, comm_);
  begins_.resize(counts_.size(), 0);
  std::partial_sum(counts_.begin(), counts_.end() - 1, begins_.begin() + 1);
  const int total = begins_.back() + counts_.back();
  together_ = ranks > 1 && static_cast<std::size_t>(total) <= largest_group;
  if (together_) {
    gather_all();
    return;
  }
  // What reads whom, and the other way round; columns of other ranks: `far`.
  constexpr std::size_t far = std::numeric_limits<std::size_t>::max();
  const Matrix reversed = transpose(degree_.markov.get());
  std::vector<std::vector<std::size_t>> neighbours(count);
  for (Mat matrix : {degree_.markov.get(), reversed.get()})
    for_each_row(matrix, [&](PetscInt row, auto columns, auto values) {
      for (std::size_t k = 0; k < columns.size(); ++k)
        if (values[k] != 0.0 && columns[k] != row)
          neighbours[static_cast<std::size_t>(row - range.first)].push_back(
              columns[k] >= range.first && columns[k] < range.last
                  ? static_cast<std::size_t>(columns[k] - range.first)
                  : far);
    });
  std::vector<char> seen(count, 0);
  int single = 0;
  for (std::size_t a = 0; a < count; ++a) {
    if (seen[a] != 0) continue;
    seen[a] = 1;
    std::vector<std::size_t> members{a};
    bool own_only = true;
    for (std::size_t k = 0; k < members.size(); ++k)
      for (const std::size_t b : neighbours[members[k]]) {
        if (b == far)
          own_only = false;
        else if (std::exchange(seen[b], 1) == 0)
          members.push_back(b);
      }
    if (!own_only || members.size() > largest_group) {
      single = 1;
      continue;
    }
    std::sort(members.begin(), members.end());
    Group group{members, {}};
    for (const std::size_t b : members) {
      grouped_[b] = 1;
      group.matrix.emplace_back(members.size(), 0.0);
      for (const auto& [column, value] :
           get_row(degree_.markov.get(), range.first + static_cast<PetscInt>(b)))
        if (value != 0.0)
          group.matrix.back()[static_cast<std::size_t>(
              std::lower_bound(members.begin(), members.end(),
                               static_cast<std::size_t>(column - range.first)) -
              members.begin())] = value;
    }
    groups_.push_back(std::move(group));
  }
  any_single_ = anywhere(comm_, single != 0);
}

ContactForces::Factor& ContactForces::factor(const std::vector<char>& set) {
  for (Factor& known : factors_)
    if (!anywhere(comm_, known.set != set)) return known;
  if (factors_.size() < most_factors) {
    factors_.emplace_back();
    next_ = factors_.size() - 1;
  } else {
    next_ = (next_ + 1) % most_factors;
  }
  Factor& fresh = factors_[next_];
  fresh = Factor{};
  fresh.set = set;
  std::vector<char> members = set;
  if (together_) {
    const std::vector<double> all = from_all({set.begin(), set.end()});
    members.assign(all.begin(), all.end());
  }
  for (const Group& group : groups_)
    fresh.groups.emplace_back(group.matrix, group.members, members);
  if (!any_single_) return fresh;
  std::vector<char> single = set;
  for (std::size_t a = 0; a < set.size(); ++a)
    if (grouped_[a] != 0) single[a] = 0;
  fresh.matrix = masked(single);
  check(KSPCreate(comm_, fresh.solver.put()));
  check(KSPSetOptionsPrefix(fresh.solver.get(), "sweepvi_contact_"));
  default_to_mumps(fresh.solver.get());
  // Many solves with small matrices, whose principal minors do not vanish: MUMPS is ten times slower.
  PC pc = nullptr;
  int ranks = 1;
  MPI_Comm_size(comm_, &ranks);
  check(KSPGetPC(fresh.solver.get(), &pc));
  if (ranks == 1 && !zero_diagonal_) check(PCFactorSetMatSolverType(pc, MATSOLVERPETSC));
  check_options(KSPSetFromOptions(fresh.solver.get()));
  check(KSPSetOperators(fresh.solver.get(), fresh.matrix.get(), fresh.matrix.get()));
  return fresh;
}

bool ContactForces::solve(const std::vector<char>& set, std::vector<double>& values) {
  if (!coupled_) {
    for (std::size_t a = 0; a < values.size(); ++a)
      values[a] = set[a] != 0 ? values[a] / degree_.markov_diagonal[a] : 0.0;
    return true;
  }
  Factor& with = factor(set);
  if (together_) {
    const std::vector<double> right = from_all(values);
    std::vector<double> all(right.size(), 0.0);
    with.groups[0].solve(right, all);
    int rank = 0;
    MPI_Comm_rank(comm_, &rank);
    std::copy_n(all.begin() + begins_[static_cast<std::size_t>(rank)], values.size(), values.begin());
    return true;
  }
  const std::vector<double> right = values;
  for (std::size_t a = 0; a < values.size(); ++a)
    if (set[a] == 0 || grouped_[a] != 0) values[a] = 0.0;
  if (any_single_) {
    put(values, in_.get());
    if (!sweepvi::solve(with.solver.get(), with.matrix.get(), in_.get(), out_.get())) {
      with.set.assign(set.size(), 2);  // of no set
      return false;
    }
    get(out_.get(), values);
  }
  for (const PivotedLu& group : with.groups)
    group.solve(right, values);
  return true;
}

// |M_SS^-1| small; of what PETSc solves for, from a few random signs.
std::vector<double> ContactForces::bound_of_forces(const std::vector<char>& set,
                                                   const std::vector<double>& small) {
  std::vector<double> result(small.size(), 0.0);
  if (!coupled_) {
    for (std::size_t a = 0; a < result.size(); ++a)
      result[a] = small[a] / degree_.markov_diagonal[a];
    return result;
  }
  if (together_) {
    const Factor& with = factor(set);
    std::vector<double> all(static_cast<std::size_t>(begins_.back() + counts_.back()), 0.0);
    with.groups[0].bound(from_all(small), all);
    int rank = 0;
    MPI_Comm_rank(comm_, &rank);
    std::copy_n(all.begin() + begins_[static_cast<std::size_t>(rank)], result.size(), result.begin());
    return result;
  }
  for (int probe = 0; any_single_ && probe < 4; ++probe) {
    std::vector<double> values = small;
    for (std::size_t a = 0; a < values.size(); ++a)
      if (((a + 1) * 0x9E3779B97F4A7C15ull >> (60 + probe) & 1u) != 0) values[a] = -values[a];
    if (!solve(set, values)) break;
    for (std::size_t a = 0; a < values.size(); ++a)
      result[a] = std::max(result[a], std::abs(values[a]));
  }
  for (const PivotedLu& group : factor(set).groups)
    group.bound(small, result);
  return result;
}

std::vector<double> ContactForces::negligible(const std::vector<Role>& roles, const std::vector<double>& rest,
                                              std::vector<double>& small) {
  const std::size_t count = roles.size();
  std::vector<char> set(count, 0), next(count, 0);
  std::vector<double> least(count, 0.0), spread = small;
  for (int round = 0; round < 4; ++round) {
    for (std::size_t b = 0; b < count; ++b) {
      const double from_upper = roles[b] == Role::between ? std::abs(rest[b] - upper_[b]) : PETSC_INFINITY;
      next[b] = roles[b] != Role::off && std::min(std::abs(rest[b]), from_upper) <= spread[b] ? 1 : 0;
    }
    if (round > 0 && !anywhere(comm_, next != set)) break;
    set = next;
    least = bound_of_forces(set, small);
    if (!coupled_) break;
    put(least, in_.get());
    check(MatMult(abs_markov_.get(), in_.get(), out_.get()));
    get(out_.get(), spread);
    for (std::size_t b = 0; b < count; ++b)
      spread[b] += small[b];
  }
  small = spread;
  return least;
}

// Whether forces on `sides`, and on who holds, and nobody else are a solution; if not, `sides` is the next
// guess.
bool ContactForces::fits(const Problem& problem, std::vector<Side>& sides, std::vector<double>& lambda,
                         std::vector<double>& rest) {
  const std::size_t count = sides.size();
  std::vector<char> set(count, 0);
  std::vector<double> wall(count, 0.0);
  lambda.assign(count, 0.0);
  for (std::size_t b = 0; b < count; ++b) {
    const Role role = problem.roles[b];
    if (role == Role::off) sides[b] = Side::none;
    if (role == Role::lower && sides[b] != Side::none) sides[b] = Side::lower;
    if (role == Role::upper && sides[b] != Side::none) sides[b] = Side::upper;
    set[b] = role == Role::holds || sides[b] != Side::none ? 1 : 0;
    if (role == Role::between && sides[b] == Side::upper) wall[b] = upper_[b];
    if (set[b] != 0) lambda[b] = wall[b] - problem.a[b];
  }
  if (!solve(set, lambda)) return false;
  find_rest(problem.a, lambda, rest);
  bool pulls = false;
  for (std::size_t b = 0; b < count; ++b)
    pulls = pulls || (set[b] != 0 && problem.roles[b] != Role::holds &&
                      static_cast<double>(sides[b]) * lambda[b] < 0.0);
  const std::vector<double> least =
      anywhere(comm_, pulls) ? bound_of_forces(set, problem.small) : std::vector<double>(count, 0.0);
  bool wrong = false;
  for (std::size_t b = 0; b < count; ++b) {
    const Role role = problem.roles[b];
    if (role == Role::off) continue;
    if (set[b] != 0) {  // a row that depends on others may not be solved
      wrong = wrong ||
              !(std::abs(rest[b] - wall[b]) <= 1e-6 * (std::abs(problem.a[b]) + problem.small[b] * 1e12));
      if (role == Role::holds || static_cast<double>(sides[b]) * lambda[b] >= -least[b]) continue;
      sides[b] = Side::none;
      wrong = true;
    } else if (role != Role::upper && rest[b] < -problem.small[b]) {
      sides[b] = Side::lower;
      wrong = true;
    } else if (role == Role::upper ? rest[b] > problem.small[b]
                                   : role == Role::between && rest[b] > upper_[b] + problem.small[b]) {
      sides[b] = Side::upper;
      wrong = true;
    }
  }
  return !anywhere(comm_, wrong);
}

bool ContactForces::complement(double t, const std::vector<Role>& roles, const std::vector<double>& a,
                               const std::vector<double>& small, const std::vector<Side>& guess,
                               std::vector<double>& lambda, std::vector<double>& rest) {
  const Problem problem{roles, a, small};
  std::vector<Side> nobody(a.size(), Side::none);
  for (const std::vector<Side>* start : {&guess, &std::as_const(nobody)}) {
    std::vector<Side> sides = *start;
    for (int k = 0; k < (coupled_ ? most_guesses : 2); ++k)
      if (fits(problem, sides, lambda, rest)) return true;
  }
  if (!solve_vi(t, problem, lambda)) return false;
  find_rest(a, lambda, rest);
  return true;
}

// Upper walls have multipliers of their own: lambda = lambda_0 - lambda_wmax.
bool ContactForces::solve_vi(double t, const Problem& problem, std::vector<double>& lambda) {
  const std::size_t count = problem.a.size();
  const LocalRange range = row_range(degree_.markov.get());
  std::vector<char> part(count);
  std::vector<std::size_t> walls;
  for (std::size_t b = 0; b < count; ++b) {
    part[b] = problem.roles[b] != Role::off ? 1 : 0;
    if (problem.roles[b] == Role::between && upper_[b] < PETSC_INFINITY) walls.push_back(b);
  }
  const Matrix M = masked(part);
  // Local unknowns: those of all constraints, then those of upper walls. Where each column goes:
  const auto local = static_cast<PetscInt>(count + walls.size());
  PetscInt end = 0;
  MPI_Scan(&local, &end, 1, MPIU_INT, MPI_SUM, comm_);
  const PetscInt first = end - local;
  const Vector places = duplicate(in_.get()), wall_places = duplicate(in_.get());
  {
    const WriteArray place(places.get());
    const WriteArray wall_place(wall_places.get());
    for (std::size_t b = 0; b < count; ++b) {
      place[static_cast<PetscInt>(b)] = static_cast<double>(first + static_cast<PetscInt>(b));
      wall_place[static_cast<PetscInt>(b)] = -1.0;
    }
    for (std::size_t k = 0; k < walls.size(); ++k)
      wall_place[static_cast<PetscInt>(walls[k])] =
          static_cast<double>(first + static_cast<PetscInt>(count + k));
  }
  const std::vector<double> all_places = everywhere(places.get()), all_walls = everywhere(wall_places.get());
  RowBuilder rows;
  const auto add_row = [&](std::size_t b, double s, std::size_t place) {
    rows.add(first + static_cast<PetscInt>(place), 0.0);  // a diagonal, if only 0
    for (const auto& [column, value] : get_row(M.get(), range.first + static_cast<PetscInt>(b))) {
      const auto c = static_cast<std::size_t>(column);
      rows.add(static_cast<PetscInt>(all_places[c]), s * value);
      if (all_walls[c] >= 0.0) rows.add(static_cast<PetscInt>(all_walls[c]), -s * value);
    }
    rows.end_row();
  };
  for (std::size_t b = 0; b < count; ++b)
    add_row(b, 1.0, b);
  for (std::size_t k = 0; k < walls.size(); ++k)
    add_row(walls[k], -1.0, count + k);
  Vector lower = make_vector(comm_, local), upper = duplicate(lower.get()), q = duplicate(lower.get()),
         start = duplicate(lower.get());
  check(VecSet(start.get(), 0.0));
  check(VecSet(lower.get(), PETSC_NINFINITY));
  check(VecSet(upper.get(), PETSC_INFINITY));
  {
    const WriteArray l(lower.get());
    const WriteArray u(upper.get());
    const WriteArray right(q.get());
    for (std::size_t b = 0; b < count; ++b) {
      const auto i = static_cast<PetscInt>(b);
      const Role role = problem.roles[b];
      if (role == Role::lower || role == Role::between) l[i] = 0.0;
      if (role == Role::upper) u[i] = 0.0;
      right[i] = part[b] != 0 ? problem.a[b] : 0.0;
    }
    for (std::size_t k = 0; k < walls.size(); ++k) {
      const auto i = static_cast<PetscInt>(count + k);
      l[i] = 0.0;
      right[i] = upper_[walls[k]] - problem.a[walls[k]];
    }
  }
  AffineVi vi(rows.finish(comm_, local), std::move(q), std::move(lower), std::move(upper), std::move(start));
  NonlinearSolver snes;
  check(SNESCreate(comm_, snes.put()));
  StepSolver solver(snes.get(), vi);
  const StepReport report = solver.solve(Step{1, t, t, 0.0});
  if (!report.certified) return false;
  const ReadArray solution(solver.solution());
  lambda.assign(solution.data(), solution.data() + count);
  for (std::size_t k = 0; k < walls.size(); ++k)
    lambda[walls[k]] -= solution[static_cast<PetscInt>(count + k)];
  return true;
}

}  // namespace sweepvi
