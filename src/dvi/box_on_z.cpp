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
  for (Vector* vector : {&u_, &x_, &c_, &rhs_, &rhs_terms_, &work_})
    *vector = duplicate(system.x0.get());
  jumps_ = coordinates_.jumps();
  if (jumps_) {
    inverse_jumps_ = coordinates_.inverse_jumps(jumps_.get());
    inverse_rows_ = AffineRows(inverse_jumps_.get());
    mapped_terms_ = duplicate(u_.get());
  }
  K_ = make_rates();
  rows_ = AffineRows(K_.get());
  blocks_ = small_blocks(system.block, system.states());
  block_rows_ = BlockRows(rows_, blocks_);

  // u_0 = W x_0 + g(t_0)
  coordinates_.to_u(system.x0.get(), u_.get());
  if (!forcing_.vanishes()) {
    find_g(t_start, work_.get());
    check(VecAXPY(u_.get(), 1.0, work_.get()));
  }
  check(VecCopy(system.x0.get(), x_.get()));
  start_from(u_.get());
}

// What depends on h_ and theta_ alone. Returns K.
Matrix BoxOnZ::make_rates() {
  Matrix R = coordinates_.companion();
  increment_ = ForcedIncrement(system_, relative_degree_, coordinates_, forcing_.vanishes(), R.get(),
                               jumps_.get(), inverse_jumps_.get(), h_, theta_);
  Matrix K = implicit_euler(R.get(), h_ * theta_);
  if (jumps_) K = multiply_clean(inverse_jumps_.get(), K.get());
  if (theta_ == 1.0) return K;
  check(MatScale(R.get(), h_ * (1.0 - theta_)));
  old_rates_ = AffineRows(R.get());
  return K;
}

bool BoxOnZ::set_step(double h) {
  const double before = std::exchange(h_, h);
  const Matrix K = make_rates();
  if (!replace_values(K_.get(), K.get())) {
    h_ = before;
    static_cast<void>(make_rates());
    return false;
  }
  rows_ = AffineRows(K_.get());
  block_rows_ = BlockRows(rows_, blocks_);
  reading_.reset();
  ++version_;
  return true;
}

// g(t) in the layout of x, of which other rows are left alone: 0.
void BoxOnZ::find_g(double t, Vec g) const {
  if (!g_outputs_) check(MatCreateVecs(relative_degree_.Z.get(), nullptr, g_outputs_.put()));
  forcing_.evaluate(t, g_outputs_.get());
  check(VecSet(g, 0.0));
  const ReadArray outputs(g_outputs_.get());
  const WriteArray values(g);
  for (std::size_t q = 0; q < levels_.z.size(); ++q)
    values[places_[q]] = outputs[static_cast<PetscInt>(q)];
}

Matrix BoxOnZ::create_jacobian() const {
  Matrix jacobian;
  check(MatDuplicate(K_.get(), MAT_COPY_VALUES, jacobian.put()));
  return jacobian;
}

void BoxOnZ::begin(const Step& step, Vec lower, Vec upper, Vec guess) {
  begin_levels(lower, upper);
  increment_.find(step, c_.get());
  t_new_ = step.t_new;
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
    return block_rows_.judge(u, lower, upper, rhs_.get(), rhs_terms_.get(), f, terms);
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
  knows_x_ = false;
  t_ = t_new_;
}

// x = W^{-1} (u - g), when somebody asks.
Vec BoxOnZ::x() const {
  if (!std::exchange(knows_x_, true)) {
    if (!forcing_.vanishes()) {
      find_g(t_, work_.get());
      check(VecAYPX(work_.get(), -1.0, u_.get()));
    }
    coordinates_.to_x(forcing_.vanishes() ? u_.get() : work_.get(), x_.get());
  }
  return x_.get();
}

// Other states are the same in u and in x, to the bit; outputs stand in u as they do in the levels.
void BoxOnZ::visit(StateVisitor& visitor) {
  visitor.visit("x", Belongs::state, x());
  levels_.visit(visitor);
  if (!visitor.replaces()) return;
  check(VecCopy(x_.get(), u_.get()));
  const WriteArray u(u_.get());
  for (std::size_t q = 0; q < levels_.z.size(); ++q)
    u[places_[q]] = levels_.z[q];
}

}  // namespace sweepvi
