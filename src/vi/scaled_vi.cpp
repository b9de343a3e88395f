#include "vi/scaled_vi.hpp"

#include <algorithm>
#include <cmath>

#include "petsc/sparse.hpp"

namespace sweepvi {

namespace {

// factor = 1 / sqrt(largest entry of each row), as a power of two: exact in every product. 1 for an empty
// row.
void scale_of_rows(Mat matrix, Vec factor) {
  const PetscInt first = row_range(matrix).first;
  const WriteArray scale(factor);
  for_each_row(matrix, [&](PetscInt row, auto, auto values) {
    double largest = 0.0;
    for (const double value : values)
      largest = std::max(largest, std::abs(value));
    const bool ordinary = largest > 0.0 && std::isfinite(largest);
    scale[row - first] = ordinary ? std::exp2(-std::round(0.5 * std::log2(largest))) : 1.0;
  });
}

// Entries A_ij A_ji of matrices with the pattern of A.
Matrix products_with_transpose(Mat matrix) {
  const Matrix transposed = transpose(matrix);
  RowBuilder builder;
  for_each_row(matrix, [&](PetscInt row, auto columns, auto values) {
    const SparseRow other = get_row(transposed.get(), row);
    auto entry = other.begin();
    for (std::size_t k = 0; k < columns.size(); ++k) {
      while (entry != other.end() && entry->first < columns[k])
        ++entry;
      if (entry == other.end()) break;
      if (entry->first == columns[k] && values[k] != 0.0 && entry->second != 0.0)
        builder.add(columns[k], values[k] * entry->second);
    }
    builder.end_row();
  });
  return builder.finish(PetscObjectComm(reinterpret_cast<PetscObject>(matrix)), column_range(matrix).size());
}

double sign_of(double value) {
  return value > 0.0 ? 1.0 : value < 0.0 ? -1.0 : 0.0;
}

}  // namespace

ScaledVi::ScaledVi(Dvi& problem) : problem_(problem), matrix_(problem.create_jacobian()) {
  for (Vector* vector : {&q_, &lower_, &upper_, &row_, &column_, &work_})
    *vector = duplicate(problem.state());
}

void ScaledVi::linearise(Vec u, Vec lower, Vec upper) {
  problem_.derivative(u, matrix_.get());
  problem_.residual(u, q_.get());
  check(MatMult(matrix_.get(), u, work_.get()));
  check(VecAXPY(q_.get(), -1.0, work_.get()));
  equilibrate();
  check(VecPointwiseMult(q_.get(), q_.get(), row_.get()));
  const auto scale = [&](Vec bounds, const Vector& scaled) {
    const ReadArray from(bounds);
    const ReadArray column(column_.get());
    const WriteArray to(scaled.get());
    for (PetscInt i = 0; i < from.size(); ++i) {
      const bool infinite = from[i] <= PETSC_NINFINITY || from[i] >= PETSC_INFINITY;
      to[i] = infinite ? from[i] : from[i] / column[i];
    }
  };
  scale(lower, lower_);
  scale(upper, upper_);
  choose_signs();
}

void ScaledVi::equilibrate() {
  constexpr int rounds = 8;
  const Matrix transposed = transpose(matrix_.get());
  const Vector rows = duplicate(work_.get());
  const Vector columns = duplicate(work_.get());
  check(VecSet(row_.get(), 1.0));
  check(VecSet(column_.get(), 1.0));
  for (int round = 0; round < rounds; ++round) {
    scale_of_rows(matrix_.get(), rows.get());
    scale_of_rows(transposed.get(), columns.get());
    check(MatDiagonalScale(matrix_.get(), rows.get(), columns.get()));
    check(MatDiagonalScale(transposed.get(), columns.get(), rows.get()));
    check(VecPointwiseMult(row_.get(), row_.get(), rows.get()));
    check(VecPointwiseMult(column_.get(), column_.get(), columns.get()));
  }
}

void ScaledVi::choose_signs() {
  constexpr int most_sweeps = 100;  // signs travel from bounded rows along rows with a zero diagonal
  const Vector signs = duplicate(work_.get());
  check(MatGetDiagonal(matrix_.get(), work_.get()));
  double unknown = 0.0;
  {
    const ReadArray diagonal(work_.get());
    const ReadArray lower(lower_.get());
    const ReadArray upper(upper_.get());
    const WriteArray sign(signs.get());
    for (PetscInt i = 0; i < sign.size(); ++i) {
      const bool bounded = lower[i] > PETSC_NINFINITY || upper[i] < PETSC_INFINITY;
      sign[i] = bounded ? 1.0 : sign_of(diagonal[i]);
      if (sign[i] == 0.0) unknown += 1.0;
    }
  }
  Matrix products;
  for (int sweep = 0; sweep < most_sweeps; ++sweep) {
    double left = unknown;
    MPI_Allreduce(MPI_IN_PLACE, &left, 1, MPI_DOUBLE, MPI_SUM, problem_.comm());
    if (left == 0.0) break;
    if (!products) products = products_with_transpose(matrix_.get());
    check(MatMult(products.get(), signs.get(), work_.get()));
    const ReadArray product(work_.get());
    const WriteArray sign(signs.get());
    double found = 0.0;
    for (PetscInt i = 0; i < sign.size(); ++i) {
      if (sign[i] != 0.0) continue;
      sign[i] = -sign_of(product[i]);
      if (sign[i] != 0.0) found += 1.0;
    }
    unknown -= found;
    MPI_Allreduce(MPI_IN_PLACE, &found, 1, MPI_DOUBLE, MPI_SUM, problem_.comm());
    if (found == 0.0) break;
  }
  const ReadArray sign(signs.get());
  sign_.assign(sign.data(), sign.data() + sign.size());
  std::replace(sign_.begin(), sign_.end(), 0.0, 1.0);  // rows that are in no pair
}

}  // namespace sweepvi
