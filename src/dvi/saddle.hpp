#pragma once

#include "dvi/stacked.hpp"
#include "petsc/sparse.hpp"

namespace sweepvi {

/// [K, -G'; G, 0] in unknowns (u, y) stacked rank by rank, with its whole diagonal stored.
/// @param K  laid out like the columns of G
/// @note Collective.
inline Matrix saddle_matrix(Mat K, Mat G) {
  Vector like_y;
  check(MatCreateVecs(G, nullptr, like_y.put()));
  const Stacked number(K, like_y.get());
  const LocalRange components = row_range(K);
  const LocalRange faces = row_range(G);
  const Matrix transposed = transpose(G);
  RowBuilder rows;
  for (PetscInt i = components.first; i < components.last; ++i) {
    rows.add(number.x(i), 0.0);
    for (const auto& [column, value] : get_row(K, i))
      rows.add(number.x(column), value);
    for (const auto& [column, value] : get_row(transposed.get(), i))
      rows.add(number.nu(column), -value);
    rows.end_row();
  }
  for (PetscInt a = faces.first; a < faces.last; ++a) {
    rows.add(number.nu(a), 0.0);
    for (const auto& [column, value] : get_row(G, a))
      rows.add(number.x(column), value);
    rows.end_row();
  }
  return rows.finish(PetscObjectComm(reinterpret_cast<PetscObject>(G)), components.size() + faces.size());
}

/// factor I in the layout of `like`. @note Collective.
inline Matrix scaled_identity(Vec like, double factor) {
  PetscInt first = 0;
  PetscInt last = 0;
  check(VecGetOwnershipRange(like, &first, &last));
  RowBuilder rows;
  for (PetscInt i = first; i < last; ++i) {
    rows.add(i, factor);
    rows.end_row();
  }
  return rows.finish(PetscObjectComm(reinterpret_cast<PetscObject>(like)), last - first);
}

}  // namespace sweepvi
