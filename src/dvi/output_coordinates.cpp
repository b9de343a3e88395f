#include "dvi/output_coordinates.hpp"

#include <algorithm>

#include "petsc/sparse.hpp"

namespace sweepvi {

OutputCoordinates::OutputCoordinates(const LinearSystem& system, const RelativeDegree& relative_degree)
    : system_(system), relative_degree_(relative_degree) {
  find_positions();
  check(MatCreateVecs(system.A.get(), scale_.put(), nullptr));
  check(VecSet(scale_.get(), 1.0));
  int mixed = 0;
  {
    const LocalRange states = row_range(system.A.get());
    const WriteArray scale(scale_.get());
    for_each_row(relative_degree.Z.get(),
                 [&, q = std::size_t{0}](PetscInt, auto columns, auto values) mutable {
                   for (std::size_t k = 0; k < columns.size(); ++k) {
                     if (columns[k] == states.first + position_[q]) {
                       scale[position_[q]] = values[k];
                     } else if (values[k] != 0.0) {
                       mixed = 1;
                     }
                   }
                   ++q;
                 });
  }
  MPI_Allreduce(MPI_IN_PLACE, &mixed, 1, MPI_INT, MPI_LOR, system.comm());
  diagonal_ = mixed == 0;
  if (!diagonal_) find_inverse();
  double furthest[2] = {0.0, 0.0};
  check(VecMin(scale_.get(), nullptr, &furthest[0]));
  check(VecMax(scale_.get(), nullptr, &furthest[1]));
  plain_ = diagonal_ && furthest[0] == 1.0 && furthest[1] == 1.0;
}

void OutputCoordinates::find_positions() {
  const LocalRange states = row_range(system_.A.get());
  output_at_.assign(static_cast<std::size_t>(states.size()), -1);
  agreed(system_.comm(), [&] {
    for (const PetscInt pivot : relative_degree_.pivot) {
      if (!states.contains(pivot))
        throw Error(ExitCode::internal, "a constraint is not on the rank of its output states");
      output_at_[static_cast<std::size_t>(pivot - states.first)] = static_cast<PetscInt>(position_.size());
      position_.push_back(pivot - states.first);
    }
  });
}

// W = S (I + N) with S diagonal; N is nilpotent, as pivots were found by substitution.
void OutputCoordinates::find_inverse() {
  const LocalRange states = row_range(system_.A.get());
  const LocalRange outputs = row_range(relative_degree_.Z.get());
  RowBuilder w;
  RowBuilder mixing;
  RowBuilder inverse;
  {
    const ReadArray scale(scale_.get());
    for (PetscInt i = 0; i < states.size(); ++i) {
      const PetscInt q = output_at(i);
      const SparseRow row =
          q < 0 ? SparseRow{{states.first + i, 1.0}} : get_row(relative_degree_.Z.get(), outputs.first + q);
      w.add(row);
      w.end_row();
      for (const auto& [column, value] : row)
        if (column != states.first + i) mixing.add(column, value / scale[i]);
      mixing.end_row();
      inverse.add(states.first + i, 1.0 / scale[i]);
      inverse.end_row();
    }
  }
  W_ = w.finish(system_.comm(), states.size());
  const Matrix N = mixing.finish(system_.comm(), states.size());
  const Matrix unmixed = inverse.finish(system_.comm(), states.size());
  inverse_ = Matrix::share(unmixed.get());
  for (int round = 1; round < relative_degree_.highest; ++round)
    inverse_ = add(unmixed.get(), -1.0, multiply(N.get(), inverse_.get()).get());
  W_rows_ = AffineRows(W_.get());
  inverse_rows_ = AffineRows(inverse_.get());
}

void OutputCoordinates::to_u(Vec x, Vec u) const {
  if (plain_) {
    check(VecCopy(x, u));
  } else if (diagonal_) {
    check(VecPointwiseMult(u, scale_.get(), x));
  } else {
    W_rows_.multiply(x, u);
  }
}

void OutputCoordinates::to_x(Vec u, Vec x) const {
  if (plain_) {
    check(VecCopy(u, x));
  } else if (diagonal_) {
    check(VecPointwiseDivide(x, u, scale_.get()));
  } else {
    inverse_rows_.multiply(u, x);
  }
}

Matrix OutputCoordinates::scaling(bool inverse) const {
  const PetscInt first = row_range(system_.A.get()).first;
  const ReadArray scale(scale_.get());
  RowBuilder rows;
  for (PetscInt i = 0; i < scale.size(); ++i) {
    rows.add(first + i, inverse ? 1.0 / scale[i] : scale[i]);
    rows.end_row();
  }
  return rows.finish(system_.comm(), scale.size());
}

Matrix OutputCoordinates::to_u_matrix() const {
  return diagonal_ ? scaling(false) : Matrix::share(W_.get());
}

Matrix OutputCoordinates::to_x_matrix() const {
  return diagonal_ ? scaling(true) : Matrix::share(inverse_.get());
}

Matrix OutputCoordinates::companion() const {
  const LocalRange states = row_range(system_.A.get());
  const std::vector<PetscInt>& first = relative_degree_.first_level;
  std::vector<PetscInt> next(static_cast<std::size_t>(states.size()), -1);  // place of the next level
  for (std::size_t a = 0; a + 1 < first.size(); ++a)
    for (PetscInt q = first[a]; q + 1 < first[a + 1]; ++q)
      next[static_cast<std::size_t>(position_[static_cast<std::size_t>(q)])] =
          position_[static_cast<std::size_t>(q) + 1];

  Matrix transformed;
  if (diagonal_) {
    Vector inverse = duplicate(scale_.get());
    check(VecCopy(scale_.get(), inverse.get()));
    check(VecReciprocal(inverse.get()));
    check(MatDuplicate(system_.A.get(), MAT_COPY_VALUES, transformed.put()));
    check(MatDiagonalScale(transformed.get(), scale_.get(), inverse.get()));
  } else {
    transformed = multiply_clean(multiply_clean(W_.get(), system_.A.get()).get(), inverse_.get());
  }
  RowBuilder rows;
  for_each_row(transformed.get(), [&](PetscInt row, auto columns, auto values) {
    const PetscInt place = next[static_cast<std::size_t>(row - states.first)];
    if (place >= 0) {
      rows.add(states.first + place, 1.0);
    } else {
      for (std::size_t k = 0; k < columns.size(); ++k)
        rows.add(columns[k], values[k]);
    }
    rows.end_row();
  });
  return rows.finish(system_.comm(), states.size());
}

Matrix OutputCoordinates::jumps() const {
  if (relative_degree_.outputs_are_states) return {};
  const LocalRange states = row_range(system_.A.get());
  RowBuilder places;  // outputs x n: where each output stands
  for (const PetscInt place : position_) {
    places.add(states.first + place, 1.0);
    places.end_row();
  }
  const Matrix at = places.finish(system_.comm(), states.size());
  const Matrix directions = multiply(transpose(relative_degree_.directions.get()).get(), at.get());  // n x n
  const Matrix reached =
      diagonal_ ? Matrix::share(directions.get()) : multiply_clean(W_.get(), directions.get());
  const ReadArray scale(scale_.get());
  RowBuilder rows;
  int any = 0;
  for_each_row(reached.get(), [&](PetscInt row, auto columns, auto values) {
    rows.add(row, 1.0);
    for (std::size_t k = 0; k < columns.size(); ++k) {
      if (columns[k] == row || values[k] == 0.0) continue;  // own output: 1 by definition
      rows.add(columns[k], diagonal_ ? scale[row - states.first] * values[k] : values[k]);
      any = 1;
    }
    rows.end_row();
  });
  MPI_Allreduce(MPI_IN_PLACE, &any, 1, MPI_INT, MPI_LOR, system_.comm());
  Matrix result = rows.finish(system_.comm(), states.size());
  return any != 0 ? std::move(result) : Matrix{};
}

Matrix OutputCoordinates::inverse_jumps(Mat jumps) const {
  const LocalRange states = row_range(jumps);
  RowBuilder off_diagonal;
  RowBuilder diagonal;
  for_each_row(jumps, [&](PetscInt row, auto columns, auto values) {
    for (std::size_t k = 0; k < columns.size(); ++k)
      if (columns[k] != row) off_diagonal.add(columns[k], values[k]);
    off_diagonal.end_row();
    diagonal.add(row, 1.0);
    diagonal.end_row();
  });
  const Matrix reach = off_diagonal.finish(system_.comm(), states.size());
  const Matrix identity = diagonal.finish(system_.comm(), states.size());
  Matrix inverse = Matrix::share(identity.get());
  for (int power = 0; power < relative_degree_.highest; ++power)
    inverse = add(identity.get(), -1.0, multiply_clean(reach.get(), inverse.get()).get());
  return inverse;
}

}  // namespace sweepvi
