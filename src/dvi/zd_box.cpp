#include "dvi/zd_box.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include "dvi/output_coordinates.hpp"
#include "dvi/residue.hpp"
#include "petsc/sparse.hpp"
#include "sweepvi/relative_degree.hpp"
#include "sweepvi/scheme.hpp"

namespace sweepvi {

ZdBox::ZdBox(const ZdSystem& system, const TimeGrid& grid, double theta)
    : ZdBox(system, grid, theta, system.initial_state()) {}

// The communicator is that of the state, and lives as long.
ZdBox::ZdBox(const ZdSystem& system, const TimeGrid& grid, double theta, Vector state)
    : OutputBox(PetscObjectComm(reinterpret_cast<PetscObject>(state.get())), grid.h()),
      system_(system),
      constraints_(system.constraints()),
      derivative_(system),
      theta_(theta),
      t_new_(grid.start) {
  u_ = std::move(state);
  rates_ = duplicate(u_.get());
  work_ = duplicate(u_.get());
  if (theta != 1.0) {
    old_rates_ = duplicate(u_.get());
    old_terms_ = duplicate(u_.get());
  }
  agreed(comm(), [&] { check_levels(); });
  allocate();
  start_from(u_.get());
  gains_.assign(constraints_.size(), 1.0);
  find_gains(u_.get());
  make_linearisation();
}

void ZdBox::check_levels() const {
  PetscInt size = 0;
  check(VecGetLocalSize(u_.get(), &size));
  std::vector<char> taken(static_cast<std::size_t>(size), 0);
  for (const ZdSystem::Constraint& constraint : constraints_) {
    if (constraint.levels.empty())
      throw InputError("a constraint of a ZdSystem has no levels; expected r >= 1");
    if (!(constraint.wmax > 0.0)) throw InputError("wmax of a ZdSystem's constraint must be > 0");
    for (const PetscInt level : constraint.levels) {
      if (level < 0 || level >= size || taken[static_cast<std::size_t>(level)] != 0)
        throw InputError("level " + std::to_string(level) +
                         " of a ZdSystem's constraint is not a local index of u, or is another level too");
      taken[static_cast<std::size_t>(level)] = 1;
    }
  }
}

void ZdBox::allocate() {
  std::vector<int> degrees;
  std::vector<PetscInt> places;
  PetscInt size = 0;
  check(VecGetLocalSize(u_.get(), &size));
  next_.assign(static_cast<std::size_t>(size), -1);
  int highest = 1;
  for (const ZdSystem::Constraint& constraint : constraints_) {
    degrees.push_back(static_cast<int>(constraint.levels.size()));
    highest = std::max(highest, degrees.back());
    for (std::size_t i = 0; i < constraint.levels.size(); ++i) {
      places.push_back(constraint.levels[i]);
      if (i + 1 < constraint.levels.size())
        next_[static_cast<std::size_t>(constraint.levels[i])] = constraint.levels[i + 1];
    }
  }
  MPI_Allreduce(MPI_IN_PLACE, &highest, 1, MPI_INT, MPI_MAX, comm());
  const Vector wmax = make_vector(comm(), static_cast<PetscInt>(constraints_.size()));
  check(VecGetOwnershipRange(wmax.get(), &first_constraint_, nullptr));
  int walls_above = 0;
  {
    const WriteArray walls(wmax.get());
    for (std::size_t a = 0; a < constraints_.size(); ++a) {
      walls[static_cast<PetscInt>(a)] = constraints_[a].wmax;
      if (constraints_[a].wmax < PETSC_INFINITY) walls_above = 1;
    }
  }
  MPI_Allreduce(MPI_IN_PLACE, &walls_above, 1, MPI_INT, MPI_LOR, comm());
  two_sided_ = walls_above != 0;
  levels_.allocate(degrees, highest, wmax.get());
  set_places(std::move(places));
}

// df/du with the exact rows of levels below r.
Matrix ZdBox::companion(Mat user) const {
  const LocalRange range = row_range(user);
  RowBuilder rows;
  for_each_row(user, [&](PetscInt row, auto columns, auto values) {
    const PetscInt next = next_[static_cast<std::size_t>(row - range.first)];
    if (next >= 0) {
      rows.add(range.first + next, 1.0);
    } else {
      for (std::size_t k = 0; k < columns.size(); ++k)
        if (values[k] != 0.0) rows.add(columns[k], values[k]);
    }
    rows.end_row();
  });
  return rows.finish(comm(), range.size());
}

// The linear system behind the jumps, and the pattern of dF/du: from a Jacobian of the given pattern whose
// values are generic, so that nothing cancels by chance.
void ZdBox::make_linearisation() {
  const Matrix user = system_.pattern();
  const LocalRange range = row_range(user.get());
  RowBuilder generic;
  for_each_row(user.get(), [&](PetscInt row, auto columns, auto) {
    for (const PetscInt column : columns)
      generic.add(column, 1.0 + std::fmod(0.6180339887498949 * static_cast<double>(row) +
                                              0.7548776662466927 * static_cast<double>(column) + 0.5,
                                          1.0));
    generic.end_row();
  });
  const Matrix values = generic.finish(comm(), range.size());

  const auto count = static_cast<PetscInt>(constraints_.size());
  PetscInt first = 0;
  MPI_Exscan(&count, &first, 1, MPIU_INT, MPI_SUM, comm());
  std::vector<PetscInt> pushed_by(static_cast<std::size_t>(range.size()), -1);
  RowBuilder c;
  for (std::size_t a = 0; a < constraints_.size(); ++a) {
    c.add(range.first + constraints_[a].levels.front(), 1.0);
    c.end_row();
    pushed_by[static_cast<std::size_t>(constraints_[a].levels.back())] = first + static_cast<PetscInt>(a);
    linearised_.constraint_order.push_back(first + static_cast<PetscInt>(a));
  }
  RowBuilder b;
  for (const PetscInt a : pushed_by) {
    if (a >= 0) b.add(a, 1.0);
    b.end_row();
  }
  linearised_.B = b.finish(comm(), count);
  linearised_.C = c.finish(comm(), range.size());
  linearised_.x0 = duplicate(u_.get());
  linearised_.w0 = make_vector(comm(), count);

  Matrix A = companion(values.get());
  update_jumps(Matrix::share(A.get()));
  coupled_ = static_cast<bool>(inverse_jumps_);
  pattern_ = newton_matrix(A.get());
}

void ZdBox::forget_jumps() {
  inverse_jumps_ = Matrix{};
  abs_inverse_ = Matrix{};
}

void ZdBox::update_jumps(Matrix A) {
  forget_jumps();
  linearised_.A = std::move(A);
  const RelativeDegree degree = analyse_relative_degree(linearised_);
  const OutputCoordinates coordinates(linearised_, degree);
  const Matrix jumps = coordinates.jumps();
  if (!jumps) return;
  inverse_jumps_ = coordinates.inverse_jumps(jumps.get());
  abs_inverse_ = absolute_copy(inverse_jumps_.get());
}

// J^{-1} (I - h theta A)
Matrix ZdBox::newton_matrix(Mat A) const {
  Matrix K = implicit_euler(A, h_ * theta_);
  return inverse_jumps_ ? multiply(inverse_jumps_.get(), K.get()) : std::move(K);
}

Matrix ZdBox::create_jacobian() const {
  Matrix jacobian;
  check(MatDuplicate(pattern_.get(), MAT_COPY_VALUES, jacobian.put()));
  // Should an entry turn up that the generic values did not have, it finds its place.
  check(MatSetOption(jacobian.get(), MAT_NEW_NONZERO_ALLOCATION_ERR, PETSC_FALSE));
  return jacobian;
}

void ZdBox::begin(const Step& step, Vec lower, Vec upper, Vec guess) {
  t_new_ = step.t_new;
  ++version_;
  begin_levels(lower, upper);
  Matrix A = companion(derivative_.evaluate(t_new_, u_.get()));
  abs_A_ = absolute_copy(A.get());
  if (old_rates_) find_old_rates(step.t_old);
  reading_ = absolute_up_to(A.get(), 1.0 / h_);
  if (coupled_) {
    if (may_impact())
      update_jumps(std::move(A));
    else
      forget_jumps();
  }
  check(VecCopy(u_.get(), guess));
}

// Whether a measure below level r can come up in this step: some z_1 is so near its bound that the higher
// levels could take it there, with room to spare. Elsewhere, and in resting contact, only level r acts; it
// jumps nothing but its own output, and any J will do: the identity, which remembers no earlier step.
bool ZdBox::may_impact() const {
  constexpr double room = 4.0;
  int near = 0;
  for (std::size_t a = 0; a < levels_.constraints(); ++a) {
    double reach = 0.0;
    for (int i = levels_.levels(a); i > 1; --i)
      reach = h_ * (std::abs(levels_.z[levels_.at(a, i)]) + reach);
    const double z1 = levels_.z[levels_.at(a, 1)];
    const double gap = std::min(z1, levels_.upper[a] - z1);
    if (gap < room * reach || gap < 0.0) near = 1;
  }
  MPI_Allreduce(MPI_IN_PLACE, &near, 1, MPI_INT, MPI_LOR, comm());
  return near != 0;
}

void ZdBox::find_old_rates(double t) {
  const double weight = h_ * (1.0 - theta_);
  find_rates(t, u_.get(), old_rates_.get());
  check(VecCopy(u_.get(), work_.get()));
  check(VecAbs(work_.get()));
  check(MatMult(abs_A_.get(), work_.get(), old_terms_.get()));
  const WriteArray rate(old_rates_.get());
  const WriteArray terms(old_terms_.get());
  for (PetscInt i = 0; i < rate.size(); ++i) {
    rate[i] *= weight;
    terms[i] = weight * terms[i] + std::abs(rate[i]);
  }
}

void ZdBox::find_rates(double t, Vec u, Vec rates) {
  system_.rates(t, u, rates);
  const ReadArray values(u);
  const WriteArray result(rates);
  for (std::size_t i = 0; i < next_.size(); ++i)
    if (next_[i] >= 0) result[static_cast<PetscInt>(i)] = values[next_[i]];
}

void ZdBox::residual(Vec u, Vec f) {
  find_rates(t_new_, u, rates_.get());
  Vec plain = inverse_jumps_ ? work_.get() : f;
  check(VecWAXPY(plain, -1.0, u_.get(), u));
  check(VecAXPY(plain, -h_ * theta_, rates_.get()));
  if (old_rates_) check(VecAXPY(plain, -1.0, old_rates_.get()));
  if (inverse_jumps_) check(MatMult(inverse_jumps_.get(), plain, f));
}

// |u| + |u_k| + h (|f| + |df/du| |u|)_theta: rates are sums, too, and their terms are not known otherwise.
void ZdBox::row_terms(Vec u, Vec terms) {
  find_rates(t_new_, u, rates_.get());
  Vec plain = inverse_jumps_ ? work_.get() : terms;
  check(VecCopy(u, plain));
  check(VecAbs(plain));
  Vec inner = inverse_jumps_ ? terms : work_.get();
  check(MatMult(abs_A_.get(), plain, inner));
  {
    const ReadArray old(u_.get());
    const ReadArray rate(rates_.get());
    const ReadArray read(inner);
    const WriteArray sum(plain);
    for (PetscInt i = 0; i < sum.size(); ++i)
      sum[i] += std::abs(old[i]) + h_ * theta_ * (std::abs(rate[i]) + read[i]);
  }
  if (old_terms_) check(VecAXPY(plain, 1.0, old_terms_.get()));
  if (inverse_jumps_) check(MatMult(abs_inverse_.get(), plain, terms));
}

bool ZdBox::spread_terms(Vec terms) {
  check(MatMult(reading_.get(), terms, work_.get()));
  check(VecAXPY(terms, h_, work_.get()));
  if (!inverse_jumps_) return true;
  check(MatMult(abs_inverse_.get(), terms, work_.get()));
  check(VecCopy(work_.get(), terms));
  return true;
}

void ZdBox::jacobian(Vec u, Mat jacobian) {
  const Matrix K = newton_matrix(companion(derivative_.evaluate(t_new_, u)).get());
  check(MatZeroEntries(jacobian));
  for_each_row(K.get(), [&](PetscInt row, auto columns, auto values) {
    check(MatSetValues(jacobian, 1, &row, static_cast<PetscInt>(columns.size()), columns.data(),
                       values.data(), INSERT_VALUES));
  });
  check(MatAssemblyBegin(jacobian, MAT_FINAL_ASSEMBLY));
  check(MatAssemblyEnd(jacobian, MAT_FINAL_ASSEMBLY));
}

void ZdBox::find_gains(Vec u) {
  system_.gains(t_new_, u, gains_);
  agreed(comm(), [&] {
    if (gains_.size() != constraints_.size())
      throw InputError("ZdSystem::gains gave " + std::to_string(gains_.size()) + " numbers, expected " +
                       std::to_string(constraints_.size()));
    for (const double gain : gains_)
      if (!(gain > 0.0))
        throw InputError("the gain m of a ZdSystem is " + std::to_string(gain) +
                         " at t = " + std::to_string(t_new_) + " s; expected more than 0");
  });
}

void ZdBox::accept(Vec u, Vec f) {
  find_gains(u);
  take(u, f, gains_);
}

void ZdBox::visit(StateVisitor& visitor) {
  visitor.visit("x", Belongs::state, u_.get());
  levels_.visit(visitor);
}

std::unique_ptr<ConstrainedDvi> make_zd_dvi(const ZdSystem& system, const TimeGrid& grid, double theta) {
  require_weight("theta of homsp", theta);
  return std::make_unique<ZdBox>(system, grid, theta);
}

}  // namespace sweepvi
