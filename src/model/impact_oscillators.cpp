#include "sweepvi/impact_oscillators.hpp"

#include <cmath>
#include <string>
#include <utility>

#include "petsc/finite_differences.hpp"
#include "petsc/sparse.hpp"

namespace sweepvi {

bool ImpactOscillators::jacobian(double, Vec, Vec, Mat, Mat) const {
  return false;
}

std::optional<double> ImpactOscillators::potential(Vec) const {
  return std::nullopt;
}

// The transformation ----------------------------------------------------------------------------------

Physical to_physical(Transformed transformed, double kappa) {
  const auto [s, v] = transformed;
  if (s == 0.0) return {0.0, (1.0 - kappa) * std::abs(v)};
  const double same_sign = (s > 0.0) == (v > 0.0) ? 1.0 : -1.0;
  return {std::abs(s), (1.0 - kappa * same_sign) * (s > 0.0 ? v : -v)};
}

Transformed to_transformed(Physical physical, double kappa) {
  const auto [x, velocity] = physical;
  return {x, velocity / (velocity > 0.0 ? 1.0 - kappa : 1.0 + kappa)};
}

// Derivatives -----------------------------------------------------------------------------------------

ImpactJacobian::ImpactJacobian(const ImpactOscillators& oscillators)
    : oscillators_(oscillators), by_x_(oscillators.pattern()) {
  if (oscillators.reads_velocities()) by_velocity_ = oscillators.pattern();
}

ImpactJacobian::~ImpactJacobian() = default;

void ImpactJacobian::evaluate(double t, Vec x, Vec velocity) {
  for (const Matrix* matrix : {&by_x_, &by_velocity_})
    if (*matrix) check(MatZeroEntries(matrix->get()));
  if (!oscillators_.jacobian(t, x, velocity, by_x(), by_velocity())) {
    finite_differences(t, x, velocity);
    return;
  }
  for (const Matrix* matrix : {&by_x_, &by_velocity_}) {
    if (!*matrix) continue;
    check(MatAssemblyBegin(matrix->get(), MAT_FINAL_ASSEMBLY));
    check(MatAssemblyEnd(matrix->get(), MAT_FINAL_ASSEMBLY));
  }
}

void ImpactJacobian::finite_differences(double t, Vec x, Vec velocity) {
  t_ = t;
  x_ = x;
  velocity_ = velocity;
  if (!differences_by_x_) {
    const Matrix pattern = oscillators_.pattern();
    differences_by_x_ = std::make_unique<FiniteDifferences>(
        pattern.get(), [this](Vec at, Vec a) { oscillators_.acceleration(t_, at, velocity_, a); });
    if (by_velocity_)
      differences_by_velocity_ = std::make_unique<FiniteDifferences>(
          pattern.get(), [this](Vec at, Vec a) { oscillators_.acceleration(t_, x_, at, a); });
  }
  by_x_ = Matrix::share(differences_by_x_->evaluate(x));
  if (by_velocity_) by_velocity_ = Matrix::share(differences_by_velocity_->evaluate(velocity));
}

// Chains ----------------------------------------------------------------------------------------------

namespace {

/// Oscillators whose accelerations are rows of a linear system: a = K x + D x' + f(t).
class LinearOscillators final : public ImpactOscillators {
public:
  LinearOscillators(const LinearSystem& system, std::vector<double> kappa)
      : system_(system), kappa_(std::move(kappa)) {
    agreed(system.comm(), [&] { check_layout(); });
    const auto count = static_cast<PetscInt>(kappa_.size());
    const PetscInt first = row_range(system.A.get()).first;
    RowBuilder stiffness;
    RowBuilder damping;
    int damped = 0;
    for_each_row(system.A.get(), [&](PetscInt row, auto columns, auto values) {
      if ((row - first) % 2 == 0) return;  // x' = x'
      stiffness.add(row / 2, 0.0);         // a full diagonal
      damping.add(row / 2, 0.0);
      for (std::size_t k = 0; k < columns.size(); ++k) {
        const bool of_velocity = columns[k] % 2 != 0;
        (of_velocity ? damping : stiffness).add(columns[k] / 2, values[k]);
        if (of_velocity && values[k] != 0.0) damped = 1;
      }
      stiffness.end_row();
      damping.end_row();
    });
    stiffness_ = stiffness.finish(system.comm(), count);
    MPI_Allreduce(MPI_IN_PLACE, &damped, 1, MPI_INT, MPI_LOR, system.comm());
    if (damped != 0) damping_ = damping.finish(system.comm(), count);
    all_forces_ = duplicate(system.x0.get());
    force_ = make_vector(system.comm(), count);
    work_ = duplicate(force_.get());
  }

  std::vector<double> kappa() const override { return kappa_; }

  void start(Vec x, Vec velocity) const override {
    const ReadArray states(system_.x0.get());
    const WriteArray positions(x);
    const WriteArray velocities(velocity);
    for (PetscInt i = 0; i < positions.size(); ++i) {
      positions[i] = states[2 * i];
      velocities[i] = states[2 * i + 1];
    }
  }

  void acceleration(double t, Vec x, Vec velocity, Vec a) const override {
    check(MatMult(stiffness_.get(), x, a));
    if (damping_) check(MatMultAdd(damping_.get(), velocity, a, a));
    if (!system_.f.any) return;
    find_force(t);
    check(VecAXPY(a, 1.0, force_.get()));
  }

  Matrix pattern() const override {
    if (damping_) return add(stiffness_.get(), 1.0, damping_.get());
    Matrix copy;
    check(MatDuplicate(stiffness_.get(), MAT_COPY_VALUES, copy.put()));
    return copy;
  }
  bool jacobian(double, Vec, Vec, Mat by_x, Mat by_velocity) const override {
    check(MatAXPY(by_x, 1.0, stiffness_.get(), SUBSET_NONZERO_PATTERN));
    if (damping_) check(MatAXPY(by_velocity, 1.0, damping_.get(), SUBSET_NONZERO_PATTERN));
    return true;
  }
  bool linear() const override { return true; }
  bool reads_velocities() const override { return static_cast<bool>(damping_); }

  /// -x'Kx/2 - f'x: springs (their K is symmetric) and the constant part of the forces.
  std::optional<double> potential(Vec x) const override {
    check(MatMult(stiffness_.get(), x, work_.get()));
    const ReadArray positions(x);
    const ReadArray pulled(work_.get());
    double sum = 0.0;
    for (PetscInt i = 0; i < positions.size(); ++i)
      sum -= 0.5 * positions[i] * pulled[i];
    for (const auto* entries : {&system_.f.constant, &system_.f.varying})
      for (const Forcing::Entry& entry : *entries) {
        const Signal& signal = entry.signal;
        const double constant = signal.varies() ? signal.offset : signal.value(0.0);
        sum -= constant * positions[entry.local / 2];
      }
    return sum;
  }

private:
  /// f(t), kept for the next call: a step asks many times for the same t.
  void find_force(double t) const {
    if (t == force_time_ || (force_time_ && !system_.f.varies)) return;
    force_time_ = t;
    check(VecSet(all_forces_.get(), 0.0));
    system_.f.add_to(all_forces_.get(), t, 0, 1.0);
    const ReadArray all(all_forces_.get());
    const WriteArray force(force_.get());
    for (PetscInt i = 0; i < force.size(); ++i)
      force[i] = all[2 * i + 1];
  }

  /// States x, x' of one oscillator after the other, nothing else.
  void check_layout() const {
    const LocalRange states = row_range(system_.A.get());
    bool fits = row_range(system_.C.get()).size() == static_cast<PetscInt>(kappa_.size()) &&
                states.size() == 2 * static_cast<PetscInt>(kappa_.size());
    for (PetscInt row = states.first; fits && row < states.last; row += 2)
      fits = get_row(system_.A.get(), row) == SparseRow{{row + 1, 1.0}} &&
             get_row(system_.C.get(), row / 2) == SparseRow{{row, 1.0}};
    if (!fits)
      throw InputError(
          "a system is no chain of impact oscillators: expected the states x_i, x_i' of one oscillator after "
          "the other, x_i' = x_i' first, w_i = x_i, and one kappa for each");
  }

  const LinearSystem& system_;
  std::vector<double> kappa_;
  Matrix stiffness_, damping_;
  Vector all_forces_, force_, work_;
  mutable std::optional<double> force_time_;
};

}  // namespace

std::unique_ptr<ImpactOscillators> make_impact_oscillators(const LinearSystem& system,
                                                           std::vector<double> kappa) {
  return std::make_unique<LinearOscillators>(system, std::move(kappa));
}

}  // namespace sweepvi
