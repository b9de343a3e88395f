#include "dvi/saddle_rows.hpp"

#include <algorithm>
#include <cmath>

#include "petsc/sparse.hpp"

namespace sweepvi {

SaddleRows::SaddleRows(Mat K, PetscInt states) : rows_(K), states_(states), count_(rows_.size()) {
  const Vector marks = make_vector(PetscObjectComm(reinterpret_cast<PetscObject>(K)), count_);
  {
    const WriteArray is_state(marks.get());
    for (PetscInt i = 0; i < count_; ++i)
      is_state[i] = i < states_ ? 1.0 : 0.0;
  }
  const double* others = rows_.ghosts(marks.get());
  const auto is_state = [&](PetscInt column) {
    return column < count_ ? column < states_ : others[column - count_] != 0.0;
  };
  for (PetscInt i = 0; i < count_; ++i) {
    for (const bool of_states : {true, false}) {
      for (const auto& [offset, value] : rows_.entries(i)) {
        if (value == 0.0 || is_state(i + offset) != of_states) continue;
        columns_.push_back(i + offset);
        values_.push_back(value);
      }
      (of_states ? middle_ : starts_).push_back(static_cast<PetscInt>(columns_.size()));
    }
  }
}

SaddleRows::Range SaddleRows::range(Part part) const {
  return {part == Part::multipliers ? states_ : 0, part == Part::states ? states_ : count_};
}

// Calls visit with the function that gives the value of a column.
template <class Visit>
void SaddleRows::visit(Vec u, Visit&& visit) const {
  const double* others = rows_.ghosts(u);
  const ReadArray own(u);
  const double* values = own.data();
  if (others == nullptr)
    visit([values](PetscInt column) { return values[column]; });
  else
    visit([values, others, count = count_](PetscInt column) {
      return column < count ? values[column] : others[column - count];
    });
}

void SaddleRows::evaluate(Vec u, Vec b, Vec b_terms, Vec f, Vec known, Vec pushed) const {
  const PetscInt* columns = columns_.data();
  const double* values = values_.data();
  visit(u, [&](auto&& at) {
    const ReadArray right(b);
    const ReadArray right_terms(b_terms);
    const WriteArray result(f);
    const WriteArray terms(known);
    const WriteArray excess(pushed);
    for (PetscInt i = 0; i < count_; ++i) {
      const auto row = static_cast<std::size_t>(i);
      double sum = 0.0;
      double size = 0.0;
      for (PetscInt k = starts_[row]; k < middle_[row]; ++k) {
        const double term = values[k] * at(columns[k]);
        sum += term;
        size += std::abs(term);
      }
      double push = 0.0;
      double push_size = 0.0;
      for (PetscInt k = middle_[row]; k < starts_[row + 1]; ++k) {
        const double term = values[k] * at(columns[k]);
        push += term;
        push_size += std::abs(term);
      }
      const double counted = i < states_ ? std::abs(push) : push_size;
      result[i] = sum + push - right[i];
      terms[i] = size + right_terms[i] + counted;
      excess[i] = push_size - counted;
    }
  });
}

void SaddleRows::outputs(Vec u, Vec b, Vec f) const {
  const PetscInt* columns = columns_.data();
  const double* values = values_.data();
  visit(u, [&](auto&& at) {
    const ReadArray right(b);
    const WriteArray result(f);
    for (PetscInt i = states_; i < count_; ++i) {
      const auto row = static_cast<std::size_t>(i);
      double sum = 0.0;
      for (PetscInt k = starts_[row]; k < starts_[row + 1]; ++k)
        sum += values[k] * at(columns[k]);
      result[i] = sum - right[i];
    }
  });
}

void SaddleRows::read_states(Vec terms, double most, Part part, Vec result) const {
  const Range asked = range(part);
  const PetscInt* columns = columns_.data();
  const double* values = values_.data();
  visit(terms, [&](auto&& at) {
    const WriteArray sums(result);
    for (PetscInt i = asked.first; i < asked.last; ++i) {
      const auto row = static_cast<std::size_t>(i);
      double sum = 0.0;
      for (PetscInt k = starts_[row]; k < middle_[row]; ++k)
        sum += std::min(std::abs(values[k]), most) * at(columns[k]);
      sums[i] = sum;
    }
  });
}

void SaddleRows::add_pushes(Vec nu, Vec x) const {
  const PetscInt* columns = columns_.data();
  const double* values = values_.data();
  visit(nu, [&](auto&& at) {
    const WriteArray sums(x);
    for (PetscInt i = 0; i < states_; ++i) {
      const auto row = static_cast<std::size_t>(i);
      double sum = 0.0;
      for (PetscInt k = middle_[row]; k < starts_[row + 1]; ++k)
        sum += values[k] * at(columns[k]);
      sums[i] += sum;
    }
  });
}

}  // namespace sweepvi
