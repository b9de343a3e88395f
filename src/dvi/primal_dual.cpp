#include "dvi/primal_dual.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "dvi/stacked.hpp"
#include "petsc/direct_solver.hpp"
#include "petsc/sparse.hpp"

namespace sweepvi {

struct PrimalDual::Blocks {
  Matrix E;  // n x multipliers
  Matrix G;  // multipliers x n
  Matrix H;  // multipliers x multipliers, or empty
};

PrimalDual::PrimalDual(const LinearSystem& system, const RelativeDegree& relative_degree, Scheme scheme,
                       double t_start, double h, double theta)
    : LevelDvi(system.comm(), h),
      system_(system),
      relative_degree_(relative_degree),
      scheme_(scheme),
      theta_(theta),
      with_levels_(scheme == Scheme::homsp && relative_degree.highest > 1),
      has_outputs_(scheme == Scheme::homsp && relative_degree.lowest > 0),
      completes_(scheme != Scheme::naive_euler && system.f.varies && relative_degree.highest > 2),
      forcing_(system, relative_degree) {
  const std::size_t count = relative_degree.degree.size();
  levels_.allocate(with_levels_ ? relative_degree.degree : std::vector<int>(count, 1),
                   with_levels_ ? relative_degree.highest : std::max(1, relative_degree.highest),
                   system.wmax.get());
  two_sided_ = static_cast<bool>(system.wmax);
  for (std::size_t a = 0; a < count; ++a)
    if (levels_.upper[a] < PETSC_INFINITY) upper_walls_.push_back(a);
  find_measures();
  for (std::size_t a = 0; a < count && !with_levels_; ++a)
    levels_.mu_shift[a] = std::max(1, relative_degree.degree[a]) - 1;
  pinned_.assign(levels_.z.size(), 0);
  output_scale_.assign(levels_.z.size(), 0.0);
  at_upper_.assign(upper_walls_.size(), 0);
  held_.assign(levels_.z.size(), 0);
  open_.assign(levels_.z.size(), 0);
  settled_z_.assign(levels_.z.size(), 0.0);

  const Blocks blocks = make_blocks();
  check(MatCreateVecs(system.A.get(), x_.put(), phi_.put()));
  shift_ = duplicate(phi_.get());
  if (theta != 1.0) abs_A_ = absolute_copy(system.A.get());
  push_ = duplicate(phi_.get());
  check(MatCreateVecs(blocks.E.get(), g_.put(), nullptr));
  check(MatCreateVecs(relative_degree.Z.get(), nullptr, output_g_old_.put()));
  output_g_new_ = duplicate(output_g_old_.get());
  defect_ = duplicate(output_g_old_.get());
  cross_terms_ = duplicate(output_g_old_.get());
  local_x_ = row_range(system.A.get()).size();
  assemble(blocks);
  check(MatCreateVecs(K_.get(), u_.put(), nullptr));
  for (Vector* vector : {&rhs_, &rhs_terms_, &work_, &terms_, &inherited_, &spread_, &pushed_})
    *vector = duplicate(u_.get());
  if (with_levels_ || completes_) find_cross_coupling();
  if (completes_) prepare_completion();
  find_unit_outputs();

  check(VecCopy(system.x0.get(), x_.get()));
  check(VecSet(u_.get(), 0.0));
  evaluate_g(t_start, g_.get());
  forcing_.evaluate(t_start, output_g_new_.get());
  Vector z = duplicate(g_.get());
  check(MatMultAdd(blocks.G.get(), x_.get(), g_.get(), z.get()));
  const ReadArray x(x_.get());
  const ReadArray outputs(z.get());
  const WriteArray u(u_.get());
  for (PetscInt i = 0; i < x.size(); ++i)
    u[i] = x[i];
  for (std::size_t q = 0; q < levels_.z.size(); ++q)
    levels_.z[q] = outputs[static_cast<PetscInt>(q)];
  for (std::size_t a = 0; a < count; ++a)
    levels_.w[a] = levels_.z[levels_.at(a, 1)];
}

void PrimalDual::find_measures() {
  measure_per_nu_.assign(levels_.z.size(), 1.0);
  for (std::size_t a = 0; a < levels_.constraints(); ++a) {
    double& last = measure_per_nu_[levels_.at(a, levels_.levels(a))];
    if (with_levels_)
      last = 1.0 / relative_degree_.markov_diagonal[a];
    else if (scheme_ == Scheme::zd_euler)
      last = std::pow(h_, 1 - relative_degree_.degree[a]);
    else if (scheme_ == Scheme::naive_euler || system_.D)
      last = h_;
  }
}

bool PrimalDual::set_step(double h) {
  h_ = h;
  find_measures();
  assemble(make_blocks());
  has_increment_ = false;
  ++pinned_version_;
  return true;
}

// The rows of a matrix laid out like the lower multipliers, then those of level 1 again with a minus sign,
// one for each upper wall.
Matrix PrimalDual::mirrored(Mat lower) const {
  if (!system_.wmax) return Matrix::share(lower);
  const LocalRange range = row_range(lower);
  RowBuilder rows;
  for (PetscInt q = range.first; q < range.last; ++q) {
    rows.add(get_row(lower, q));
    rows.end_row();
  }
  for (const std::size_t a : upper_walls_) {
    rows.add(get_row(lower, range.first + static_cast<PetscInt>(levels_.at(a, 1))), -1.0);
    rows.end_row();
  }
  return rows.finish(comm(), column_range(lower).size());
}

PrimalDual::Blocks PrimalDual::make_blocks() const {
  Blocks blocks;
  if (with_levels_) {
    blocks.E = transpose(mirrored(relative_degree_.directions.get()).get());
    blocks.G = mirrored(relative_degree_.Z.get());
    return blocks;
  }
  // E = B diag(e), H = D diag(e / h): the multiplier of the scheme in a scale of its own.
  Vector e;
  check(MatCreateVecs(system_.B.get(), e.put(), nullptr));
  {
    const WriteArray values(e.get());
    for (std::size_t a = 0; a < measure_per_nu_.size(); ++a)
      values[static_cast<PetscInt>(a)] = measure_per_nu_[a];
  }
  const Matrix pushed = transpose(system_.B.get());
  check(MatDiagonalScale(pushed.get(), e.get(), nullptr));
  blocks.E = transpose(mirrored(pushed.get()).get());
  blocks.G = mirrored(system_.C.get());
  if (system_.D) {
    Matrix H = transpose(system_.D.get());
    check(VecScale(e.get(), 1.0 / h_));
    check(MatDiagonalScale(H.get(), e.get(), nullptr));
    H = transpose(mirrored(H.get()).get());  // columns
    blocks.H = mirrored(H.get());
  }
  return blocks;
}

void PrimalDual::assemble(const Blocks& blocks) {
  const Stacked number(system_.A.get(), g_.get());
  const LocalRange states = row_range(system_.A.get());
  const LocalRange multipliers = row_range(blocks.G.get());
  first_row_ = states.first + multipliers.first;
  RowBuilder rows;
  for (PetscInt i = states.first; i < states.last; ++i) {
    rows.add(number.x(i), 1.0);
    for (const auto& [column, value] : get_row(system_.A.get(), i))
      rows.add(number.x(column), -h_ * theta_ * value);
    for (const auto& [column, value] : get_row(blocks.E.get(), i))
      rows.add(number.nu(column), -value);
    rows.end_row();
  }
  for (PetscInt q = multipliers.first; q < multipliers.last; ++q) {
    for (const auto& [column, value] : get_row(blocks.G.get(), q))
      rows.add(number.x(column), value);
    if (blocks.H)
      for (const auto& [column, value] : get_row(blocks.H.get(), q))
        rows.add(number.nu(column), value);
    rows.add(number.nu(q), 0.0);  // room for the row nu = 0 of a level above r*
    rows.end_row();
  }
  K_ = rows.finish(comm(), states.size() + multipliers.size());
  rows_ = SaddleRows(K_.get(), states.size());
  ++rows_version_;
  level_of_unknown_.assign(static_cast<std::size_t>(states.size()), 0);
  for (std::size_t a = 0; a < levels_.constraints(); ++a)
    for (int i = 1; i <= levels_.levels(a); ++i)
      level_of_unknown_.push_back(i);
  level_of_unknown_.resize(
      static_cast<std::size_t>(states.size()) + static_cast<std::size_t>(multipliers.size()),
      1);  // upper walls
}

// How measures along the d_{b,j} reach the outputs of other constraints: Z D without its unit diagonal, rows
// of level r left out (those outputs are solved for, not completed). Mostly empty: only constraints coupled
// above level 1 differ.
void PrimalDual::find_cross_coupling() {
  const Matrix directions = transpose(relative_degree_.directions.get());
  const Matrix product = multiply(relative_degree_.Z.get(), directions.get());
  const Matrix magnitude =
      multiply(absolute_copy(relative_degree_.Z.get()).get(), absolute_copy(directions.get()).get());
  const LocalRange outputs = row_range(product.get());
  std::vector<char> last_level(static_cast<std::size_t>(outputs.size()), 0);
  for (std::size_t a = 0; a < relative_degree_.degree.size(); ++a)
    last_level[static_cast<std::size_t>(relative_degree_.first_level[a + 1] - 1)] = 1;
  RowBuilder rows;
  int any = 0;
  for (PetscInt row = outputs.first; row < outputs.last; ++row) {
    const std::size_t q = static_cast<std::size_t>(row - outputs.first);
    const SparseRow values = get_row(product.get(), row);
    const SparseRow terms = get_row(magnitude.get(), row);  // same sparsity
    for (std::size_t k = 0; k < values.size() && last_level[q] == 0; ++k) {
      const auto [column, value] = values[k];
      if (column == row || std::abs(value) <= held_rtol * terms[k].second) continue;
      rows.add(column, value);
      any = 1;
    }
    rows.end_row();
  }
  Matrix cross = rows.finish(comm(), outputs.size());
  MPI_Allreduce(MPI_IN_PLACE, &any, 1, MPI_INT, MPI_LOR, comm());
  if (any == 0) return;
  cross_ = std::move(cross);
  cross_rows_ = AffineRows(cross_.get());
}

// The increment is completed along d_{a,i}, i < r, by c with (I + cross) c = defect; nothing to solve without
// coupling.
void PrimalDual::prepare_completion() {
  if (!cross_) return;
  const LocalRange outputs = row_range(cross_.get());
  RowBuilder rows;
  for (PetscInt row = outputs.first; row < outputs.last; ++row) {
    rows.add(get_row(cross_.get(), row));
    rows.add(row, 1.0);
    rows.end_row();
  }
  completion_ = rows.finish(comm(), outputs.size());
  check(KSPCreate(comm(), completion_solver_.put()));
  check(KSPSetOptionsPrefix(completion_solver_.get(), "sweepvi_completion_"));
  check(KSPSetOperators(completion_solver_.get(), completion_.get(), completion_.get()));
  default_to_mumps(completion_solver_.get());
  check_options(KSPSetFromOptions(completion_solver_.get()));
}

Matrix PrimalDual::create_jacobian() const {
  Matrix jacobian;
  check(MatDuplicate(K_.get(), MAT_COPY_VALUES, jacobian.put()));
  check(MatSetOption(jacobian.get(), MAT_KEEP_NONZERO_PATTERN, PETSC_TRUE));
  return jacobian;
}

// What forcing, offsets and upper walls add to F_nu.
void PrimalDual::evaluate_g(double t, Vec g) {
  if (with_levels_) forcing_.evaluate(t, output_g_new_.get());
  const ReadArray lower(with_levels_ ? output_g_new_.get() : system_.w0.get());
  const WriteArray values(g);
  std::copy_n(lower.data(), lower.size(), values.data());
  for (std::size_t k = 0; k < upper_walls_.size(); ++k) {
    const std::size_t a = upper_walls_[k];
    values[upper_at(k)] = levels_.upper[a] - lower[static_cast<PetscInt>(levels_.at(a, 1))];
  }
}

void PrimalDual::find_increment(const Step& step) {
  if (has_increment_ && !system_.f.varies) return;
  has_increment_ = true;
  check(VecSet(phi_.get(), 0.0));
  system_.f.add_to(phi_.get(), step.t_new, 0, step.h * theta_);
  if (abs_A_) system_.f.add_to(phi_.get(), step.t_old, 0, step.h * (1.0 - theta_));
  evaluate_g(step.t_new, g_.get());
  if (!completes_) return;
  forcing_.evaluate(step.t_old, output_g_old_.get());
  forcing_.evaluate(step.t_new, output_g_new_.get());
  forcing_.increment_defect(step, theta_, output_g_old_.get(), output_g_new_.get(), defect_.get());
  if (completion_solver_) check(KSPSolve(completion_solver_.get(), defect_.get(), defect_.get()));
  check(MatMultTransposeAdd(relative_degree_.directions.get(), defect_.get(), phi_.get(), phi_.get()));
}

// h (1-theta) A x_k, to the right side and to what it is summed from.
void PrimalDual::add_old_rates() {
  const double weight = h_ * (1.0 - theta_);
  check(MatMult(system_.A.get(), x_.get(), shift_.get()));
  check(VecScale(shift_.get(), weight));
  add_states(shift_.get(), rhs_.get());
  check(VecCopy(x_.get(), push_.get()));
  check(VecAbs(push_.get()));
  check(MatMult(abs_A_.get(), push_.get(), shift_.get()));
  check(VecScale(shift_.get(), weight));
  add_states(shift_.get(), rhs_terms_.get());
}

void PrimalDual::begin(const Step& step, Vec lower, Vec upper, Vec guess) {
  levels_.apply_level_rule();
  scales_known_ = false;
  check(VecSet(lower, PETSC_NINFINITY));
  check(VecSet(upper, PETSC_INFINITY));
  {
    const WriteArray l(lower);
    const WriteArray b(upper);
    for (std::size_t a = 0; a < levels_.constraints(); ++a) {
      for (int i = 1; i <= levels_.levels(a); ++i) {
        const std::size_t q = levels_.at(a, i);
        const char pin = i > levels_.level[a] ? 1 : 0;
        if (pin != pinned_[q]) ++pinned_version_;
        pinned_[q] = pin;
        if (pinned(q)) continue;
        const PetscInt row = local_x_ + static_cast<PetscInt>(q);
        (orientation(a, i) < 0.0 ? b : l)[row] = 0.0;
      }
    }
    for (std::size_t k = 0; k < upper_walls_.size(); ++k)
      l[local_x_ + upper_at(k)] = 0.0;
  }
  find_increment(step);
  check(VecCopy(u_.get(), guess));
  find_right_side(guess);
  if (abs_A_) add_old_rates();
}

void PrimalDual::find_right_side(Vec guess) {
  const ReadArray u(u_.get());
  const ReadArray phi(phi_.get());
  const ReadArray g(g_.get());
  const WriteArray rhs(rhs_.get());
  const WriteArray terms(rhs_terms_.get());
  const WriteArray start(guess);
  for (PetscInt i = 0; i < local_x_; ++i) {
    rhs[i] = u[i] + phi[i];
    terms[i] = std::abs(u[i]) + std::abs(phi[i]);
  }
  for (PetscInt q = 0; q < g.size(); ++q) {
    rhs[local_x_ + q] = -g[q];
    terms[local_x_ + q] = std::abs(g[q]);
    if (q < static_cast<PetscInt>(pinned_.size()) && pinned(static_cast<std::size_t>(q)))
      start[local_x_ + q] = 0.0;
  }
}

void PrimalDual::residual(Vec u, Vec f) {
  rows_.rows().residual(u, rhs_.get(), f);
  const ReadArray values(u);
  const WriteArray residual(f);
  for (std::size_t q = 0; q < pinned_.size(); ++q) {
    const PetscInt row = local_x_ + static_cast<PetscInt>(q);
    if (pinned(q)) residual[row] = values[row];
  }
}

// What x is known up to: the terms of its rows, where multipliers count by what is left of them together.
// They may cancel to any amount - where constraints contradict each other, without end - and constraints then
// know x far better than its rows do.
//
// A row may be made of residue alone: in contact, outputs vanish, and states mixed of them with them. What
// such a row reads is known only up to the terms of the rows below it, so a tenth of those counts as its own:
// terms + R^{r-1} terms / 10 (r at least 2; R: |K| up to 1), which leaves rows with terms of their own as
// they are.
//
// f becomes F before levels above r* are pinned, pushed_ what multipliers of a row cancel among themselves.
void PrimalDual::known_terms(Vec u, Vec f, SaddleRows::Part part, Vec terms) {
  rows_.evaluate(u, rhs_.get(), rhs_terms_.get(), f, terms, pushed_.get());
  Vec from = terms;
  Vec to = inherited_.get();
  const int sweeps = std::max(2, relative_degree_.highest) - 1;
  for (int i = 1; i <= sweeps; ++i) {
    rows_.read_states(from, 1.0, i < sweeps ? SaddleRows::Part::states : part, to);
    from = std::exchange(to, i == 1 ? spread_.get() : from);
  }
  const ReadArray inherited(from);
  const WriteArray result(terms);
  const PetscInt count = part == SaddleRows::Part::states ? local_x_ : result.size();
  for (PetscInt i = 0; i < count; ++i)
    result[i] += 0.1 * inherited[i];
}

void PrimalDual::row_terms(Vec u, Vec terms) {
  residual_and_terms(u, work_.get(), terms);
}

void PrimalDual::residual_and_terms(Vec u, Vec f, Vec terms) {
  known_terms(u, f, SaddleRows::Part::all, terms);
  const ReadArray values(u);
  const ReadArray pushed(pushed_.get());
  const WriteArray residual(f);
  const WriteArray result(terms);
  for (PetscInt i = 0; i < local_x_; ++i)
    result[i] += pushed[i];
  for (std::size_t q = 0; q < pinned_.size(); ++q) {
    if (!pinned(q)) continue;
    const PetscInt row = local_x_ + static_cast<PetscInt>(q);
    residual[row] = values[row];
    result[row] = std::abs(values[row]);
  }
}

void PrimalDual::add_states(Vec states, Vec terms) const {
  const ReadArray from(states);
  const WriteArray to(terms);
  for (PetscInt i = 0; i < local_x_; ++i)
    to[i] += from[i];
}

// Multipliers hand on nothing.
bool PrimalDual::spread_terms(Vec terms) {
  rows_.read_states(terms, 1.0, SaddleRows::Part::all, work_.get());
  check(VecCopy(work_.get(), terms));
  return true;
}

void PrimalDual::jacobian(Vec, Mat jacobian) {
  check(MatCopy(K_.get(), jacobian, SAME_NONZERO_PATTERN));
  std::vector<PetscInt> rows;
  for (std::size_t q = 0; q < pinned_.size(); ++q)
    if (pinned(q)) rows.push_back(first_row_ + local_x_ + static_cast<PetscInt>(q));
  check(MatZeroRows(jacobian, static_cast<PetscInt>(rows.size()), rows.data(), 1.0, nullptr, nullptr));
}

// Outputs that are one state, up to scale: a held one is put exactly on its bound by that state.
void PrimalDual::find_unit_outputs() {
  unit_state_.assign(levels_.z.size(), -1);
  unit_remote_.assign(levels_.z.size(), -1);
  unit_scale_.assign(levels_.z.size(), 0.0);
  if (!with_levels_) return;
  const Stacked number(system_.A.get(), g_.get());
  const LocalRange states = row_range(system_.A.get());
  std::size_t q = 0;
  int remote = 0;
  int mixed = 0;
  for_each_row(relative_degree_.Z.get(), [&](PetscInt, auto columns, auto values) {
    if (columns.size() == 1) {
      unit_scale_[q] = values[0];
      if (states.contains(columns[0])) {
        unit_state_[q] = columns[0] - states.first;
      } else {
        unit_remote_[q] = number.x(columns[0]);
        remote = 1;
      }
    } else {
      mixed = 1;
    }
    ++q;
  });
  int flags[2] = {remote, mixed};
  MPI_Allreduce(MPI_IN_PLACE, flags, 2, MPI_INT, MPI_LOR, comm());
  any_remote_ = flags[0] != 0;  // not after distribute()
  any_mixed_ = flags[1] != 0;
}

// Multipliers are where the next step starts from.
void PrimalDual::visit(StateVisitor& visitor) {
  visitor.visit("x", Belongs::state, x_.get());
  levels_.visit(visitor);
  const WriteArray u(u_.get());
  const ReadArray x(x_.get());
  std::copy_n(x.data(), local_x_, u.data());
  double* nu = u.data() + local_x_;
  levels_.visit_outputs(visitor, "nu", {nu, levels_.z.size()});
  std::vector<double> above(levels_.constraints(), 0.0);
  for (std::size_t k = 0; k < upper_walls_.size(); ++k)
    above[upper_walls_[k]] = nu[upper_at(k)];
  visitor.visit("nu above", Belongs::constraint, above);
  for (std::size_t k = 0; k < upper_walls_.size(); ++k)
    nu[upper_at(k)] = above[upper_walls_[k]];
}

}  // namespace sweepvi
