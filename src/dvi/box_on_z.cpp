#include "dvi/box_on_z.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "dvi/residue.hpp"
#include "petsc/sparse.hpp"

namespace sweepvi {

BoxOnZ::BoxOnZ(const LinearSystem& system, const RelativeDegree& relative_degree, double t_start, double h,
               double theta)
    : OutputBox(system.comm(), h),
      system_(system),
      relative_degree_(relative_degree),
      forcing_(system, relative_degree),
      coordinates_(system, relative_degree),
      theta_(theta) {
  levels_.allocate(relative_degree.degree, relative_degree.highest, system.wmax.get());
  two_sided_ = static_cast<bool>(system.wmax);
  set_places(coordinates_.positions());
  for (Vector* vector : {&u_, &x_, &g_old_, &g_, &c_, &rhs_, &rhs_terms_, &work_})
    *vector = duplicate(system.x0.get());
  check(MatCreateVecs(relative_degree.Z.get(), nullptr, g_outputs_.put()));
  for (Vector* vector : {&g_outputs_old_, &defect_})
    *vector = duplicate(g_outputs_.get());

  check(VecSet(c_.get(), 0.0));
  make_rates();
  jumps_ = coordinates_.jumps();
  if (jumps_) {
    inverse_jumps_ = coordinates_.inverse_jumps(jumps_.get());
    jump_rows_ = AffineRows(jumps_.get());
    inverse_rows_ = AffineRows(inverse_jumps_.get());
    mapped_terms_ = duplicate(u_.get());
    K_ = multiply_clean(inverse_jumps_.get(), plain_K_.get());
  } else {
    K_ = Matrix::share(plain_K_.get());
  }
  rows_ = AffineRows(K_.get());
  blocks_ = small_blocks(system.block, system.states());
  block_rows_ = BlockRows(rows_, blocks_);

  // u_0 = W x_0 + g(t_0)
  place_forcing(t_start, g_.get());
  g_time_ = t_start;
  coordinates_.to_u(system.x0.get(), u_.get());
  check(VecAXPY(u_.get(), 1.0, g_.get()));
  check(VecCopy(system.x0.get(), x_.get()));
  start_from(u_.get());
}

// What depends on h_ and theta_ alone.
void BoxOnZ::make_rates() {
  Matrix R = coordinates_.companion();
  plain_K_ = implicit_euler(R.get(), h_ * theta_);
  plain_rows_ = AffineRows(plain_K_.get());
  if (theta_ == 1.0) return;
  check(MatScale(R.get(), h_ * (1.0 - theta_)));
  old_rates_ = AffineRows(R.get());
}

bool BoxOnZ::set_step(double h) {
  const double before = std::exchange(h_, h);
  make_rates();
  const Matrix K =
      jumps_ ? multiply_clean(inverse_jumps_.get(), plain_K_.get()) : Matrix::share(plain_K_.get());
  if (!replace_values(K_.get(), K.get())) {
    h_ = before;
    make_rates();
    return false;
  }
  rows_ = AffineRows(K_.get());
  block_rows_ = BlockRows(rows_, blocks_);
  reading_.reset();
  has_c_ = false;
  ++version_;
  return true;
}

void BoxOnZ::place_forcing(double t, Vec g_x) {
  forcing_.evaluate(t, g_outputs_.get());
  check(VecSet(g_x, 0.0));
  const ReadArray g(g_outputs_.get());
  const WriteArray values(g_x);
  for (std::size_t q = 0; q < levels_.z.size(); ++q)
    values[places_[q]] = g[static_cast<PetscInt>(q)];
}

Matrix BoxOnZ::create_jacobian() const {
  Matrix jacobian;
  check(MatDuplicate(K_.get(), MAT_COPY_VALUES, jacobian.put()));
  return jacobian;
}

// c = (I - h theta R) g_{k+1} - (I + h (1-theta) R) g_k + W phi, where phi is h f_theta, completed so that
// c = 0 below level r.
void BoxOnZ::find_c(const Step& step) {
  if (has_c_ && !forcing_.varies()) return;
  has_c_ = true;
  if (forcing_.vanishes()) {  // so do g and the completion
    const bool plain = coordinates_.plain();
    Vec forces = plain ? c_.get() : work_.get();
    if (plain)
      system_.f.clear(forces);  // all other rows are 0 for good
    else
      check(VecSet(forces, 0.0));
    system_.f.add_to(forces, step.t_new, 0, step.h * theta_);
    if (theta_ != 1.0) system_.f.add_to(forces, step.t_old, 0, step.h * (1.0 - theta_));
    if (!plain) coordinates_.to_u(forces, c_.get());
    return;
  }
  std::swap(g_, g_old_);
  std::swap(g_outputs_, g_outputs_old_);
  if (g_time_ != step.t_old) {
    place_forcing(step.t_old, g_old_.get());
    check(VecCopy(g_outputs_.get(), g_outputs_old_.get()));
  }
  place_forcing(step.t_new, g_.get());
  g_time_ = step.t_new;
  check(VecSet(work_.get(), 0.0));
  system_.f.add_to(work_.get(), step.t_new, 0, step.h * theta_);
  if (theta_ != 1.0) system_.f.add_to(work_.get(), step.t_old, 0, step.h * (1.0 - theta_));
  coordinates_.to_u(work_.get(), c_.get());
  plain_rows_.add_to(g_.get(), c_.get());
  check(VecAXPY(c_.get(), -1.0, g_old_.get()));
  if (theta_ != 1.0) {
    old_rates_.multiply(g_old_.get(), work_.get());
    check(VecAXPY(c_.get(), -1.0, work_.get()));
  }
  if (jumps_ && forcing_.varies() && relative_degree_.highest > 2) add_completion(step);
  const WriteArray c(c_.get());
  for (std::size_t a = 0; a < levels_.constraints(); ++a)
    for (int i = 1; i < levels_.levels(a); ++i)
      c[place(a, i)] = 0.0;
}

// What the completion along d_{a,i}, i < r, does to levels r of other constraints and to other states.
void BoxOnZ::add_completion(const Step& step) {
  forcing_.increment_defect(step, theta_, g_outputs_old_.get(), g_outputs_.get(), defect_.get());
  const auto keep_lower_levels = [this](Vec values) {
    const WriteArray entries(values);
    for (PetscInt place = 0; place < entries.size(); ++place)
      if (coordinates_.output_at(place) < 0) entries[place] = 0.0;
    for (std::size_t a = 0; a < levels_.constraints(); ++a)
      entries[place(a, levels_.levels(a))] = 0.0;
  };
  {
    const ReadArray defect(defect_.get());
    const WriteArray placed(work_.get());
    std::fill_n(placed.data(), placed.size(), 0.0);
    for (std::size_t q = 0; q < levels_.z.size(); ++q)
      placed[places_[q]] = defect[static_cast<PetscInt>(q)];
  }
  inverse_rows_.multiply(work_.get(), rhs_.get());
  keep_lower_levels(rhs_.get());
  jump_rows_.add_to(rhs_.get(), c_.get());
}

void BoxOnZ::begin(const Step& step, Vec lower, Vec upper, Vec guess) {
  begin_levels(lower, upper);
  find_c(step);
  {
    const ReadArray u(u_.get());
    const ReadArray c(c_.get());
    const WriteArray rhs(rhs_.get());
    const WriteArray terms(rhs_terms_.get());
    const WriteArray start(guess);
    for (PetscInt i = 0; i < u.size(); ++i) {
      start[i] = u[i];
      rhs[i] = u[i] + c[i];
      terms[i] = std::abs(u[i]) + std::abs(c[i]);
    }
  }
  if (theta_ != 1.0) old_rates_.add_product(u_.get(), rhs_.get(), rhs_terms_.get());
  if (jumps_) {
    inverse_rows_.map(rhs_.get(), rhs_terms_.get(), work_.get(), mapped_terms_.get());
    std::swap(rhs_, work_);
    std::swap(rhs_terms_, mapped_terms_);
  }
}

void BoxOnZ::residual(Vec u, Vec f) {
  rows_.residual(u, rhs_.get(), f);
}

void BoxOnZ::row_terms(Vec u, Vec terms) {
  rows_.terms(u, rhs_terms_.get(), terms);
}

void BoxOnZ::residual_and_terms(Vec u, Vec f, Vec terms) {
  rows_.evaluate(u, rhs_.get(), rhs_terms_.get(), f, terms);
}

RowRatios BoxOnZ::settle_and_judge(Vec u, Vec lower, Vec upper, Vec f, Vec terms) {
  const auto judge = [&] {
    return block_rows_.small() ? block_rows_.judge(u, lower, upper, rhs_.get(), rhs_terms_.get(), f, terms)
                               : rows_.judge(u, lower, upper, rhs_.get(), rhs_terms_.get(), f, terms);
  };
  const RowRatios rows = judge();
  int moved = put_held(u, terms) ? 1 : 0;
  MPI_Allreduce(MPI_IN_PLACE, &moved, 1, MPI_INT, MPI_LOR, comm());
  return moved != 0 ? judge() : rows;
}

bool BoxOnZ::spread_terms(Vec terms) {
  if (!reading_) reading_ = absolute_up_to(K_.get(), 1.0);
  check(MatMult(reading_.get(), terms, work_.get()));
  check(VecCopy(work_.get(), terms));
  return true;
}

void BoxOnZ::jacobian(Vec, Mat jacobian) {
  check(MatCopy(K_.get(), jacobian, SAME_NONZERO_PATTERN));
}

void BoxOnZ::accept(Vec u, Vec f) {
  take(u, f, relative_degree_.markov_diagonal);
  if (!forcing_.vanishes()) check(VecWAXPY(work_.get(), -1.0, g_.get(), u));
  coordinates_.to_x(forcing_.vanishes() ? u : work_.get(), x_.get());
}

// Other states are the same in u and in x, to the bit; outputs stand in u as they do in the levels.
void BoxOnZ::visit(StateVisitor& visitor) {
  visitor.visit("x", Belongs::state, x_.get());
  levels_.visit(visitor);
  if (!visitor.replaces()) return;
  check(VecCopy(x_.get(), u_.get()));
  const WriteArray u(u_.get());
  for (std::size_t q = 0; q < levels_.z.size(); ++q)
    u[places_[q]] = levels_.z[q];
}

}  // namespace sweepvi
