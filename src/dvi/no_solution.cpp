#include "dvi/no_solution.hpp"

#include <algorithm>
#include <cmath>

#include "petsc/sparse.hpp"

namespace sweepvi {

std::optional<Contradiction> prove_no_solution(Mat K, Vec q, Vec q_terms, Vec lower, Vec upper, Vec near) {
  const MPI_Comm comm = PetscObjectComm(reinterpret_cast<PetscObject>(K));
  const LocalRange range = row_range(K);
  PetscInt size = 0;
  check(VecGetSize(q, &size));
  RowBuilder rows;
  std::vector<PetscInt> numbers;  // of rows; those of bounds are `size` and above
  std::vector<double> least, terms;
  {
    const ReadArray constant(q);
    const ReadArray known(q_terms);
    const ReadArray l(lower);
    const ReadArray b(upper);
    for (PetscInt row = range.first; row < range.last; ++row) {
      const PetscInt i = row - range.first;
      const auto add = [&](PetscInt number, double bound, double its_terms) {
        rows.end_row();
        numbers.push_back(number);
        least.push_back(bound);
        terms.push_back(its_terms);
      };
      const bool has_lower = l[i] > PETSC_NINFINITY;
      const bool has_upper = b[i] < PETSC_INFINITY;
      const SparseRow entries = get_row(K, row);
      const bool empty =
          std::all_of(entries.begin(), entries.end(), [](const auto& entry) { return entry.second == 0.0; });
      if (!has_upper && !(empty && constant[i] >= 0.0)) {
        rows.add(entries);
        add(row, -constant[i], known[i]);
      }
      if (!has_lower && !(empty && constant[i] <= 0.0)) {
        rows.add(entries, -1.0);
        add(row, constant[i], known[i]);
      }
      if (has_lower) {
        rows.add(row, 1.0);
        add(size + row, l[i], std::abs(l[i]));
      }
      if (has_upper) {
        rows.add(row, -1.0);
        add(size + row, -b[i], std::abs(b[i]));
      }
    }
  }
  const Matrix G = rows.finish(comm, range.size());
  const auto vector = [&](const std::vector<double>& values) {
    Vector result = make_vector(comm, static_cast<PetscInt>(values.size()));
    const WriteArray to(result.get());
    std::copy(values.begin(), values.end(), to.data());
    return result;
  };
  auto found = find_contradiction(G.get(), vector(least).get(), vector(terms).get(), near, numbers);
  if (found) std::erase_if(found->faces, [size](PetscInt number) { return number >= size; });
  if (found) found->faces.erase(std::unique(found->faces.begin(), found->faces.end()), found->faces.end());
  return found;
}

}  // namespace sweepvi
