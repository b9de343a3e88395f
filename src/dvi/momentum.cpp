#include "dvi/momentum.hpp"

#include <algorithm>
#include <cmath>

#include "petsc/sparse.hpp"

namespace sweepvi {

namespace {

void assemble(Mat matrix) {
  check(MatAssemblyBegin(matrix, MAT_FINAL_ASSEMBLY));
  check(MatAssemblyEnd(matrix, MAT_FINAL_ASSEMBLY));
}

Matrix union_of(Mat a, Mat b) {
  const Matrix first = absolute_copy(a);
  const Matrix second = absolute_copy(b);
  Matrix both = add(first.get(), 1.0, second.get());
  check(MatZeroEntries(both.get()));
  return both;
}

}  // namespace

Momentum::Momentum(const NonlinearLagrangian& system, double theta, double h)
    : system_(system),
      theta_(theta),
      h_(h),
      mass_(system.mass_pattern()),
      jacobian_(union_of(mass_.get(), system.jacobian_pattern().get())) {
  check(MatCreateVecs(mass_.get(), f_old_.put(), nullptr));
  for (Vector* vector : {&q_new_, &q_theta_, &dv_, &work_})
    *vector = duplicate(f_old_.get());
}

Matrix Momentum::create_jacobian() const {
  Matrix copy;
  check(MatDuplicate(jacobian_.get(), MAT_COPY_VALUES, copy.put()));
  return copy;
}

Mat Momentum::mass(Vec q) {
  check(MatZeroEntries(mass_.get()));
  system_.mass(q, mass_.get());
  assemble(mass_.get());
  return mass_.get();
}

void Momentum::start(double t_old, double t_new, Vec q, Vec v) {
  t_new_ = t_new;
  q_ = q;
  v_ = v;
  check(VecSet(f_old_.get(), 0.0));
  if (theta_ == 1.0) return;
  system_.force(t_old, q, v, f_old_.get());
  check(VecScale(f_old_.get(), h_ * (1.0 - theta_)));
}

// q_{k+1}, q_theta and v - v_k.
void Momentum::place(Vec v) {
  check(VecWAXPY(dv_.get(), -1.0, v_, v));
  check(VecWAXPY(work_.get(), theta_, dv_.get(), v_));  // v_theta
  check(VecWAXPY(q_new_.get(), h_, work_.get(), q_));
  check(VecWAXPY(q_theta_.get(), h_ * theta_, work_.get(), q_));
}

void Momentum::evaluate(Vec v, Vec result) {
  place(v);
  system_.force(t_new_, q_new_.get(), v, work_.get());
  check(MatMultAdd(mass(q_theta_.get()), dv_.get(), f_old_.get(), result));
  check(VecAXPY(result, h_ * theta_, work_.get()));
}

// M(q_theta) + h theta^2 d(M dv)/dq + h theta (dF/dv + h theta dF/dq)
Mat Momentum::jacobian(Vec v) {
  place(v);
  check(MatZeroEntries(jacobian_.get()));
  const double weight = h_ * theta_;
  const bool own =
      system_.force_jacobian(t_new_, q_new_.get(), v, weight * weight, weight, jacobian_.get()) &&
      system_.mass_jacobian(q_theta_.get(), dv_.get(), weight * theta_, jacobian_.get());
  assemble(jacobian_.get());
  if (!own) return differences(v);
  check(MatAXPY(jacobian_.get(), 1.0, mass(q_theta_.get()), SUBSET_NONZERO_PATTERN));
  return jacobian_.get();
}

Mat Momentum::differences(Vec v) {
  if (!differences_)
    differences_ = std::make_unique<FiniteDifferences>(jacobian_.get(),
                                                       [this](Vec at, Vec result) { evaluate(at, result); });
  return differences_->evaluate(v);
}

bool NonlinearLagrangian::force_jacobian(double, Vec, Vec, double, double, Mat) const {
  return false;
}

bool NonlinearLagrangian::mass_jacobian(Vec, Vec, double, Mat) const {
  return false;
}

double NonlinearLagrangian::potential(Vec) const {
  return 0.0;
}

namespace {

/// Some direction with entries of either sign, the same on any number of ranks.
Vector direction(Vec like, double size) {
  Vector result = duplicate(like);
  PetscInt first = 0;
  check(VecGetOwnershipRange(like, &first, nullptr));
  const WriteArray values(result.get());
  for (PetscInt i = 0; i < values.size(); ++i)
    values[i] = size * std::cos(1.0 + 2.3 * static_cast<double>(first + i));
  return result;
}

double momentum_error(const NonlinearLagrangian& system, double t, Vec q, Vec v) {
  constexpr double h = 0.1;
  Momentum momentum(system, 0.5, h);
  momentum.start(t, t + h, q, v);
  const Vector ahead = direction(v, 1.0);  // so that d(M dv)/dq shows
  check(VecAXPY(ahead.get(), 1.0, v));
  const Matrix own = Matrix::share(momentum.jacobian(ahead.get()));
  Mat differences = momentum.differences(ahead.get());
  const Matrix error = add(differences, -1.0, own.get());
  double worst = 0.0;
  for_each_row(error.get(), [&](PetscInt row, auto, auto values) {
    double scale = 1.0;
    for (const auto& [column, value] : get_row(differences, row))
      scale = std::max(scale, std::abs(value));
    for (const double value : values)
      worst = std::max(worst, std::abs(value) / scale);
  });
  return worst;
}

double gradient_error(const NonlinearLagrangian& system, Vec q) {
  constexpr double step = 1e-5;  // central differences: step^2 and rounding / step, about 1e-10
  const Matrix H = system.gap_pattern();
  check(MatZeroEntries(H.get()));
  system.gap_gradient(q, H.get());
  assemble(H.get());
  const Vector along = direction(q, 1.0);
  Vector exact;
  check(MatCreateVecs(H.get(), nullptr, exact.put()));
  const Vector before = duplicate(exact.get());
  const Vector after = duplicate(exact.get());
  const Vector moved = duplicate(q);
  check(MatMult(H.get(), along.get(), exact.get()));
  check(VecWAXPY(moved.get(), step, along.get(), q));
  system.gaps(moved.get(), after.get());
  check(VecWAXPY(moved.get(), -step, along.get(), q));
  system.gaps(moved.get(), before.get());
  const ReadArray slope(exact.get());
  const ReadArray high(after.get());
  const ReadArray low(before.get());
  double worst = 0.0;
  for (PetscInt a = 0; a < slope.size(); ++a) {
    const double difference = (high[a] - low[a]) / (2.0 * step);
    worst = std::max(worst, std::abs(slope[a] - difference) / std::max(1.0, std::abs(difference)));
  }
  return worst;
}

}  // namespace

double jacobian_error(const NonlinearLagrangian& system, double t, Vec q, Vec v) {
  double worst = std::max(momentum_error(system, t, q, v), gradient_error(system, q));
  MPI_Allreduce(MPI_IN_PLACE, &worst, 1, MPI_DOUBLE, MPI_MAX,
                PetscObjectComm(reinterpret_cast<PetscObject>(q)));
  return worst;
}

}  // namespace sweepvi
