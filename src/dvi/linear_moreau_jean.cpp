#include "dvi/linear_moreau_jean.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "dvi/empty_polyhedron.hpp"
#include "dvi/form_option.hpp"
#include "dvi/stacked.hpp"
#include "petsc/sparse.hpp"

namespace sweepvi {

namespace {

constexpr double cancelled = 0.01;  // times `inherited`: 1e-13 of a velocity passes the certificate
constexpr double inherited = 0.1;   // of the terms of the velocities that a constraint reads

void absolute_values(Vec from, Vec to) {
  check(VecCopy(from, to));
  check(VecAbs(to));
}

Matrix squares(Mat matrix) {
  RowBuilder rows;
  for_each_row(matrix, [&](PetscInt, auto columns, auto values) {
    for (std::size_t k = 0; k < columns.size(); ++k)
      rows.add(columns[k], values[k] * values[k]);
    rows.end_row();
  });
  return rows.finish(PetscObjectComm(reinterpret_cast<PetscObject>(matrix)), column_range(matrix).size());
}

std::vector<double> product(Mat matrix, Vec x) {
  Vector y;
  check(MatCreateVecs(matrix, nullptr, y.put()));
  check(MatMult(matrix, x, y.get()));
  const ReadArray values(y.get());
  return {values.data(), values.data() + values.size()};
}

double local_dot(Vec a, Vec b) {
  const ReadArray x(a);
  const ReadArray y(b);
  double sum = 0.0;
  for (PetscInt i = 0; i < x.size(); ++i)
    sum += x[i] * y[i];
  return sum;
}

}  // namespace

LinearMoreauJean::LinearMoreauJean(const LagrangianSystem& system, const MoreauJeanOptions& options, double h,
                                   bool dual)
    : MoreauJean(system.comm(), options, h, system.q0.get(), system.v0.get()), system_(system), dual_(dual) {
  for (Vector* vector : {&scale_, &forces_, &theta_forces_, &part_, &abs_})
    *vector = duplicate(q_.get());
  assemble();
  if (system.C) damping_ = AffineRows(system.C.get());
  varying_ = VaryingForces(system.f, local_);
  first_row_ = row_range(matrix_.get()).first;
  if (!dual) {
    blocks_ = small_blocks(system.block, system.coordinates());
    block_rows_ = BlockRows(rows_, blocks_);
  }
  if (dual)
    check(MatCreateVecs(matrix_.get(), u_.put(), nullptr));
  else
    u_ = Vector::share(v_.get());
  for (Vector* vector : {&rhs_, &rhs_terms_, &work_, &terms_, &known_})
    *vector = duplicate(u_.get());
  if (dual) {
    const ReadArray v(v_.get());
    const WriteArray u(u_.get());
    std::fill_n(u.data(), u.size(), 0.0);
    std::copy_n(v.data(), v.size(), u.data());
  }
  contacts_.start(gaps_at_positions(), product(system.H.get(), v_.get()), system.e.get());
  if (!dual) box_.start(system.H.get(), system.g0.get());
  look_at_contacts(true);

  for (const Forcing::Entry& entry : system.f.constant) {
    const WriteArray forces(forces_.get());
    forces[entry.local] += entry.signal.value(0.0);
  }
  const Matrix twist = add(system.K.get(), -1.0, transpose(system.K.get()).get());
  double largest[2] = {0.0, 0.0};
  check(MatNorm(twist.get(), NORM_INFINITY, &largest[0]));
  check(MatNorm(system.K.get(), NORM_INFINITY, &largest[1]));
  if (largest[0] <= rounding * largest[1]) return;
  circulatory_ = Matrix::share(twist.get());
  check(MatScale(circulatory_.get(), 0.5));
}

// H q + g0.
std::vector<double> LinearMoreauJean::gaps_at_positions() const {
  std::vector<double> gaps = product(system_.H.get(), q_.get());
  const ReadArray offset(system_.g0.get());
  for (std::size_t a = 0; a < gaps.size(); ++a)
    gaps[a] += offset[static_cast<PetscInt>(a)];
  return gaps;
}

void LinearMoreauJean::assemble() {
  make_scales();
  const double rest = 1.0 - theta_;
  const Matrix J = scaled(1.0, h_ * theta_, h_ * h_ * theta_ * theta_);
  matrix_ = dual_ ? saddle(J.get()) : Matrix::share(J.get());
  rows_ = AffineRows(matrix_.get());
  if (!blocks_.empty()) block_rows_ = BlockRows(rows_, blocks_);
  if (dual_) {
    abs_matrix_ = absolute_copy(matrix_.get());
    ++rows_version_;
    level_of_unknown_.assign(static_cast<std::size_t>(local_), 0);
    level_of_unknown_.resize(static_cast<std::size_t>(rows_.size()), 1);
  }
  of_v_ = AffineRows(scaled(1.0, -h_ * rest, -h_ * h_ * theta_ * rest).get());
  of_q_ = AffineRows(scaled({}, {}, -h_).get());
}

bool LinearMoreauJean::set_step(double h) {
  h_ = h;
  assemble();
  ++version_;
  return true;
}

// d_j = M_jj + h theta |C_jj| + h^2 theta^2 |K_jj|, and delta = diag(H d^-1 H').
void LinearMoreauJean::make_scales() {
  const auto add_diagonal = [&](Mat matrix, double factor) {
    if (matrix == nullptr) return;
    const LocalRange range = row_range(matrix);
    const WriteArray d(scale_.get());
    for_each_row(matrix, [&](PetscInt row, auto columns, auto values) {
      for (std::size_t k = 0; k < columns.size(); ++k)
        if (columns[k] == row) d[row - range.first] += factor * std::abs(values[k]);
    });
  };
  check(VecSet(scale_.get(), 0.0));
  add_diagonal(system_.M.get(), 1.0);
  add_diagonal(system_.C.get(), h_ * theta_);
  add_diagonal(system_.K.get(), h_ * h_ * theta_ * theta_);
  check(VecReciprocal(scale_.get()));
  if (dual_) delta_ = product(squares(system_.H.get()).get(), scale_.get());
}

// d^-1 (m M + c C + k K); a factor of 0 keeps its matrix in the pattern.
Matrix LinearMoreauJean::scaled(std::optional<double> m, std::optional<double> c,
                                std::optional<double> k) const {
  RowBuilder rows;
  const ReadArray scale(scale_.get());
  const LocalRange range = row_range(system_.M.get());
  for (PetscInt row = range.first; row < range.last; ++row) {
    const double s = scale[row - range.first];
    if (m) rows.add(get_row(system_.M.get(), row), *m * s);
    if (c && system_.C) rows.add(get_row(system_.C.get(), row), *c * s);
    if (k) rows.add(get_row(system_.K.get(), row), *k * s);
    rows.end_row();
  }
  return rows.finish(comm(), local_);
}

// [J  -d^-1 H' delta^-1; H  0]
Matrix LinearMoreauJean::saddle(Mat J) {
  check(MatCreateVecs(system_.H.get(), nullptr, nu_.put()));
  abs_nu_ = duplicate(nu_.get());
  {
    const WriteArray values(nu_.get());
    for (std::size_t a = 0; a < delta_.size(); ++a)
      values[static_cast<PetscInt>(a)] = 1.0 / delta_[a];
  }
  pushes_ = transpose(system_.H.get());
  check(MatDiagonalScale(pushes_.get(), scale_.get(), nu_.get()));
  abs_pushes_ = absolute_copy(pushes_.get());
  const Stacked number(J, nu_.get());
  const LocalRange coordinates = row_range(J);
  const LocalRange constraints = row_range(system_.H.get());
  RowBuilder rows;
  for (PetscInt j = coordinates.first; j < coordinates.last; ++j) {
    for (const auto& [column, value] : get_row(J, j))
      rows.add(number.x(column), value);
    for (const auto& [column, value] : get_row(pushes_.get(), j))
      rows.add(number.nu(column), -value);
    rows.end_row();
  }
  for (PetscInt a = constraints.first; a < constraints.last; ++a) {
    for (const auto& [column, value] : get_row(system_.H.get(), a))
      rows.add(number.x(column), value);
    rows.add(number.nu(a), 0.0);  // room for the row nu = 0 where a is not detected
    rows.end_row();
  }
  return rows.finish(comm(), coordinates.size() + constraints.size());
}

Matrix LinearMoreauJean::create_jacobian() const {
  Matrix jacobian;
  check(MatDuplicate(matrix_.get(), MAT_COPY_VALUES, jacobian.put()));
  check(MatSetOption(jacobian.get(), MAT_KEEP_NONZERO_PATTERN, PETSC_TRUE));
  return jacobian;
}

// theta f(t_{k+1}) + (1 - theta) f(t_k) of forces that vary.
void LinearMoreauJean::find_theta_forces(const Step& step) {
  const WriteArray values(theta_forces_.get());
  varying_.find(values.data(), step.t_new, theta_, step.t_old, 1.0 - theta_);
}

void LinearMoreauJean::find_rhs(const Step& step) {
  if (system_.f.varies) find_theta_forces(step);
  {
    const ReadArray constant(forces_.get());
    const ReadArray varying(theta_forces_.get());
    const ReadArray scale(scale_.get());
    const WriteArray rhs(rhs_.get());
    const WriteArray terms(rhs_terms_.get());
    for (PetscInt j = 0; j < local_; ++j) {
      const double weight = h_ * scale[j];
      rhs[j] = weight * (constant[j] + varying[j]);
      terms[j] = weight * (std::abs(constant[j]) + std::abs(varying[j]));
    }
    std::fill(rhs.data() + local_, rhs.data() + rhs.size(), 0.0);
    std::fill(terms.data() + local_, terms.data() + terms.size(), 0.0);
  }
  of_v_.add_product(v_.get(), rhs_.get(), rhs_terms_.get());
  of_q_.add_product(q_.get(), rhs_.get(), rhs_terms_.get());
}

void LinearMoreauJean::begin(const Step& step, Vec lower, Vec upper, Vec guess) {
  step_ = step.number;
  find_rhs(step);
  check(VecCopy(u_.get(), guess));
  if (!dual_) {
    box_.begin(lower, upper, h_, detection_);
    return;
  }
  const std::vector<int> last = contacts_.level;
  contacts_.detect(reach_of(detection_) * h_, detection_);
  if (contacts_.level != last) ++version_;
  check(VecNorm(v_.get(), NORM_INFINITY, &fastest_));
  bound_multipliers(lower, upper, guess);
  find_constraint_rhs();
}

void LinearMoreauJean::bound_multipliers(Vec lower, Vec upper, Vec guess) {
  check(VecSet(lower, PETSC_NINFINITY));
  check(VecSet(upper, PETSC_INFINITY));
  const WriteArray l(lower);
  const WriteArray start(guess);
  pinned_.resize(contacts_.size());
  for (std::size_t a = 0; a < contacts_.size(); ++a) {
    pinned_[a] = pinned(a) ? 1 : 0;
    if (pinned(a))
      start[row(a)] = 0.0;
    else
      l[row(a)] = 0.0;
  }
}

// H v_k by the matrix that gives H v: where v = v_k, their difference is 0 to the bit.
void LinearMoreauJean::find_constraint_rhs() {
  check(VecCopy(u_.get(), terms_.get()));
  {
    const WriteArray old(terms_.get());
    std::fill(old.data() + local_, old.data() + old.size(), 0.0);
  }
  check(MatMult(matrix_.get(), terms_.get(), work_.get()));
  check(VecAbs(terms_.get()));
  {
    const ReadArray old(work_.get());
    const WriteArray rhs(rhs_.get());
    for (std::size_t a = 0; a < contacts_.size(); ++a) {
      if (contacts_.contact[a] == 0) contacts_.velocity[a] = old[row(a)];
      rhs[row(a)] = old[row(a)] - (contacts_.velocity[a] - contacts_.rebound(a));
    }
  }
  check(MatMult(abs_matrix_.get(), terms_.get(), work_.get()));
  const ReadArray old(work_.get());
  const WriteArray terms(rhs_terms_.get());
  for (std::size_t a = 0; a < contacts_.size(); ++a)
    terms[row(a)] = old[row(a)] + std::abs(contacts_.velocity[a]) + std::abs(contacts_.rebound(a));
}

// F before rows are pinned: on those of constraints H v_{k+1} + e H v_k, whether detected or not.
void LinearMoreauJean::evaluate(Vec u, Vec f) {
  rows_.residual(u, rhs_.get(), f);
}

void LinearMoreauJean::residual(Vec u, Vec f) {
  evaluate(u, f);
  if (!dual_) return;
  const ReadArray values(u);
  const WriteArray result(f);
  for (std::size_t a = 0; a < contacts_.size(); ++a)
    if (pinned(a)) result[row(a)] = values[row(a)];
}

// In contact H v is zero in exact arithmetic, while v itself is known up to the terms of its own row: of
// those a tenth counts as the constraint's, too. But not what impulses cancel among themselves, which can be
// any amount more: a light ball under a heavy one, or constraints that contradict each other. Of that only
// their rounding, as far as it goes with the velocities that came in: in a stack that is hit, nothing else is
// left.
void LinearMoreauJean::row_terms(Vec u, Vec terms) {
  if (!dual_) {
    rows_.terms(u, rhs_terms_.get(), terms);
    return;
  }
  absolute_values(u, work_.get());
  take_pushes(work_.get(), abs_nu_.get());
  check(MatMultAdd(abs_matrix_.get(), work_.get(), rhs_terms_.get(), terms));
  check(VecCopy(u, work_.get()));
  take_pushes(work_.get(), nu_.get());
  check(MatMult(pushes_.get(), nu_.get(), part_.get()));
  check(MatMult(abs_pushes_.get(), abs_nu_.get(), abs_.get()));
  {
    const ReadArray known(terms);
    const ReadArray net(part_.get());
    const ReadArray pushed(abs_.get());
    const WriteArray read(work_.get());
    std::fill(read.data(), read.data() + read.size(), 0.0);
    for (PetscInt j = 0; j < local_; ++j)
      read[j] = known[j] + std::abs(net[j]) + cancelled * std::min(pushed[j], fastest_);
  }
  check(MatMult(abs_matrix_.get(), work_.get(), terms_.get()));
  const ReadArray spread(terms_.get());
  const ReadArray pushed(abs_.get());
  const ReadArray values(u);
  const WriteArray result(terms);
  for (PetscInt j = 0; j < local_; ++j)
    result[j] += pushed[j];
  for (std::size_t a = 0; a < contacts_.size(); ++a) {
    if (pinned(a))
      result[row(a)] = std::abs(values[row(a)]);
    else
      result[row(a)] += inherited * spread[row(a)];
  }
}

// Moves the multipliers of u into a vector of their own.
void LinearMoreauJean::take_pushes(Vec u, Vec nu) const {
  const WriteArray values(u);
  const WriteArray multipliers(nu);
  for (PetscInt a = 0; a < multipliers.size(); ++a)
    multipliers[a] = std::exchange(values[local_ + a], 0.0);
}

void LinearMoreauJean::jacobian(Vec, Mat jacobian) {
  check(MatCopy(matrix_.get(), jacobian, SAME_NONZERO_PATTERN));
  if (!dual_) return;
  std::vector<PetscInt> rows;
  for (std::size_t a = 0; a < contacts_.size(); ++a)
    if (pinned(a)) rows.push_back(first_row_ + row(a));
  check(MatZeroRows(jacobian, static_cast<PetscInt>(rows.size()), rows.data(), 1.0, nullptr, nullptr));
}

void LinearMoreauJean::residual_and_terms(Vec u, Vec f, Vec terms) {
  if (dual_) {
    Dvi::residual_and_terms(u, f, terms);
  } else {
    rows_.evaluate(u, rhs_.get(), rhs_terms_.get(), f, terms);
  }
}

void LinearMoreauJean::settle(Vec u) {
  row_terms(u, known_.get());
  if (!dual_) {
    box_.settle(u, known_.get());
    return;
  }
  evaluate(u, work_.get());
  put_held(u, known_.get());
}

RowRatios LinearMoreauJean::settle_and_judge(Vec u, Vec lower, Vec upper, Vec f, Vec terms) {
  if (dual_) return Dvi::settle_and_judge(u, lower, upper, f, terms);
  const auto judge = [&] {
    return block_rows_.judge(u, lower, upper, rhs_.get(), rhs_terms_.get(), f, terms);
  };
  const RowRatios rows = judge();
  int moved = box_.settle(u, terms) ? 1 : 0;
  MPI_Allreduce(MPI_IN_PLACE, &moved, 1, MPI_INT, MPI_LOR, comm());
  return moved != 0 ? judge() : rows;
}

// Primal-dual: by the terms of each row, and F before rows are pinned, which is in work_.
void LinearMoreauJean::put_held(Vec u, Vec terms) {
  const ReadArray scale(terms);
  const WriteArray values(u);
  const ReadArray f(work_.get());
  for (std::size_t a = 0; a < contacts_.size(); ++a) {
    const PetscInt i = row(a);
    const bool open = f[i] > values[i] && f[i] > held_rtol * scale[i];
    if (pinned(a) || values[i] < 0.0 || open) values[i] = 0.0;
  }
}

// M is positive definite: what can go wrong is that no velocity suits all constraints that are closed.
std::string LinearMoreauJean::diagnosis() {
  const LocalRange constraints = row_range(system_.H.get());
  RowBuilder rows;
  std::vector<PetscInt> numbers;
  std::vector<double> bounds;
  for (std::size_t a = 0; a < contacts_.size(); ++a) {
    if (!contacts_.detected(a)) continue;
    rows.add(get_row(system_.H.get(), constraints.first + static_cast<PetscInt>(a)));
    rows.end_row();
    numbers.push_back(system_.constraint_order[a]);
    bounds.push_back(contacts_.rebound(a));
  }
  const Matrix closed = rows.finish(comm(), local_);
  const Vector least = make_vector(comm(), static_cast<PetscInt>(bounds.size()));
  {
    const WriteArray values(least.get());
    std::copy(bounds.begin(), bounds.end(), values.data());
  }
  const Vector terms = duplicate(least.get());
  check(VecCopy(least.get(), terms.get()));
  check(VecAbs(terms.get()));
  const auto contradiction = find_contradiction(closed.get(), least.get(), terms.get(), v_.get(), numbers);
  if (!contradiction) return {};
  return fmt::format("Constraints {} contradict each other: no velocity has H v+ >= -e H v- in all of them",
                     fmt::join(contradiction->faces, ", "));
}

void LinearMoreauJean::accept(Vec u, Vec f) {
  find_increment(u);
  if (dual_) {
    row_terms(u, known_.get());
    evaluate(u, work_.get());  // F before rows are pinned
    take_multipliers(u, work_.get());
  }
  account(u);
  move();
  if (dual_)
    find_gaps();
  else
    box_.take(u, f, q_.get(), scale_.get(), h_, theta_, lost_);
  take_velocity(u);
  look_at_contacts();
}

// Primal-dual: of open constraints, from the positions. A product with H costs much of a step: now and then
// will do, as between a gap gathers no more than the rounding of a few sums.
void LinearMoreauJean::find_gaps() {
  constexpr PetscInt carried_for = 16;
  if (step_ % carried_for != 0) return;
  const std::vector<double> gaps = gaps_at_positions();
  for (std::size_t a = 0; a < gaps.size(); ++a)
    if (contacts_.contact[a] == 0) contacts_.gap[a] = gaps[a];
  contacts_.deepest.reset();
}

// Primal-dual: impulses are unknowns. @param f  before rows are pinned
void LinearMoreauJean::take_multipliers(Vec u, Vec f) {
  const ReadArray terms(known_.get());
  const ReadArray residual(f);
  const ReadArray values(u);
  for (std::size_t a = 0; a < contacts_.size(); ++a) {
    const PetscInt i = row(a);
    const bool holds =
        contacts_.detected(a) && (residual[i] < values[i] || std::abs(residual[i]) <= held_rtol * terms[i]);
    const double rebound = contacts_.rebound(a);
    move_contact(a, holds, holds ? values[i] / delta_[a] : 0.0, holds ? rebound : rebound + residual[i]);
  }
}

// What a step loses and gains besides impacts. With x_theta = mean + (theta - 1/2) dx, the product of the
// step's equation with dq = h v_theta is the energy balance.
void LinearMoreauJean::account(Vec u) {
  const auto form = [this](Mat matrix, const Vector& x, const Vector& y) {
    check(MatMult(matrix, y.get(), part_.get()));
    return local_dot(x.get(), part_.get());
  };
  if (system_.C) {
    const double* const others = damping_.ghosts(dq_.get());
    const ReadArray dq(dq_.get());
    double sum = 0.0;
    damping_.each_row(dq.data(), others,
                      [&](PetscInt j, const AffineRows::Row& pull) { sum += dq[j] * pull.sum; });
    lost_.damping += sum / h_;
  }
  if (system_.f.varies) lost_.work += local_dot(dq_.get(), theta_forces_.get());
  if (circulatory_) {
    check(VecWAXPY(abs_.get(), 0.5, dq_.get(), q_.get()));
    lost_.work -= form(circulatory_.get(), dq_, abs_);
  }
  if (theta_ == 0.5) return;
  {
    const ReadArray v_new(u);
    const ReadArray v_old(v_.get());
    const WriteArray dv(abs_.get());
    for (PetscInt j = 0; j < local_; ++j)
      dv[j] = v_new[j] - v_old[j];
  }
  lost_.scheme += (theta_ - 0.5) * (form(system_.M.get(), abs_, abs_) + form(system_.K.get(), dq_, dq_));
}

Energy LinearMoreauJean::energy() {
  const auto half_form = [this](Mat matrix, const Vector& x) {
    check(MatMult(matrix, x.get(), part_.get()));
    return 0.5 * local_dot(x.get(), part_.get());
  };
  Energy sum = lost_;
  sum.kinetic = half_form(system_.M.get(), v_);
  sum.potential = half_form(system_.K.get(), q_) - local_dot(forces_.get(), q_.get());
  return summed(comm(), sum);
}

void LinearMoreauJean::visit(StateVisitor& visitor) {
  MoreauJean::visit(visitor);
  if (!visitor.replaces()) return;
  ++version_;  // what is pinned is told by the levels of the contacts
  box_.forget();
}

std::string against_box_on_v(const LagrangianSystem& system) {
  const LocalRange coordinates = row_range(system.M.get());
  std::vector<char> taken(static_cast<std::size_t>(coordinates.size()), 0);
  int obstacle = 0;
  for_each_row(system.H.get(), [&](PetscInt, auto columns, auto values) {
    int count = 0;
    for (std::size_t k = 0; k < columns.size(); ++k) {
      if (values[k] == 0.0) continue;
      if (!coordinates.contains(columns[k])) {
        obstacle = std::max(obstacle, 1);
      } else if (++count > 1 ||
                 std::exchange(taken[static_cast<std::size_t>(columns[k] - coordinates.first)], 1)) {
        obstacle = 2;
      }
    }
  });
  MPI_Allreduce(MPI_IN_PLACE, &obstacle, 1, MPI_INT, MPI_MAX, system.comm());
  if (obstacle == 0) return "";
  return obstacle == 1 ? "a constraint and the coordinate it reads are on different ranks"
                       : "a constraint reads several coordinates, or two constraints the same one";
}

std::unique_ptr<MechanicalDvi> make_moreau_jean(const LagrangianSystem& system,
                                                const MoreauJeanOptions& options, const TimeGrid& grid) {
  const std::string asked = asked_form(system.comm());
  const std::string obstacle = against_box_on_v(system);
  if (asked != "auto" && asked != "box-on-v" && asked != "primal-dual")
    throw InputError("-sweepvi_form is '" + asked + "'; moreau-jean takes auto, box-on-v or primal-dual");
  if (asked == "box-on-v" && !obstacle.empty())
    throw InputError("-sweepvi_form box-on-v does not fit: " + obstacle + "; use primal-dual");
  const bool dual = asked == "primal-dual" || !obstacle.empty();
  return std::make_unique<LinearMoreauJean>(system, options, grid.h(), dual);
}

}  // namespace sweepvi
