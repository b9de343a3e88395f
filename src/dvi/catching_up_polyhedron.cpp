#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "dvi/catching_up.hpp"
#include "dvi/empty_polyhedron.hpp"
#include "dvi/output_box.hpp"
#include "dvi/saddle.hpp"

namespace sweepvi {

namespace {

std::string empty_at(double t, const Contradiction& contradiction) {
  return fmt::format("K(t) is empty at t = {:.9g} s: {}", t, contradiction.text());
}

}  // namespace

CatchingUpPolyhedron::CatchingUpPolyhedron(const SweepingSystem& system, const TimeGrid& grid)
    : CatchingUp(system, grid),
      K_(system.A ? implicit_euler(system.A.get(), h_) : scaled_identity(system.u0.get(), 1.0)) {
  check(MatDuplicate(system.G.get(), MAT_COPY_VALUES, G_.put()));
  check(MatCreateVecs(G_.get(), push_.put(), g_.put()));
  x_ = duplicate(push_.get());
  g_terms_ = duplicate(g_.get());
  components_ = row_range(K_.get()).size();
  allocate(system.face_order.size());
  held_.assign(w_.size(), 0);
  assemble();
  move_faces(grid.start);
  agreed(comm(), [&] {
    if (!zero_face_) return;
    throw InputError(fmt::format("row {} of G is zero; a face has to read some component", *zero_face_));
  });
  check(MatCreateVecs(S_.get(), u_.put(), nullptr));
  for (Vector* vector : {&rhs_, &rhs_terms_, &residual_, &terms_})
    *vector = duplicate(u_.get());
  const ProximalNewton::Problem step{S_.get(), abs_S_.get(), rhs_.get(), rhs_terms_.get(), components_};
  newton_.emplace(step);

  if (const auto contradiction =
          find_contradiction(G_.get(), g_.get(), g_terms_.get(), system.u0.get(), system.face_order))
    throw InputError(empty_at(grid.start, *contradiction));
  check(VecCopy(system.u0.get(), x_.get()));
  {
    const ReadArray u0(x_.get());
    const ReadArray g(g_.get());
    const ReadArray g_terms(g_terms_.get());
    const WriteArray u(u_.get());
    const WriteArray rhs(rhs_.get());
    const WriteArray terms(rhs_terms_.get());
    std::copy_n(u0.data(), components_, u.data());
    for (PetscInt a = 0; a < g.size(); ++a) {
      rhs[components_ + a] = g[a];
      terms[components_ + a] = g_terms[a];
    }
  }
  start(observe(u_.get()));
}

bool CatchingUpPolyhedron::set_step(double h) {
  h_ = h;
  if (!system_.A) return true;
  K_ = implicit_euler(system_.A.get(), h);
  assemble();
  newton_->renew();
  ++version_;
  return true;
}

// Faces as they are at t.
void CatchingUpPolyhedron::move_faces(double t) {
  check(VecSet(g_.get(), 0.0));
  system_.g.add_to(g_.get(), t, 0, 1.0);
  if (!system_.move_faces) {
    find_terms_of_g();
    return;
  }
  system_.move_faces(t, G_.get(), g_.get());
  find_terms_of_g();
  assemble();
  if (newton_) newton_->renew();
  ++version_;
}

// A signal that passes through zero is known up to its amplitude's rounding.
void CatchingUpPolyhedron::find_terms_of_g() {
  check(VecCopy(g_.get(), g_terms_.get()));
  check(VecAbs(g_terms_.get()));
  if (system_.move_faces) return;
  const WriteArray terms(g_terms_.get());
  for (const auto* entries : {&system_.g.constant, &system_.g.varying})
    for (const Forcing::Entry& entry : *entries)
      terms[entry.local] = std::abs(entry.signal.offset) + std::abs(entry.signal.amplitude);
}

void CatchingUpPolyhedron::assemble() {
  Matrix S = saddle_matrix(K_.get(), G_.get());
  if (S_) {
    check(MatCopy(S.get(), S_.get(), SAME_NONZERO_PATTERN));
    const Matrix magnitude = absolute_copy(S.get());
    check(MatCopy(magnitude.get(), abs_S_.get(), SAME_NONZERO_PATTERN));
  } else {
    S_ = std::move(S);
    abs_S_ = absolute_copy(S_.get());
  }
  find_unit_faces();
}

void CatchingUpPolyhedron::find_unit_faces() {
  unit_faces_.clear();
  zero_face_.reset();
  const Stacked number(K_.get(), g_.get());
  PetscInt face = 0;
  for_each_row(G_.get(), [&](PetscInt, auto columns, auto values) {
    PetscInt read = 0;
    UnitFace unit{face, -1, 0.0};
    for (std::size_t k = 0; k < columns.size(); ++k) {
      if (values[k] == 0.0) continue;
      ++read;
      unit.unknown = number.x(columns[k]);
      unit.entry = values[k];
    }
    if (read == 1) unit_faces_.push_back(unit);
    if (read == 0) zero_face_ = system_.face_order[static_cast<std::size_t>(face)];
    ++face;
  });
  int any = unit_faces_.empty() ? 0 : 1;
  MPI_Allreduce(MPI_IN_PLACE, &any, 1, MPI_INT, MPI_LOR, comm());
  any_unit_face_ = any != 0;
}

Matrix CatchingUpPolyhedron::create_jacobian() const {
  Matrix jacobian;
  check(MatDuplicate(S_.get(), MAT_COPY_VALUES, jacobian.put()));
  return jacobian;
}

void CatchingUpPolyhedron::begin(const Step& step, Vec lower, Vec upper, Vec guess) {
  t_new_ = step.t_new;
  solved_ = Solved::not_tried;
  move_faces(step.t_new);
  check(VecSet(push_.get(), 0.0));
  system_.f.add_to(push_.get(), step.t_new, 0, step.h);
  check(VecSet(lower, PETSC_NINFINITY));
  check(VecSet(upper, PETSC_INFINITY));
  check(VecCopy(u_.get(), guess));
  const ReadArray u(u_.get());
  const ReadArray push(push_.get());
  const ReadArray g(g_.get());
  const ReadArray g_terms(g_terms_.get());
  const WriteArray l(lower);
  const WriteArray rhs(rhs_.get());
  const WriteArray terms(rhs_terms_.get());
  for (PetscInt i = 0; i < components_; ++i) {
    rhs[i] = u[i] + push[i];
    terms[i] = std::abs(u[i]) + std::abs(push[i]);
  }
  for (PetscInt a = 0; a < g.size(); ++a) {
    const PetscInt row = components_ + a;
    l[row] = 0.0;
    rhs[row] = g[a];
    terms[row] = g_terms[a];
  }
}

bool CatchingUpPolyhedron::predict(Vec guess) {
  const bool found = newton_->solve(guess);
  solved_ = found ? Solved::yes : Solved::no;
  return found;
}

std::string CatchingUpPolyhedron::obstacle() {
  if (solved_ == Solved::yes) return {};
  const auto contradiction =
      find_contradiction(G_.get(), g_.get(), g_terms_.get(), x_.get(), system_.face_order);
  return contradiction ? empty_at(t_new_, *contradiction) : std::string();
}

void CatchingUpPolyhedron::residual(Vec u, Vec f) {
  check(MatMult(S_.get(), u, f));
  check(VecAXPY(f, -1.0, rhs_.get()));
}

void CatchingUpPolyhedron::row_terms(Vec u, Vec terms) {
  newton_->row_terms(u, terms);
}

void CatchingUpPolyhedron::jacobian(Vec u, Mat jacobian) {
  derivative(u, jacobian);
  newton_->regularise(jacobian);
}

void CatchingUpPolyhedron::derivative(Vec, Mat matrix) {
  check(MatCopy(S_.get(), matrix, SAME_NONZERO_PATTERN));
}

// Which faces u stands on, up to rounding. Leaves G u - g in residual_.
void CatchingUpPolyhedron::find_held(Vec u) {
  row_terms(u, terms_.get());
  residual(u, residual_.get());
  const ReadArray gap(residual_.get());
  const ReadArray terms(terms_.get());
  for (std::size_t a = 0; a < held_.size(); ++a) {
    const PetscInt row = components_ + static_cast<PetscInt>(a);
    held_[a] = std::abs(gap[row]) <= held_rtol * terms[row] ? 1 : 0;
  }
}

// Open faces have no multiplier; what is held by a face that reads one component is put exactly there.
void CatchingUpPolyhedron::settle(Vec u) {
  find_held(u);
  {
    const ReadArray gap(residual_.get());
    const WriteArray values(u);
    for (std::size_t a = 0; a < held_.size(); ++a) {
      const PetscInt row = components_ + static_cast<PetscInt>(a);
      if ((held_[a] == 0 && gap[row] > 0.0) || values[row] < 0.0) values[row] = 0.0;
    }
  }
  if (!any_unit_face_) return;
  {
    const ReadArray g(g_.get());
    for (const UnitFace& unit : unit_faces_)
      if (held_[static_cast<std::size_t>(unit.face)] != 0)
        check(VecSetValue(u, unit.unknown, g[unit.face] / unit.entry, INSERT_VALUES));
  }
  check(VecAssemblyBegin(u));
  check(VecAssemblyEnd(u));
}

// The faces that u stands on or is outside of, and w.
std::vector<Side> CatchingUpPolyhedron::observe(Vec u) {
  find_held(u);
  const ReadArray gap(residual_.get());
  std::vector<Side> sides(w_.size(), Side::none);
  for (std::size_t a = 0; a < w_.size(); ++a) {
    w_[a] = held_[a] != 0 ? 0.0 : gap[components_ + static_cast<PetscInt>(a)];
    if (w_[a] <= 0.0) sides[a] = Side::lower;
  }
  return sides;
}

void CatchingUpPolyhedron::accept(Vec u, Vec) {
  check(VecCopy(u, u_.get()));
  const std::vector<Side> sides = observe(u);
  {
    const ReadArray values(u_.get());
    const WriteArray x(x_.get());
    std::copy_n(values.data(), components_, x.data());
    for (std::size_t a = 0; a < mu_.size(); ++a)
      mu_[a] = sides[a] == Side::none ? 0.0 : values[components_ + static_cast<PetscInt>(a)];
  }
  advance(sides);
}

// Multipliers and active faces are where the next step starts from.
void CatchingUpPolyhedron::visit(StateVisitor& visitor) {
  CatchingUp::visit(visitor);
  {
    const WriteArray u(u_.get());
    const ReadArray x(x_.get());
    std::copy_n(x.data(), components_, u.data());
    visitor.visit("nu", Belongs::constraint, std::span<double>(u.data() + components_, w_.size()), 1);
  }
  newton_->visit(visitor);
}

}  // namespace sweepvi
