#include "dvi/residue.hpp"

#include <algorithm>
#include <cmath>

#include "petsc/sparse.hpp"

namespace sweepvi {

Matrix absolute_up_to(Mat A, double most) {
  RowBuilder rows;
  for_each_row(A, [&](PetscInt, auto columns, auto values) {
    for (std::size_t k = 0; k < columns.size(); ++k)
      rows.add(columns[k], std::min(std::abs(values[k]), most));
    rows.end_row();
  });
  return rows.finish(PetscObjectComm(reinterpret_cast<PetscObject>(A)), column_range(A).size());
}

}  // namespace sweepvi
