#include "dvi/output_box.hpp"

#include <algorithm>
#include <cmath>

#include "petsc/sparse.hpp"

namespace sweepvi {

Matrix implicit_euler(Mat rates, double h) {
  RowBuilder rows;
  for_each_row(rates, [&](PetscInt row, auto columns, auto values) {
    rows.add(row, 1.0);
    for (std::size_t k = 0; k < columns.size(); ++k)
      rows.add(columns[k], -h * values[k]);
    rows.end_row();
  });
  return rows.finish(PetscObjectComm(reinterpret_cast<PetscObject>(rates)), row_range(rates).size());
}

void OutputBox::start_from(Vec u) {
  terms_ = duplicate(u);
  z_new_.resize(levels_.z.size());
  held_terms_.assign(levels_.z.size(), 0.0);
  const ReadArray values(u);
  for (std::size_t q = 0; q < places_.size(); ++q)
    levels_.z[q] = values[places_[q]];
  for (std::size_t a = 0; a < levels_.constraints(); ++a)
    levels_.w[a] = levels_.z[levels_.at(a, 1)];
}

// Bounds are the same from step to step but for a few constraints: only those are written, where the vectors
// are still as they were left.
void OutputBox::begin_levels(Vec lower, Vec upper) {
  levels_.apply_level_rule();
  if (!(VectorValue(lower) == lower_ && VectorValue(upper) == upper_)) {
    check(VecSet(lower, PETSC_NINFINITY));
    check(VecSet(upper, PETSC_INFINITY));
    written_.assign(levels_.constraints(), 0);
  }
  {
    const WriteArray l(lower);
    const WriteArray b(upper);
    for (std::size_t a = 0; a < levels_.constraints(); ++a) {
      const int now = levels_.side[a] == Side::upper ? -levels_.level[a] : levels_.level[a];
      if (now == written_[a]) continue;
      written_[a] = now;
      for (int i = 1; i <= levels_.levels(a); ++i) {
        const Interval box = levels_.box(a, i);
        l[place(a, i)] = box.lower;
        b[place(a, i)] = box.upper;
      }
    }
  }
  lower_ = VectorValue(lower);
  upper_ = VectorValue(upper);
}

void OutputBox::settle(Vec u) {
  row_terms(u, terms_.get());
  put_held(u, terms_.get());
}

bool OutputBox::put_held(Vec u, Vec row_terms_of_u) {
  bool moved = false;
  const ReadArray terms(row_terms_of_u);
  const WriteArray values(u);
  crowded_ = {};
  for (std::size_t a = 0; a < levels_.constraints(); ++a) {
    const PetscInt* const places = &places_[levels_.at(a, 1)];
    // Terms seen through the levels above: z_i = z_{i,k} + h z_{i+1}, where z_{i+1} is only known up to its
    // own terms.
    double scale = 0.0;
    int i = levels_.levels(a);
    for (; i > levels_.level[a]; --i)
      scale = terms[places[i - 1]] + h_ * scale;
    for (; i >= 2; --i) {  // what is bounded above level 1 is bounded by 0 on one side
      const PetscInt at = places[i - 1];
      scale = terms[at] + h_ * scale;
      double& value = values[at];
      if (!(std::abs(value) <= held_rtol * scale)) continue;
      moved = moved || value != 0.0;
      value = 0.0;
      held_terms_[levels_.at(a, i)] = terms[at];
    }
    const PetscInt at = places[0];
    const double near = held_rtol * (terms[at] + h_ * scale);
    const Interval box = levels_.box(a, 1);
    double& value = values[at];
    if (value > box.lower + near && value < box.upper - near) continue;
    for (const double bound : {box.upper, box.lower})
      if (value != bound && std::abs(value - bound) <= near) {
        value = bound;
        moved = true;
      }
    if (value != box.lower && value != box.upper) continue;
    held_terms_[levels_.at(a, 1)] = terms[at];
    stands_at_wall(a, near);
  }
  return moved;
}

void OutputBox::take(Vec u, Vec f, const std::vector<double>& gains) {
  {
    const ReadArray values(u);
    const ReadArray residual(f);
    std::fill(levels_.mu.begin(), levels_.mu.end(), 0.0);
    for (std::size_t a = 0; a < levels_.constraints(); ++a) {
      const std::size_t first = levels_.at(a, 1);
      const PetscInt* const places = &places_[first];
      const int levels = levels_.levels(a);
      for (int i = 0; i < levels; ++i)
        z_new_[first + static_cast<std::size_t>(i)] = values[places[i]];
      levels_.w[a] = values[places[0]];
      const auto take_measure = [&](int i, const Interval& box) {
        const double z = values[places[i - 1]];
        if (z > box.lower && z < box.upper) return;
        const double force = residual[places[i - 1]];
        const double noise = held_rtol * held_terms_[first + static_cast<std::size_t>(i - 1)];
        if ((z <= box.lower && force > noise) || (z >= box.upper && force < -noise))
          levels_.measure(a, i) = force / (i == levels ? gains[a] : 1.0);
      };
      take_measure(1, levels_.box(a, 1));
      const Interval above = levels_.box(a, 2);  // the same on all levels up to r*
      for (int i = 2; i <= levels_.level[a]; ++i)
        take_measure(i, above);
    }
    levels_.advance(z_new_);
  }
  check(VecCopy(u, u_.get()));
}

}  // namespace sweepvi
