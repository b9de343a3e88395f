#include "petsc/sparse.hpp"

#include <petsc/private/petscimpl.h>

#include <cmath>

namespace sweepvi {

PetscObjectState state_of(Vec vector) {
  PetscObjectState state = 0;
  check(PetscObjectStateGet(reinterpret_cast<PetscObject>(vector), &state));
  return state;
}

void normalise(SparseRow& row) {
  std::sort(row.begin(), row.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  std::size_t kept = 0;
  for (std::size_t i = 0; i < row.size(); ++i) {
    if (kept > 0 && row[kept - 1].first == row[i].first) {
      row[kept - 1].second += row[i].second;
    } else {
      row[kept++] = row[i];
    }
  }
  row.resize(kept);
}

SparseRow add(const SparseRow& a, double factor, const SparseRow& b) {
  SparseRow sum = a;
  for (const auto& [index, value] : b)
    sum.emplace_back(index, factor * value);
  normalise(sum);
  return sum;
}

double dot(const SparseRow& a, const SparseRow& b) {
  double sum = 0.0;
  for (auto i = a.begin(), j = b.begin(); i != a.end() && j != b.end();) {
    if (i->first < j->first) {
      ++i;
    } else if (j->first < i->first) {
      ++j;
    } else {
      sum += (i++)->second * (j++)->second;
    }
  }
  return sum;
}

void RowBuilder::end_row() {
  normalise(row_);
  for (const auto& [column, value] : row_) {
    columns_.push_back(column);
    values_.push_back(value);
  }
  starts_.push_back(static_cast<PetscInt>(columns_.size()));  // finish() looks whether they fit
  row_.clear();
}

Matrix RowBuilder::finish(MPI_Comm comm, PetscInt local_columns) {
  agreed(comm, [&] {
    constexpr std::size_t most = std::numeric_limits<PetscInt>::max();
    if (columns_.size() > most)
      throw InputError("a rank's part of a matrix has " + std::to_string(columns_.size()) +
                       " entries, and PETSc counts up to " + std::to_string(most) + "; use more ranks");
  });
  Matrix matrix;
  check(MatCreate(comm, matrix.put()));
  check(MatSetSizes(matrix.get(), static_cast<PetscInt>(starts_.size()) - 1, local_columns, PETSC_DETERMINE,
                    PETSC_DETERMINE));
  check(MatSetType(matrix.get(), MATAIJ));
  // Each of the two acts only on its own type (one rank: sequential).
  check(MatSeqAIJSetPreallocationCSR(matrix.get(), starts_.data(), columns_.data(), values_.data()));
  check(MatMPIAIJSetPreallocationCSR(matrix.get(), starts_.data(), columns_.data(), values_.data()));
  *this = RowBuilder{};
  return matrix;
}

SparseRow get_row(Mat matrix, PetscInt row) {
  PetscInt count = 0;
  const PetscInt* columns = nullptr;
  const PetscScalar* values = nullptr;
  check(MatGetRow(matrix, row, &count, &columns, &values));
  SparseRow result;
  for (PetscInt k = 0; k < count; ++k)
    result.emplace_back(columns[k], values[k]);
  check(MatRestoreRow(matrix, row, &count, &columns, &values));
  return result;
}

namespace {

void make_absolute(Mat sequential) {
  MatInfo info;
  check(MatGetInfo(sequential, MAT_LOCAL, &info));
  PetscScalar* values = nullptr;
  check(MatSeqAIJGetArray(sequential, &values));
  const auto count = static_cast<std::size_t>(info.nz_used);
  for (std::size_t k = 0; k < count; ++k)
    values[k] = std::abs(values[k]);
  check(MatSeqAIJRestoreArray(sequential, &values));
}

}  // namespace

bool replace_values(Mat to, Mat from) {
  int fits = 1;
  for_each_row(from, [&](PetscInt row, auto columns, auto) {
    const SparseRow pattern = get_row(to, row);
    auto place = pattern.begin();
    for (const PetscInt column : columns) {
      while (place != pattern.end() && place->first < column)
        ++place;
      if (place == pattern.end() || place->first != column) fits = 0;
    }
  });
  MPI_Allreduce(MPI_IN_PLACE, &fits, 1, MPI_INT, MPI_LAND,
                PetscObjectComm(reinterpret_cast<PetscObject>(to)));
  if (fits == 0) return false;
  check(MatZeroEntries(to));
  for_each_row(from, [&](PetscInt row, auto columns, auto values) {
    check(MatSetValues(to, 1, &row, static_cast<PetscInt>(columns.size()), columns.data(), values.data(),
                       INSERT_VALUES));
  });
  check(MatAssemblyBegin(to, MAT_FINAL_ASSEMBLY));
  check(MatAssemblyEnd(to, MAT_FINAL_ASSEMBLY));
  return true;
}

Matrix absolute_copy(Mat matrix) {
  Matrix copy;
  check(MatDuplicate(matrix, MAT_SHARE_NONZERO_PATTERN, copy.put()));
  check(MatCopy(matrix, copy.get(), SAME_NONZERO_PATTERN));
  PetscBool parallel = PETSC_FALSE;
  check(PetscObjectTypeCompare(reinterpret_cast<PetscObject>(matrix), MATMPIAIJ, &parallel));
  if (parallel == PETSC_TRUE) {
    Mat diagonal = nullptr;
    Mat off_diagonal = nullptr;
    check(MatMPIAIJGetSeqAIJ(copy.get(), &diagonal, &off_diagonal, nullptr));
    make_absolute(diagonal);
    make_absolute(off_diagonal);
  } else {
    make_absolute(copy.get());
  }
  return copy;
}

Matrix multiply(Mat a, Mat b) {
  Matrix product;
  check(MatMatMult(a, b, MAT_INITIAL_MATRIX, PETSC_DEFAULT, product.put()));
  return product;
}

Matrix multiply_clean(Mat a, Mat b) {
  const Matrix product = multiply(a, b);
  const Matrix magnitude = multiply(absolute_copy(a).get(), absolute_copy(b).get());  // same sparsity
  RowBuilder rows;
  for_each_row(product.get(), [&](PetscInt row, auto columns, auto values) {
    const SparseRow terms = get_row(magnitude.get(), row);
    for (std::size_t k = 0; k < columns.size(); ++k)
      if (std::abs(values[k]) > rounding * terms[k].second) rows.add(columns[k], values[k]);
    rows.end_row();
  });
  return rows.finish(PetscObjectComm(reinterpret_cast<PetscObject>(a)), column_range(b).size());
}

Matrix add(Mat a, double factor, Mat b) {
  Matrix sum;
  check(MatDuplicate(a, MAT_COPY_VALUES, sum.put()));
  check(MatAXPY(sum.get(), factor, b, DIFFERENT_NONZERO_PATTERN));
  return sum;
}

Matrix transpose(Mat a) {
  Matrix result;
  check(MatTranspose(a, MAT_INITIAL_MATRIX, result.put()));
  return result;
}

Vector make_vector(MPI_Comm comm, PetscInt local_size) {
  Vector vector;
  check(VecCreate(comm, vector.put()));
  check(VecSetSizes(vector.get(), local_size, PETSC_DETERMINE));
  check(VecSetType(vector.get(), VECSTANDARD));
  check(VecSet(vector.get(), 0.0));
  return vector;
}

Vector duplicate(Vec vector) {
  Vector copy;
  check(VecDuplicate(vector, copy.put()));
  check(VecSet(copy.get(), 0.0));
  return copy;
}

LocalRange row_range(Mat matrix) {
  LocalRange range;
  check(MatGetOwnershipRange(matrix, &range.first, &range.last));
  return range;
}

LocalRange column_range(Mat matrix) {
  LocalRange range;
  check(MatGetOwnershipRangeColumn(matrix, &range.first, &range.last));
  return range;
}

}  // namespace sweepvi
