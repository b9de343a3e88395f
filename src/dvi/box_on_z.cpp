#include "dvi/box_on_z.hpp"

#include <algorithm>
#include <cmath>

#include "petsc/sparse.hpp"

namespace sweepvi {

BoxOnZ::BoxOnZ(const LinearSystem& system, const RelativeDegree& relative_degree, double t_start, double h)
    : LevelDvi(system, h), relative_degree_(relative_degree), forcing_(system, relative_degree) {
  levels_.allocate(relative_degree.degree, relative_degree.highest);
  check(MatCreateVecs(system.A.get(), scale_.put(), nullptr));
  for (Vector* vector : {&u_, &x_, &g_old_, &g_new_, &c_, &rhs_, &rhs_terms_, &work_, &terms_})
    *vector = duplicate(scale_.get());
  check(MatCreateVecs(relative_degree.Z.get(), nullptr, g_outputs_.put()));

  // Where each output lives, and its scale. The partition keeps a constraint with its output states.
  const LocalRange states = row_range(system.A.get());
  check(VecSet(scale_.get(), 1.0));
  agreed(comm(), [&] {
    const WriteArray scale(scale_.get());
    for_each_row(relative_degree.Z.get(), [&](PetscInt, auto columns, auto values) {
      if (!states.contains(columns[0]))
        throw Error(ExitCode::internal, "a constraint is not on the rank of its output states");
      position_.push_back(columns[0] - states.first);
      scale[position_.back()] = values[0];
    });
  });

  // K = I - h S A S^{-1}, with every diagonal entry in the pattern.
  check(VecCopy(scale_.get(), work_.get()));
  check(VecReciprocal(work_.get()));
  Matrix scaled;
  check(MatDuplicate(system.A.get(), MAT_COPY_VALUES, scaled.put()));
  check(MatDiagonalScale(scaled.get(), scale_.get(), work_.get()));
  RowBuilder rows;
  for_each_row(scaled.get(), [&](PetscInt row, auto columns, auto values) {
    rows.add(row, 1.0);
    for (std::size_t k = 0; k < columns.size(); ++k)
      rows.add(columns[k], -h_ * values[k]);
    rows.end_row();
  });
  K_ = rows.finish(comm(), states.size());
  abs_K_ = absolute_copy(K_.get());

  // u_0 = S x_0 + g(t_0)
  place_forcing(t_start, g_new_.get());
  check(VecPointwiseMult(u_.get(), scale_.get(), system.x0.get()));
  check(VecAXPY(u_.get(), 1.0, g_new_.get()));
  check(VecCopy(system.x0.get(), x_.get()));
  const ReadArray u(u_.get());
  for (std::size_t q = 0; q < position_.size(); ++q)
    levels_.z[q] = u[position_[q]];
  for (std::size_t a = 0; a < levels_.constraints(); ++a)
    levels_.w[a] = levels_.z[levels_.at(a, 1)];
}

void BoxOnZ::place_forcing(double t, Vec g_x) {
  forcing_.evaluate(t, g_outputs_.get());
  check(VecSet(g_x, 0.0));
  const ReadArray g(g_outputs_.get());
  const WriteArray values(g_x);
  for (std::size_t q = 0; q < position_.size(); ++q)
    values[position_[q]] = g[static_cast<PetscInt>(q)];
}

Matrix BoxOnZ::create_jacobian() const {
  Matrix jacobian;
  check(MatDuplicate(K_.get(), MAT_COPY_VALUES, jacobian.put()));
  return jacobian;
}

void BoxOnZ::find_c(const Step& step) {
  if (step.number > 1 && !forcing_.varies()) return;  // c is constant
  place_forcing(step.t_old, g_old_.get());
  place_forcing(step.t_new, g_new_.get());
  check(MatMult(K_.get(), g_new_.get(), c_.get()));
  check(VecAXPY(c_.get(), -1.0, g_old_.get()));
  check(VecSet(work_.get(), 0.0));
  system_.f.add_to(work_.get(), step.t_new, 0, step.h);
  check(VecPointwiseMult(work_.get(), work_.get(), scale_.get()));
  check(VecAXPY(c_.get(), 1.0, work_.get()));
  const WriteArray c(c_.get());
  for (std::size_t a = 0; a < levels_.constraints(); ++a)
    for (int i = 1; i < levels_.levels(a); ++i)
      c[position_[levels_.at(a, i)]] = 0.0;
}

void BoxOnZ::begin(const Step& step, Vec lower, Vec upper, Vec guess) {
  levels_.apply_level_rule();
  check(VecSet(lower, PETSC_NINFINITY));
  check(VecSet(upper, PETSC_INFINITY));
  {
    const WriteArray l(lower);
    for (std::size_t a = 0; a < levels_.constraints(); ++a)
      for (int i = 1; i <= levels_.level[a]; ++i)
        l[position_[levels_.at(a, i)]] = 0.0;
  }
  find_c(step);
  check(VecWAXPY(rhs_.get(), 1.0, u_.get(), c_.get()));
  const ReadArray u(u_.get());
  const ReadArray c(c_.get());
  {
    const WriteArray terms(rhs_terms_.get());
    for (PetscInt i = 0; i < u.size(); ++i)
      terms[i] = std::abs(u[i]) + std::abs(c[i]);
  }
  check(VecCopy(u_.get(), guess));
}

void BoxOnZ::residual(Vec u, Vec f) {
  check(MatMult(K_.get(), u, f));
  check(VecAXPY(f, -1.0, rhs_.get()));
}

void BoxOnZ::row_terms(Vec u, Vec terms) {
  check(VecCopy(u, work_.get()));
  check(VecAbs(work_.get()));
  check(MatMultAdd(abs_K_.get(), work_.get(), rhs_terms_.get(), terms));
}

void BoxOnZ::jacobian(Vec, Mat jacobian) {
  check(MatCopy(K_.get(), jacobian, SAME_NONZERO_PATTERN));
}

void BoxOnZ::settle(Vec u) {
  row_terms(u, terms_.get());
  const ReadArray terms(terms_.get());
  const ReadArray old(u_.get());
  const WriteArray values(u);
  for (std::size_t a = 0; a < levels_.constraints(); ++a) {
    // Terms seen through the levels above: z_i = z_{i,k} + h z_{i+1}, where z_{i+1} is only known up to its
    // own terms.
    double scale = 0.0;
    for (int i = levels_.levels(a); i >= 1; --i) {
      const PetscInt at = position_[levels_.at(a, i)];
      scale = i == levels_.levels(a) ? terms[at] : std::abs(old[at]) + std::abs(values[at]) + h_ * scale;
      if (i <= levels_.level[a] && std::abs(values[at]) <= held_rtol * scale) values[at] = 0.0;
    }
  }
}

void BoxOnZ::accept(Vec u, Vec f) {
  row_terms(u, terms_.get());
  {
    const ReadArray terms(terms_.get());
    const ReadArray values(u);
    const ReadArray residual(f);
    std::vector<double> z_new(position_.size());
    std::fill(levels_.mu.begin(), levels_.mu.end(), 0.0);
    for (std::size_t a = 0; a < levels_.constraints(); ++a) {
      for (int i = 1; i <= levels_.levels(a); ++i) {
        const std::size_t q = levels_.at(a, i);
        const PetscInt at = position_[q];
        z_new[q] = values[at];
        const bool holds = i <= levels_.level[a] && values[at] <= 0.0 && residual[at] > held_rtol * terms[at];
        if (!holds) continue;
        const double per_measure = i == levels_.levels(a) ? relative_degree_.markov_diagonal[a] : 1.0;
        levels_.measure(a, i) = residual[at] / per_measure;
      }
      levels_.w[a] = z_new[levels_.at(a, 1)];
    }
    levels_.advance(z_new);
  }
  check(VecCopy(u, u_.get()));
  recover_x(u);
}

// x = S^{-1} (u - g)
void BoxOnZ::recover_x(Vec u) {
  check(VecWAXPY(x_.get(), -1.0, g_new_.get(), u));
  check(VecPointwiseDivide(x_.get(), x_.get(), scale_.get()));
}

}  // namespace sweepvi
