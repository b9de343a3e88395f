#include "dvi/nonlinear_moreau_jean.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "petsc/sparse.hpp"

namespace sweepvi {

namespace {

constexpr double inherited = 0.1;  // of the terms of the velocities that a constraint reads

std::vector<double> values_of(Vec vector) {
  const ReadArray values(vector);
  return {values.data(), values.data() + values.size()};
}

Vector restitution_of(const NonlinearLagrangian& system, MPI_Comm comm, PetscInt constraints) {
  const std::vector<double> e = system.restitution();
  agreed(comm, [&] {
    if (static_cast<PetscInt>(e.size()) != constraints)
      throw InputError(
          fmt::format("NonlinearLagrangian::restitution gave {} numbers, expected {}, the rows "
                      "of gap_pattern on this rank",
                      e.size(), constraints));
    for (const double value : e)
      if (!(value >= 0.0 && value <= 1.0))
        throw InputError(fmt::format("the restitution {} of a NonlinearLagrangian is outside [0, 1]", value));
  });
  Vector result = make_vector(comm, constraints);
  const WriteArray values(result.get());
  std::copy(e.begin(), e.end(), values.data());
  return result;
}

}  // namespace

NonlinearMoreauJean::NonlinearMoreauJean(const NonlinearLagrangian& system, const MoreauJeanOptions& options,
                                         const TimeGrid& grid)
    : NonlinearMoreauJean(system, options, grid, system.initial_position(), system.initial_velocity()) {}

NonlinearMoreauJean::NonlinearMoreauJean(const NonlinearLagrangian& system, const MoreauJeanOptions& options,
                                         const TimeGrid& grid, const Vector& q0, const Vector& v0)
    : MoreauJean(PetscObjectComm(reinterpret_cast<PetscObject>(q0.get())), options, grid.h(), q0.get(),
                 v0.get()),
      system_(system),
      momentum_(system, options.theta, grid.h()),
      H_(system.gap_pattern()) {
  for (Vector* vector : {&scale_, &v_new_, &r_, &part_, &position_, &terms_v_})
    *vector = duplicate(q_.get());
  check(MatCreateVecs(H_.get(), nullptr, nu_.put()));
  gap_part_ = duplicate(nu_.get());
  u_ = make_vector(comm(), local_ + row_range(H_.get()).size());
  work_ = duplicate(u_.get());
  known_ = duplicate(u_.get());
  {
    const ReadArray v(v_.get());
    const WriteArray u(u_.get());
    std::copy_n(v.data(), v.size(), u.data());
  }
  start_contacts();
  find_scales();
}

std::vector<double> NonlinearMoreauJean::gaps_at(Vec q) {
  system_.gaps(q, gap_part_.get());
  return values_of(gap_part_.get());
}

void NonlinearMoreauJean::start_contacts() {
  check(MatZeroEntries(H_.get()));
  system_.gap_gradient(q_.get(), H_.get());
  check(MatAssemblyBegin(H_.get(), MAT_FINAL_ASSEMBLY));
  check(MatAssemblyEnd(H_.get(), MAT_FINAL_ASSEMBLY));
  std::vector<double> gaps = gaps_at(q_.get());
  check(MatMult(H_.get(), v_.get(), gap_part_.get()));
  const Vector e = restitution_of(system_, comm(), row_range(H_.get()).size());
  contacts_.start(std::move(gaps), values_of(gap_part_.get()), e.get());
  look_at_contacts(true);
}

// Which constraints take part, and H where that is decided.
void NonlinearMoreauJean::detect(const Step& step) {
  check(VecWAXPY(position_.get(), reach_of(detection_) * step.h, v_.get(), q_.get()));
  contacts_.detect(gaps_at(position_.get()), detection_);
  check(MatZeroEntries(H_.get()));
  system_.gap_gradient(position_.get(), H_.get());
  check(MatAssemblyBegin(H_.get(), MAT_FINAL_ASSEMBLY));
  check(MatAssemblyEnd(H_.get(), MAT_FINAL_ASSEMBLY));
  abs_H_ = absolute_copy(H_.get());
  check(MatMult(H_.get(), v_.get(), gap_part_.get()));
  contacts_.velocity = values_of(gap_part_.get());
}

void NonlinearMoreauJean::find_scales() {
  check(MatGetDiagonal(momentum_.mass(q_.get()), scale_.get()));
  agreed(comm(), [&] {
    const ReadArray mass(scale_.get());
    for (PetscInt j = 0; j < mass.size(); ++j)
      if (!(mass[j] > 0.0))
        throw InputError(fmt::format(
            "NonlinearLagrangian::mass gave {} on the diagonal; M is positive definite", mass[j]));
  });
  check(VecReciprocal(scale_.get()));
  // A gap whose gradient vanishes here has no scale of its own; any will do.
  RowBuilder squares;
  for_each_row(H_.get(), [&](PetscInt, auto columns, auto values) {
    for (std::size_t k = 0; k < columns.size(); ++k)
      squares.add(columns[k], values[k] * values[k]);
    squares.end_row();
  });
  const Matrix squared = squares.finish(comm(), local_);
  check(MatMult(squared.get(), scale_.get(), gap_part_.get()));
  delta_ = values_of(gap_part_.get());
  for (double& value : delta_)
    if (value == 0.0) value = 1.0;
}

void NonlinearMoreauJean::begin(const Step& step, Vec lower, Vec upper, Vec guess) {
  ++version_;
  detect(step);
  find_scales();
  momentum_.start(step.t_old, step.t_new, q_.get(), v_.get());
  abs_J_ = absolute_copy(momentum_.jacobian(v_.get()));
  check(VecSet(lower, PETSC_NINFINITY));
  check(VecSet(upper, PETSC_INFINITY));
  check(VecCopy(u_.get(), guess));
  const WriteArray l(lower);
  const WriteArray start(guess);
  for (std::size_t a = 0; a < contacts_.size(); ++a) {
    if (contacts_.detected(a))
      l[row(a)] = 0.0;
    else
      start[row(a)] = 0.0;
  }
}

// v and mu of u.
void NonlinearMoreauJean::split(Vec u) {
  const ReadArray values(u);
  const WriteArray v(v_new_.get());
  const WriteArray mu(nu_.get());
  std::copy_n(values.data(), local_, v.data());
  for (std::size_t a = 0; a < delta_.size(); ++a)
    mu[static_cast<PetscInt>(a)] = values[row(a)] / delta_[a];
}

void NonlinearMoreauJean::residual(Vec u, Vec f) {
  split(u);
  momentum_.evaluate(v_new_.get(), r_.get());
  check(MatMultTranspose(H_.get(), nu_.get(), part_.get()));
  check(MatMult(H_.get(), v_new_.get(), gap_part_.get()));
  const ReadArray values(u);
  const ReadArray momentum(r_.get());
  const ReadArray push(part_.get());
  const ReadArray scale(scale_.get());
  const ReadArray velocity(gap_part_.get());
  const WriteArray result(f);
  for (PetscInt j = 0; j < local_; ++j)
    result[j] = scale[j] * (momentum[j] - push[j]);
  for (std::size_t a = 0; a < contacts_.size(); ++a)
    result[row(a)] =
        contacts_.detected(a) ? velocity[static_cast<PetscInt>(a)] - contacts_.rebound(a) : values[row(a)];
}

// |dR/dv| (|v| + |v_k|) + |R| + |h F| + |H'| mu, and |H| (|v| + |v_k|) with a tenth of the terms of the
// velocities read: in contact H v is zero in exact arithmetic, while v is known up to its own row's terms.
void NonlinearMoreauJean::row_terms(Vec u, Vec terms) {
  split(u);
  momentum_.evaluate(v_new_.get(), r_.get());
  check(VecAbs(r_.get()));
  check(VecCopy(v_.get(), terms_v_.get()));
  check(VecAbs(terms_v_.get()));
  check(VecAbs(v_new_.get()));
  check(VecAXPY(terms_v_.get(), 1.0, v_new_.get()));
  check(MatMultAdd(abs_J_.get(), terms_v_.get(), r_.get(), r_.get()));
  check(VecCopy(momentum_.free_terms(), part_.get()));
  check(VecAbs(part_.get()));
  check(VecAXPY(r_.get(), 1.0, part_.get()));
  check(VecAbs(nu_.get()));
  check(MatMultTransposeAdd(abs_H_.get(), nu_.get(), r_.get(), r_.get()));
  check(VecPointwiseMult(r_.get(), r_.get(), scale_.get()));
  check(VecAXPY(terms_v_.get(), inherited, r_.get()));
  check(MatMult(abs_H_.get(), terms_v_.get(), gap_part_.get()));
  const ReadArray values(u);
  const ReadArray momentum(r_.get());
  const ReadArray velocity(gap_part_.get());
  const WriteArray result(terms);
  std::copy_n(momentum.data(), local_, result.data());
  for (std::size_t a = 0; a < contacts_.size(); ++a)
    result[row(a)] = contacts_.detected(a) ? velocity[static_cast<PetscInt>(a)] : std::abs(values[row(a)]);
}

// [d^-1 J  -d^-1 H' delta^-1; H  0], the row nu = 0 where a constraint is not detected; with room for either.
Matrix NonlinearMoreauJean::saddle(Mat J) const {
  Matrix pushes = transpose(H_.get());
  const Vector inverse = duplicate(nu_.get());
  {
    const WriteArray values(inverse.get());
    for (std::size_t a = 0; a < delta_.size(); ++a)
      values[static_cast<PetscInt>(a)] = 1.0 / delta_[a];
  }
  check(MatDiagonalScale(pushes.get(), scale_.get(), inverse.get()));
  const Stacked number(J, nu_.get());
  const LocalRange coordinates = row_range(J);
  const LocalRange constraints = row_range(H_.get());
  const ReadArray scale(scale_.get());
  RowBuilder rows;
  for (PetscInt j = coordinates.first; j < coordinates.last; ++j) {
    for (const auto& [column, value] : get_row(J, j))
      rows.add(number.x(column), scale[j - coordinates.first] * value);
    for (const auto& [column, value] : get_row(pushes.get(), j))
      rows.add(number.nu(column), -value);
    rows.end_row();
  }
  for (PetscInt a = constraints.first; a < constraints.last; ++a) {
    const bool detected = contacts_.detected(static_cast<std::size_t>(a - constraints.first));
    for (const auto& [column, value] : get_row(H_.get(), a))
      rows.add(number.x(column), detected ? value : 0.0);
    rows.add(number.nu(a), detected ? 0.0 : 1.0);
    rows.end_row();
  }
  return rows.finish(comm(), coordinates.size() + constraints.size());
}

Matrix NonlinearMoreauJean::create_jacobian() const {
  const Matrix pattern = momentum_.create_jacobian();
  Matrix jacobian = saddle(pattern.get());
  // Finite differences have the pattern made symmetric.
  check(MatSetOption(jacobian.get(), MAT_NEW_NONZERO_ALLOCATION_ERR, PETSC_FALSE));
  check(MatSetOption(jacobian.get(), MAT_KEEP_NONZERO_PATTERN, PETSC_TRUE));
  return jacobian;
}

void NonlinearMoreauJean::jacobian(Vec u, Mat jacobian) {
  split(u);
  const Matrix now = saddle(momentum_.jacobian(v_new_.get()));
  check(MatZeroEntries(jacobian));
  for_each_row(now.get(), [&](PetscInt row, auto columns, auto values) {
    check(MatSetValues(jacobian, 1, &row, static_cast<PetscInt>(columns.size()), columns.data(),
                       values.data(), INSERT_VALUES));
  });
  check(MatAssemblyBegin(jacobian, MAT_FINAL_ASSEMBLY));
  check(MatAssemblyEnd(jacobian, MAT_FINAL_ASSEMBLY));
}

bool NonlinearMoreauJean::set_step(double h) {
  h_ = h;
  momentum_.set_step(h);
  return true;
}

void NonlinearMoreauJean::settle(Vec u) {
  row_terms(u, known_.get());
  residual(u, work_.get());
  const ReadArray scale(known_.get());
  const ReadArray f(work_.get());
  const WriteArray values(u);
  for (std::size_t a = 0; a < contacts_.size(); ++a) {
    double& nu = values[row(a)];
    const bool open = f[row(a)] > nu && f[row(a)] > held_rtol * scale[row(a)];
    if (!contacts_.detected(a) || nu < 0.0 || open) nu = 0.0;
  }
}

void NonlinearMoreauJean::accept(Vec u, Vec f) {
  find_increment(u);
  row_terms(u, known_.get());
  {
    const ReadArray terms(known_.get());
    const ReadArray values(u);
    const ReadArray residual(f);
    for (std::size_t a = 0; a < contacts_.size(); ++a) {
      const PetscInt i = row(a);
      const bool holds =
          contacts_.detected(a) && (residual[i] < values[i] || std::abs(residual[i]) <= held_rtol * terms[i]);
      const double impulse = holds ? values[i] / delta_[a] : 0.0;
      contacts_.take_impulse(a, holds, impulse);
      lost_.dissipated -= 0.5 * impulse * (contacts_.velocity[a] + contacts_.rebound(a));
    }
  }
  move();
  take_velocity(u);
  contacts_.gap = gaps_at(q_.get());
  contacts_.deepest.reset();
  look_at_contacts();
}

Energy NonlinearMoreauJean::energy() {
  Energy sum = lost_;
  check(MatMult(momentum_.mass(q_.get()), v_.get(), part_.get()));
  {
    const ReadArray v(v_.get());
    const ReadArray impulse(part_.get());
    for (PetscInt j = 0; j < v.size(); ++j)
      sum.kinetic += 0.5 * v[j] * impulse[j];
  }
  sum.potential = system_.potential(q_.get());
  return summed(comm(), sum);
}

std::unique_ptr<MechanicalDvi> make_moreau_jean(const NonlinearLagrangian& system,
                                                const MoreauJeanOptions& options, const TimeGrid& grid) {
  return std::make_unique<NonlinearMoreauJean>(system, options, grid);
}

}  // namespace sweepvi
