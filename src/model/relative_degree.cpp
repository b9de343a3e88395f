#include "sweepvi/relative_degree.hpp"

#include <cmath>
#include <limits>
#include <optional>
#include <string>

#include "model/constraint_names.hpp"
#include "model/pivots.hpp"
#include "petsc/sparse.hpp"

namespace sweepvi {

namespace {

constexpr double count_tolerance = 1e-10;  // far above rounding, far below what a model means by "coupled"
constexpr int highest_degree = 64;         // chains with more lags than this are a modelling error

using Rows = std::vector<SparseRow>;  // of the constraints this rank owns

double lookup(const SparseRow& row, PetscInt column) {
  const auto at = std::lower_bound(row.begin(), row.end(), column,
                                   [](const auto& entry, PetscInt wanted) { return entry.first < wanted; });
  return at != row.end() && at->first == column ? at->second : 0.0;
}

// Removes what is rounding relative to the sum of the absolute values of its terms.
void drop_rounding(SparseRow& row, const SparseRow& magnitude) {
  std::erase_if(row, [&](const auto& entry) {
    return std::abs(entry.second) <= rounding * lookup(magnitude, entry.first);
  });
}

Rows local_rows(Mat matrix) {
  Rows rows;
  for_each_row(matrix, [&](PetscInt, auto columns, auto values) {
    SparseRow& row = rows.emplace_back();
    for (std::size_t k = 0; k < columns.size(); ++k)
      row.emplace_back(columns[k], values[k]);
  });
  return rows;
}

Matrix matrix_of(MPI_Comm comm, const Rows& rows, PetscInt local_columns) {
  RowBuilder builder;
  for (const SparseRow& row : rows) {
    builder.add(row);
    builder.end_row();
  }
  return builder.finish(comm, local_columns);
}

bool anywhere(MPI_Comm comm, bool here) {
  int mine = here ? 1 : 0;
  int any = 0;
  MPI_Allreduce(&mine, &any, 1, MPI_INT, MPI_LOR, comm);
  return any != 0;
}

// Rows C_a, C_a A, ... of every constraint up to its relative degree, and its row of M.
struct Outputs {
  std::vector<Rows> z;  // per owned constraint, its r_a rows
  Rows markov;          // per owned constraint
};

Outputs find_outputs(const LinearSystem& system, RelativeDegree& result) {
  const MPI_Comm comm = system.comm();
  const PetscInt local_states = row_range(system.A.get()).size();
  const PetscInt limit = std::min<PetscInt>(system.states(), highest_degree);
  const Matrix abs_A = absolute_copy(system.A.get());
  const Matrix abs_B = absolute_copy(system.B.get());

  Rows p = local_rows(system.C.get());  // C_a A^{i-1}; emptied once the degree is known
  Rows magnitude = local_rows(absolute_copy(system.C.get()).get());
  const std::size_t count = p.size();
  Outputs out{std::vector<Rows>(count), Rows(count)};
  result.degree.assign(count, -1);
  double smallest_kept = std::numeric_limits<double>::infinity();
  double largest_dropped = 0.0;

  if (system.D) {
    Rows d = local_rows(system.D.get());
    for (std::size_t a = 0; a < count; ++a) {
      std::erase_if(d[a], [](const auto& entry) { return entry.second == 0.0; });
      if (d[a].empty()) continue;
      result.degree[a] = 0;
      out.markov[a] = std::move(d[a]);
      p[a].clear();
      magnitude[a].clear();
    }
  }

  for (int level = 1; level <= limit; ++level) {
    if (!anywhere(comm, std::any_of(p.begin(), p.end(), [](const SparseRow& row) { return !row.empty(); })))
      break;
    const Matrix p_matrix = matrix_of(comm, p, local_states);
    const Matrix magnitude_matrix = matrix_of(comm, magnitude, local_states);
    Rows reach = local_rows(multiply(p_matrix.get(), system.B.get()).get());
    const Rows reach_magnitude = local_rows(multiply(magnitude_matrix.get(), abs_B.get()).get());
    for (std::size_t a = 0; a < count; ++a) {
      if (result.degree[a] >= 0 || p[a].empty()) continue;
      out.z[a].push_back(p[a]);
      double best = 0.0;
      for (const auto& [column, value] : reach[a]) {
        const double terms = lookup(reach_magnitude[a], column);
        if (terms > 0.0) best = std::max(best, std::abs(value) / terms);
      }
      if (best > count_tolerance) {
        smallest_kept = std::min(smallest_kept, best);
        result.degree[a] = level;
        out.markov[a] = reach[a];
        drop_rounding(out.markov[a], reach_magnitude[a]);
      } else {
        largest_dropped = std::max(largest_dropped, best);
      }
    }
    Rows next = local_rows(multiply(p_matrix.get(), system.A.get()).get());
    Rows next_magnitude = local_rows(multiply(magnitude_matrix.get(), abs_A.get()).get());
    for (std::size_t a = 0; a < count; ++a) {
      if (result.degree[a] >= 0) {
        p[a].clear();
        magnitude[a].clear();
      } else {
        p[a] = std::move(next[a]);
        magnitude[a] = std::move(next_magnitude[a]);
        drop_rounding(p[a], magnitude[a]);
      }
    }
  }
  MPI_Allreduce(&smallest_kept, &result.smallest_kept, 1, MPI_DOUBLE, MPI_MIN, comm);
  MPI_Allreduce(&largest_dropped, &result.largest_dropped, 1, MPI_DOUBLE, MPI_MAX, comm);
  result.tolerance = count_tolerance;
  return out;
}

// d_{a,i} = sum_k gamma_k A^k B_a with z_{a,j}(d) = delta_ij: an upper triangular Toeplitz system in the
// constraint's own Markov parameters h_p = C_a A^p B_a, which vanish for p < r - 1.
Rows own_directions(const Rows& z, const Rows& krylov, double& markov_diagonal) {
  const std::size_t r = z.size();
  std::vector<double> h(r);  // h[k] = C_a A^{r-1+k} B_a
  for (std::size_t k = 0; k < r; ++k)
    h[k] = dot(z.back(), krylov[k]);
  markov_diagonal = h[0];
  Rows directions(r);
  if (h[0] == 0.0) return directions;  // check_markov_matrix says what to do about it
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
      directions[i - 1] = add(directions[i - 1], gamma[k], krylov[k]);
      SparseRow absolute = krylov[k];
      for (auto& entry : absolute)
        entry.second = std::abs(entry.second);
      magnitude = add(magnitude, std::abs(gamma[k]), absolute);
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
  const Outputs outputs = find_outputs(system, result);
  const std::size_t count = result.degree.size();

  std::optional<Error> complaint;
  for (std::size_t a = 0; a < count && !complaint; ++a) {
    if (result.degree[a] < 0)
      complaint =
          InputError("model: " + constraint_name(system, a) +
                     " has no relative degree: lambda never reaches it (C A^{i-1} B = 0 for i = 1 ... " +
                     std::to_string(std::min<PetscInt>(system.states(), highest_degree)) +
                     "); check its rows of C and the columns of B");
  }
  agree(comm, complaint);

  int extremes[2] = {std::numeric_limits<int>::max(), std::numeric_limits<int>::max()};  // lowest, -highest
  for (const int r : result.degree) {
    extremes[0] = std::min(extremes[0], r);
    extremes[1] = std::min(extremes[1], -r);
  }
  MPI_Allreduce(MPI_IN_PLACE, extremes, 2, MPI_INT, MPI_MIN, comm);
  result.lowest = extremes[0];
  result.highest = -extremes[1];
  if (result.lowest == 0 && result.highest > 1) {
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
  std::vector<Rows> krylov(count);
  {
    const Matrix transposed_A = transpose(system.A.get());
    Matrix power = transpose(system.B.get());
    for (int k = 0; k < result.highest; ++k) {
      Rows rows = local_rows(power.get());
      for (std::size_t a = 0; a < count; ++a)
        if (k < result.degree[a]) krylov[a].push_back(std::move(rows[a]));
      if (k + 1 < result.highest) power = multiply(power.get(), transposed_A.get());
    }
  }

  const PetscInt local_states = row_range(system.A.get()).size();
  RowBuilder z;
  RowBuilder directions;
  RowBuilder markov;
  std::vector<Rows> all_directions(count);
  result.markov_diagonal.assign(count, 0.0);
  result.first_level.assign(1, 0);
  for (std::size_t a = 0; a < count; ++a) {
    if (result.degree[a] == 0) {
      result.markov_diagonal[a] =
          lookup(outputs.markov[a], row_range(system.C.get()).first + static_cast<PetscInt>(a));
    } else {
      all_directions[a] = own_directions(outputs.z[a], krylov[a], result.markov_diagonal[a]);
    }
    for (std::size_t i = 0; i < outputs.z[a].size(); ++i) {
      z.add(outputs.z[a][i]);
      z.end_row();
      directions.add(all_directions[a][i]);
      directions.end_row();
    }
    markov.add(outputs.markov[a]);
    markov.end_row();
    result.first_level.push_back(result.first_level.back() + result.degree[a]);
  }
  result.Z = z.finish(comm, local_states);
  result.directions = directions.finish(comm, local_states);
  result.markov = markov.finish(comm, static_cast<PetscInt>(count));
  check(MatGetSize(result.Z.get(), &result.outputs, nullptr));
  result.outputs_are_states = outputs_are_states(system, outputs.z, all_directions);
  find_pivots(system, result);
  return result;
}

}  // namespace sweepvi
