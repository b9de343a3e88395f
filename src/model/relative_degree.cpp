#include "sweepvi/relative_degree.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <string>

#include "model/bounded_rows.hpp"
#include "model/constraint_names.hpp"
#include "model/pivots.hpp"
#include "petsc/agreement.hpp"
#include "petsc/sparse.hpp"

namespace sweepvi {

namespace {

constexpr int highest_degree = 64;           // chains with more lags than this are a modelling error
constexpr double computed_rounding = 1e-10;  // of its terms: what a computed product may owe to its data
constexpr double separation = 100.0;         // how far above what passed for rounding a coupling must stand

using Rows = std::vector<SparseRow>;  // of the constraints this rank owns

// Removes what is rounding relative to the sum of the absolute values of its terms.
void drop_rounding(SparseRow& row, const SparseRow& magnitude) {
  auto terms = magnitude.begin();
  std::erase_if(row, [&](const auto& entry) {
    while (terms != magnitude.end() && terms->first < entry.first)
      ++terms;
    const bool known = terms != magnitude.end() && terms->first == entry.first;
    return std::abs(entry.second) <= (known ? rounding * terms->second : 0.0);
  });
}

// What one level of a constraint shows: its row C_a A^{i-1} B.
enum class Reach {
  none,      // 0 within the bound of every entry
  doubtful,  // above it, but computed data of this size cancel that far by their own rounding
  significant
};

Reach reach_of(const BoundedEntry& entry) {
  if (entry.within_bound()) return Reach::none;
  return entry.written || entry.ratio() > computed_rounding ? Reach::significant : Reach::doubtful;
}

// The entry that speaks loudest for a row: the most significant, of these the one that cancelled least.
const BoundedEntry* loudest(const BoundedRow& row) {
  const auto less = [](const BoundedEntry& a, const BoundedEntry& b) {
    return std::pair(reach_of(a), a.ratio()) < std::pair(reach_of(b), b.ratio());
  };
  const auto at = std::max_element(row.begin(), row.end(), less);
  return at == row.end() ? nullptr : &*at;
}

// An entry of C_a A^{level-1} B, for a message.
std::string described(int level, const BoundedEntry& entry) {
  return fmt::format("C A^{} B = {:.3g} from terms of {:.3g} (error bound {:.2g})", level - 1, entry.value(),
                     entry.magnitude, entry.bound);
}

// Rows C_a, C_a A, ... of one constraint up to its relative degree, and its row of M.
class Output {
public:
  Output(std::string name, int stated) : name_(std::move(name)), stated_(stated) {}

  bool open() const { return degree_ < 0; }
  int degree() const { return degree_; }
  const std::vector<BoundedRow>& z() const { return z_; }
  /// C_a A^{r-1} B; where it was stated not to be zero and numbers do not say so, as it is.
  SparseRow markov() const {
    SparseRow row = rounded(markov_);
    return row.empty() ? at_face_value(markov_) : row;
  }

  /// Takes D_a. @throws Error (bad_input)
  void take_direct(BoundedRow row) {
    if (stated_ == none && row.empty()) return;
    if (stated_ == 0 && row.empty())
      throw InputError("model.relative_degree: " + name_ +
                       " is stated to have degree 0, but its row of D is 0; correct or drop relative_degree");
    if (stated_ > 0 && !row.empty())
      throw InputError(fmt::format(
          "model.relative_degree: {} is stated to have degree {}, but its row of D is not 0; correct or drop "
          "relative_degree",
          name_, stated_));
    if (!row.empty()) settle(0, std::move(row));
  }

  /// Takes C_a A^{level-1} and C_a A^{level-1} B. @throws Error (bad_input)
  void take(int level, const BoundedRow& row, BoundedRow reach, RelativeDegree& result) {
    z_.push_back(row);
    const BoundedEntry* entry = loudest(reach);
    const Reach found = entry == nullptr ? Reach::none : reach_of(*entry);
    if (stated_ > 0) check_stated(level, found, entry);
    const bool counts = stated_ > 0 ? level == stated_ : found == Reach::significant;
    if (!counts) {
      if (entry == nullptr) return;
      result.largest_dropped = std::max(result.largest_dropped, entry->ratio());
      if (loudest_zero_.magnitude == 0.0 || entry->ratio() > loudest_zero_.ratio()) {
        loudest_zero_ = *entry;
        zero_level_ = level;
      }
      if (found == Reach::doubtful && stated_ == none) doubtful_ = true;
      return;
    }
    if (doubtful_) {
      if (entry->ratio() < separation * loudest_zero_.ratio()) undecided(described(level, *entry));
      ++result.doubtful;
    }
    result.smallest_kept = std::min(result.smallest_kept, entry->ratio());
    result.smallest_margin = std::min(
        result.smallest_margin, entry->bound > 0.0 ? std::abs(entry->value()) / entry->bound : infinite);
    settle(level, std::move(reach));
  }

  /// When all levels have been looked at, or `levels` of them. @throws Error (bad_input)
  void conclude(PetscInt levels) const {
    if (!open()) return;
    if (stated_ > 0) check_stated(stated_, Reach::none, nullptr);  // C A^{r-1} has no entries
    if (doubtful_) undecided("");
    if (loudest_zero_.value() != 0.0)
      throw InputError(
          fmt::format("model: the relative degree of {} cannot be decided: C A^(i-1) B is 0 within its error "
                      "bound for i = 1 "
                      "... {}, the largest is {}. State the degree from which lambda acts, relative_degree = "
                      "[...], or check "
                      "its rows of C and the columns of B",
                      name_, levels, described(zero_level_, loudest_zero_)));
    throw InputError("model: " + name_ +
                     " has no relative degree: lambda never reaches it (C A^(i-1) B = 0 for i = 1 ... " +
                     std::to_string(levels) + "); check its rows of C and the columns of B");
  }

private:
  static constexpr int none = -1;

  void settle(int level, BoundedRow markov) {
    degree_ = level;
    markov_ = std::move(markov);
  }

  static constexpr double infinite = std::numeric_limits<double>::infinity();

  // What was stated decides where numbers do not, and only there.
  void check_stated(int level, Reach found, const BoundedEntry* entry) const {
    if (level == stated_) {
      if (entry == nullptr || std::abs(entry->value()) <= entry->arithmetic)
        throw InputError(
            fmt::format("model.relative_degree: {} is stated to have degree {}, but C A^{} B is exactly 0; "
                        "correct or drop "
                        "relative_degree",
                        name_, stated_, level - 1));
    } else if (found == Reach::significant) {
      throw InputError(
          fmt::format("model.relative_degree: {} is stated to have degree {}, but lambda reaches it at {}: "
                      "{}; correct or "
                      "drop relative_degree",
                      name_, stated_, level, described(level, *entry)));
    }
  }

  [[noreturn]] void undecided(const std::string& later) const {
    throw InputError(fmt::format(
        "model: the relative degree of {} cannot be decided: {} is more than rounding of each datum "
        "explains, but "
        "not more than data that were computed in doubles may owe to what they were computed from, and {}; "
        "state "
        "the degree from which lambda acts: relative_degree = [{}] if that is meant as a coupling",
        name_, described(zero_level_, loudest_zero_),
        later.empty() ? std::string("nothing larger follows") : later + " does not stand out against it",
        zero_level_));
  }

  std::string name_;
  int stated_;
  int degree_ = none;
  bool doubtful_ = false;
  BoundedEntry loudest_zero_;  // of what was taken as zero
  int zero_level_ = 0;
  std::vector<BoundedRow> z_;
  BoundedRow markov_;
};

// The degree that the scene states for each owned constraint, -1 where it states none.
std::vector<int> stated_degrees(const LinearSystem& system) {
  std::vector<int> stated(system.constraint_order.size(), -1);
  const std::vector<int>& given = system.stated_degree;
  if (given.empty()) return stated;
  const auto of = [&](PetscInt number) {
    return given.size() == 1 ? given.front() : given[static_cast<std::size_t>(number)];
  };
  for (std::size_t a = 0; a < stated.size(); ++a)
    stated[a] = of(system.constraint_order[a]);
  for (const OppositeRow& row : system.opposite)
    if (of(row.number) != stated[static_cast<std::size_t>(row.constraint)])
      throw InputError(
          fmt::format("model.relative_degree: constraints {} and {} are the two walls of one output, but {} "
                      "and {} are stated "
                      "for them; state one degree",
                      system.constraint_order[static_cast<std::size_t>(row.constraint)], row.number,
                      stated[static_cast<std::size_t>(row.constraint)], of(row.number)));
  return stated;
}

std::vector<Output> find_outputs(const LinearSystem& system, RelativeDegree& result) {
  const MPI_Comm comm = system.comm();
  const PetscInt limit = std::min<PetscInt>(system.states(), highest_degree);
  std::vector<BoundedRow> p = bounded_rows(system.C.get());  // C_a A^{i-1}; emptied once the degree is known
  std::vector<Output> outputs;
  result.smallest_kept = result.smallest_margin = std::numeric_limits<double>::infinity();
  agreed(comm, [&] {
    const std::vector<int> stated = stated_degrees(system);
    for (std::size_t a = 0; a < p.size(); ++a)
      outputs.emplace_back(constraint_name(system, a), stated[a]);
  });
  if (system.D) {
    std::vector<BoundedRow> d = bounded_rows(system.D.get());
    agreed(comm, [&] {
      for (std::size_t a = 0; a < p.size(); ++a) {
        outputs[a].take_direct(std::move(d[a]));
        if (!outputs[a].open()) p[a].clear();
      }
    });
  }
  for (int level = 1; level <= limit; ++level) {
    if (!anywhere(comm, std::any_of(p.begin(), p.end(), [](const auto& row) { return !row.empty(); }))) break;
    std::vector<BoundedRow> reach = multiply(p, system.B.get());
    agreed(comm, [&] {
      for (std::size_t a = 0; a < p.size(); ++a)
        if (outputs[a].open()) outputs[a].take(level, p[a], std::move(reach[a]), result);
    });
    for (std::size_t a = 0; a < p.size(); ++a)
      if (!outputs[a].open()) p[a].clear();
    if (level < limit) p = multiply(p, system.A.get());
  }
  agreed(comm, [&] {
    for (const Output& output : outputs)
      output.conclude(limit);
  });
  MPI_Allreduce(MPI_IN_PLACE, &result.smallest_kept, 1, MPI_DOUBLE, MPI_MIN, comm);
  MPI_Allreduce(MPI_IN_PLACE, &result.smallest_margin, 1, MPI_DOUBLE, MPI_MIN, comm);
  MPI_Allreduce(MPI_IN_PLACE, &result.largest_dropped, 1, MPI_DOUBLE, MPI_MAX, comm);
  MPI_Allreduce(MPI_IN_PLACE, &result.doubtful, 1, MPI_INT64_T, MPI_SUM, comm);
  return outputs;
}

SparseRow absolute(SparseRow row) {
  for (auto& entry : row)
    entry.second = std::abs(entry.second);
  return row;
}

// d_{a,i} = sum_k gamma_k A^k B_a with z_{a,j}(d) = delta_ij: an upper triangular Toeplitz system in the
// constraint's own Markov parameters h_p = C_a A^p B_a, which vanish for p < r - 1.
Rows own_directions(const BoundedRow& last, const std::vector<BoundedRow>& krylov, double& markov_diagonal) {
  const std::size_t r = krylov.size();
  std::vector<double> h(r);  // h[k] = C_a A^{r-1+k} B_a
  for (std::size_t k = 0; k < r; ++k)
    h[k] = dot(last, krylov[k]);
  Rows directions(r);
  if (markov_diagonal == 0.0) return directions;  // check_markov_matrix says what to do about it
  h[0] = markov_diagonal;
  for (std::size_t i = 1; i <= r; ++i) {
    const std::size_t top = r - i;
    std::vector<double> gamma(top + 1, 0.0);
    gamma[top] = 1.0 / h[0];
    for (std::size_t l = top; l-- > 0;) {
      double sum = 0.0;
      for (std::size_t k = l + 1; k <= top; ++k)
        sum += gamma[k] * h[k - l];
      gamma[l] = -sum / h[0];
    }
    SparseRow magnitude;
    for (std::size_t k = 0; k <= top; ++k) {
      const SparseRow power = rounded(krylov[k]);
      directions[i - 1] = add(directions[i - 1], gamma[k], power);
      magnitude = add(magnitude, std::abs(gamma[k]), absolute(power));
    }
    drop_rounding(directions[i - 1], magnitude);
  }
  return directions;
}

// Are all outputs states of their own, each pushed by its own measure alone? Then the box VI needs no
// multipliers.
bool outputs_are_states(const LinearSystem& system, const std::vector<Rows>& z,
                        const std::vector<Rows>& directions) {
  bool fits = !system.D;
  Vector uses = duplicate(system.x0.get());  // outputs per state, from all ranks
  for (std::size_t a = 0; a < z.size() && fits; ++a) {
    fits = !z[a].empty();
    for (std::size_t i = 0; i < z[a].size() && fits; ++i) {
      fits = z[a][i].size() == 1 && directions[a][i].size() == 1 &&
             z[a][i].front().first == directions[a][i].front().first;
      if (fits) check(VecSetValue(uses.get(), z[a][i].front().first, 1.0, ADD_VALUES));
    }
  }
  check(VecAssemblyBegin(uses.get()));
  check(VecAssemblyEnd(uses.get()));
  double most = 0.0;
  check(VecNorm(uses.get(), NORM_INFINITY, &most));
  return !anywhere(system.comm(), !fits) && most <= 1.0;
}

}  // namespace

RelativeDegree analyse_relative_degree(const LinearSystem& system) {
  const MPI_Comm comm = system.comm();
  RelativeDegree result;
  const std::vector<Output> outputs = find_outputs(system, result);
  const std::size_t count = outputs.size();
  for (const Output& output : outputs)
    result.degree.push_back(output.degree());

  int extremes[2] = {std::numeric_limits<int>::max(), std::numeric_limits<int>::max()};  // lowest, -highest
  for (const int r : result.degree) {
    extremes[0] = std::min(extremes[0], r);
    extremes[1] = std::min(extremes[1], -r);
  }
  MPI_Allreduce(MPI_IN_PLACE, extremes, 2, MPI_INT, MPI_MIN, comm);
  result.lowest = extremes[0];
  result.highest = -extremes[1];
  if (result.lowest == 0 && result.highest > 1) {
    std::optional<Error> complaint;
    for (std::size_t a = 0; a < count && !complaint; ++a) {
      if (result.degree[a] > 1)
        complaint =
            InputError("model.D: " + constraint_name(system, a) + " has relative degree " +
                       std::to_string(result.degree[a]) +
                       ", but a scene with D needs degrees 0 and 1 throughout; drop D or that constraint");
    }
    agree(comm, complaint);
  }

  // Rows k of B' (A')^k, as far as the degrees need them.
  std::vector<std::vector<BoundedRow>> krylov(count);
  {
    const Matrix transposed_A = transpose(system.A.get());
    std::vector<BoundedRow> power = bounded_rows(transpose(system.B.get()).get());
    for (int k = 0; k < result.highest; ++k) {
      for (std::size_t a = 0; a < count; ++a) {
        if (k >= result.degree[a]) power[a].clear();
        krylov[a].push_back(power[a]);
      }
      if (k + 1 < result.highest) power = multiply(power, transposed_A.get());
    }
  }

  const PetscInt local_states = row_range(system.A.get()).size();
  const PetscInt first = row_range(system.C.get()).first;
  RowBuilder z;
  RowBuilder directions;
  RowBuilder markov;
  std::vector<Rows> all_outputs(count);
  std::vector<Rows> all_directions(count);
  result.markov_diagonal.assign(count, 0.0);
  result.first_level.assign(1, 0);
  for (std::size_t a = 0; a < count; ++a) {
    const Output& output = outputs[a];
    const auto degree = static_cast<std::size_t>(output.degree());
    const SparseRow reached = output.markov();
    for (const auto& [column, value] : reached)
      if (column == first + static_cast<PetscInt>(a)) result.markov_diagonal[a] = value;
    krylov[a].resize(degree);
    if (degree > 0)
      all_directions[a] = own_directions(output.z().back(), krylov[a], result.markov_diagonal[a]);
    for (std::size_t i = 0; i < degree; ++i) {
      all_outputs[a].push_back(rounded(output.z()[i]));
      z.add(all_outputs[a][i]);
      z.end_row();
      directions.add(all_directions[a][i]);
      directions.end_row();
    }
    markov.add(reached);
    markov.end_row();
    result.first_level.push_back(result.first_level.back() + output.degree());
  }
  result.Z = z.finish(comm, local_states);
  result.directions = directions.finish(comm, local_states);
  result.markov = markov.finish(comm, static_cast<PetscInt>(count));
  check(MatGetSize(result.Z.get(), &result.outputs, nullptr));
  result.outputs_are_states = outputs_are_states(system, all_outputs, all_directions);
  find_pivots(system, result);
  return result;
}

}  // namespace sweepvi
