#include "sweepvi/tracking.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <optional>

#include "dvi/tracking_step.hpp"
#include "petsc/sparse.hpp"
#include "sweepvi/impact_oscillators.hpp"

namespace sweepvi {

namespace {

double sign(double value) {
  return value > 0.0 ? 1.0 : value < 0.0 ? -1.0 : 0.0;
}

void check_bouncer(const Bouncer& bouncer, const std::string& name) {
  if (!(bouncer.kappa > 0.0 && bouncer.kappa < 1.0))
    throw InputError("kappa of the " + name + " is " + std::to_string(bouncer.kappa) +
                     "; expected 0 < kappa < 1");
  if (!(bouncer.x0 >= 0.0))
    throw InputError("the " + name + " starts at x = " + std::to_string(bouncer.x0) +
                     "; expected 0 or more, as the wall is x = 0");
  if (!std::isfinite(bouncer.velocity0)) throw InputError("the velocity of the " + name + " is no number");
}

void check_problem(const TrackingProblem& problem, const TrackingOptions& options) {
  check_bouncer(problem.plant, "plant");
  check_bouncer(problem.reference, "reference");
  for (const double gain : {problem.gains.mu1, problem.gains.mu2})
    if (!(gain > 0.0)) throw InputError("a gain is " + std::to_string(gain) + "; expected mu1, mu2 > 0");
  for (const double weight : {options.theta, options.gamma})
    if (!(weight > 0.0 && weight <= 1.0))
      throw InputError("theta or gamma is " + std::to_string(weight) + "; expected more than 0, at most 1");
}

class Tracking final : public TrackingDvi {
public:
  Tracking(MPI_Comm comm, const TrackingProblem& problem, const TrackingOptions& options);

  MPI_Comm comm() const override { return PetscObjectComm(reinterpret_cast<PetscObject>(u_.get())); }
  Vec state() const override { return u_.get(); }
  Matrix create_jacobian() const override;
  void begin(const Step& step, Vec lower, Vec upper, Vec guess) override;
  bool predict(Vec guess) override;
  bool predicts() const override { return true; }
  void residual(Vec u, Vec f) override;
  void row_terms(Vec u, Vec terms) override;
  void jacobian(Vec u, Mat jacobian) override;
  std::uint64_t jacobian_version() const override { return version_; }
  void settle(Vec vector) override;
  bool admissible(Vec u) override;
  void accept(Vec vector, Vec) override;
  double penetration() const override { return 0.0; }  // x = |s|
  PetscInt active() const override;
  void visit(StateVisitor& visitor) override;
  const TrackingState& tracked() const override { return tracked_; }
  const std::vector<StepEvent>& events() const override { return events_; }

private:
  using Unknowns = TrackingStep::Unknowns;

  bool mine() const { return rank_ == 0; }
  /// Work for the owner of the unknowns; the others hear of it if a force throws. @note Collective.
  template <class Work>
  void on_owner(Work&& work) {
    agreed(comm(), [&] {
      if (mine()) work();
    });
  }
  Unknowns read(Vec u) const;
  void write(const Unknowns& values, Vec u) const;
  void turn_upright();
  void publish(const Unknowns& u);
  void find_events(const Unknowns& old, const Unknowns& now);

  TrackingProblem problem_;
  TrackingOptions options_;
  TrackingStep step_;
  int rank_ = 0;
  Vector u_;
  std::uint64_t version_ = 0;
  TrackingState tracked_;
  std::vector<StepEvent> events_;
};

Tracking::Tracking(MPI_Comm comm, const TrackingProblem& problem, const TrackingOptions& options)
    : problem_(problem), options_(options), step_(problem_, options_) {
  check_problem(problem, options);
  MPI_Comm_rank(comm, &rank_);
  u_ = make_vector(comm, mine() ? tracking_size : 0);
  Unknowns u = Unknowns::Zero();
  const auto place = [&u](const Bouncer& bouncer, int s) {
    const Transformed start = to_transformed({bouncer.x0, bouncer.velocity0}, bouncer.kappa);
    u[s] = start.s;
    u[s + 1] = start.v;
  };
  place(problem.plant, S);
  place(problem.reference, SREF);
  for (int i = 0; i < 4; ++i)
    u[LS + i] = sign(u[S + i]);
  u[LES] = sign(u[S] - u[SREF]);
  u[LEV] = sign(u[V] - u[VREF]);
  write(u, u_.get());
  if (mine()) publish(u);
}

Tracking::Unknowns Tracking::read(Vec u) const {
  const ReadArray values(u);
  return mine() ? Unknowns(Unknowns::Map(values.data())) : Unknowns(Unknowns::Zero());
}

// On all ranks, though one alone has values: PETSc keeps norms of vectors that it believes unchanged, and
// must not believe it on some ranks only.
void Tracking::write(const Unknowns& values, Vec u) const {
  const WriteArray array(u);
  if (mine()) std::copy(values.begin(), values.end(), array.data());
}

// All entries: what is zero in one step is not in the next, and there are only a hundred.
Matrix Tracking::create_jacobian() const {
  RowBuilder rows;
  for (int i = 0; mine() && i < tracking_size; ++i) {
    for (PetscInt j = 0; j < tracking_size; ++j)
      rows.add(j, i == j ? 1.0 : 0.0);
    rows.end_row();
  }
  return rows.finish(comm(), mine() ? tracking_size : 0);
}

// A controller that reads its plant knows (x, x') of it, and takes the (s, v) with sgn(s) = 1. Where that
// turns the plant over it turns the reference and all signs over as well: the same motion.
void Tracking::turn_upright() {
  Unknowns u = read(u_.get());
  if (u[S] < 0.0 || (u[S] == 0.0 && u[V] < 0.0)) u = -u;
  const double kappa = problem_.plant.kappa;
  const Transformed upright = to_transformed(to_physical({u[S], u[V]}, kappa), kappa);
  u[S] = upright.s;
  u[V] = upright.v;
  write(u, u_.get());
}

void Tracking::begin(const Step& step, Vec lower, Vec upper, Vec guess) {
  if (options_.resample) turn_upright();
  step_.begin(step, read(u_.get()));
  check(VecCopy(u_.get(), guess));
  Unknowns bounds = Unknowns::Constant(PETSC_INFINITY);
  bounds.tail<6>().setOnes();
  write(-bounds, lower);
  write(bounds, upper);
}

bool Tracking::predict(Vec guess) {
  std::optional<TrackingStep::Solution> solution;
  on_owner([&] { solution = step_.solve(); });
  write(solution ? solution->u : read(guess), guess);
  int exact = solution && solution->exact ? 1 : 0;
  MPI_Bcast(&exact, 1, MPI_INT, 0, comm());
  return exact != 0;
}

void Tracking::residual(Vec u, Vec f) {
  ++version_;  // the Jacobian changes with the point
  Unknowns values = read(u);
  on_owner([&] { values = step_.residual(values); });
  write(values, f);
}

void Tracking::row_terms(Vec u, Vec terms) {
  Unknowns values = read(u);
  on_owner([&] { values = step_.terms(values); });
  write(values, terms);
}

void Tracking::jacobian(Vec u, Mat jacobian) {
  const Unknowns values = read(u);
  on_owner([&] {
    const Eigen::Matrix<double, tracking_size, tracking_size, Eigen::RowMajor> rows = step_.jacobian(values);
    std::array<PetscInt, tracking_size> places{};
    std::iota(places.begin(), places.end(), 0);
    check(MatSetValues(jacobian, tracking_size, places.data(), tracking_size, places.data(), rows.data(),
                       INSERT_VALUES));
  });
  check(MatAssemblyBegin(jacobian, MAT_FINAL_ASSEMBLY));
  check(MatAssemblyEnd(jacobian, MAT_FINAL_ASSEMBLY));
}

// Signs into [-1, 1]; what is zero up to the rounding of its row becomes zero: s, v, s_ref, v_ref, and
// errors.
void Tracking::settle(Vec vector) {
  Unknowns u = read(vector);
  u.tail<6>() = u.tail<6>().cwiseMax(-1.0).cwiseMin(1.0);
  Unknowns terms = Unknowns::Zero();
  on_owner([&] { terms = step_.terms(u); });
  for (const int i : {SREF, VREF})
    if (std::abs(u[i]) <= held_rtol * terms[i]) u[i] = 0.0;
  for (const int i : {S, V}) {
    const double error = std::abs(u[i] - u[i + 2]);
    if (error <= std::abs(u[i]) && error <= held_rtol * terms[LES + i]) {
      u[i] = u[i + 2];
    } else if (std::abs(u[i]) <= held_rtol * terms[i]) {
      u[i] = 0.0;
    }
  }
  write(u, vector);
}

bool Tracking::admissible(Vec u) {
  int taken = 1;
  on_owner([&] { taken = step_.admissible(read(u)) ? 1 : 0; });
  MPI_Bcast(&taken, 1, MPI_INT, 0, comm());
  return taken != 0;
}

void Tracking::accept(Vec vector, Vec) {
  on_owner([&] {
    const Unknowns u = read(vector);
    find_events(read(u_.get()), u);
    publish(u);
    tracked_.control = step_.control(u);
    tracked_.control_bound = step_.control_bound(u);
  });
  check(VecCopy(vector, u_.get()));
}

void Tracking::visit(StateVisitor& visitor) {
  visitor.visit("states and signs", Belongs::state, u_.get());
  std::vector<double> control = {tracked_.control, tracked_.control_bound};
  visitor.visit("control", Belongs::rank, control, 2);
  tracked_.control = control[0];
  tracked_.control_bound = control[1];
  if (!visitor.replaces()) return;
  events_.clear();
  if (mine()) publish(read(u_.get()));
}

void Tracking::publish(const Unknowns& u) {
  tracked_.s = u[S];
  tracked_.v = u[V];
  tracked_.s_ref = u[SREF];
  tracked_.v_ref = u[VREF];
  const Physical plant = to_physical({u[S], u[V]}, problem_.plant.kappa);
  const Physical reference = to_physical({u[SREF], u[VREF]}, problem_.reference.kappa);
  tracked_.x = plant.x;
  tracked_.velocity = plant.velocity;
  tracked_.x_ref = reference.x;
  tracked_.velocity_ref = reference.velocity;
  for (int i = 0; i < 6; ++i)
    tracked_.lambda[static_cast<std::size_t>(i)] = u[LS + i];
}

// An impact: s reaches zero, or passes it. x' jumps by (1 - kappa)|v| + (1 + kappa)|v|.
void Tracking::find_events(const Unknowns& old, const Unknowns& now) {
  events_.clear();
  for (const int wall : {0, 1}) {
    const int s = wall == 0 ? S : SREF;
    const bool hit = old[s] != 0.0 && sign(now[s]) != sign(old[s]);
    const bool left = old[s] == 0.0 && old[s + 1] == 0.0 && now[s] != 0.0;
    if (hit) events_.push_back({wall, Side::lower, 2, true, 2.0 * std::abs(now[s + 1])});
    if (left) events_.push_back({wall, Side::lower, 2, false, 0.0});
  }
}

PetscInt Tracking::active() const {
  if (!mine()) return 0;
  return (tracked_.s == 0.0 ? 1 : 0) + (tracked_.s_ref == 0.0 ? 1 : 0);
}

}  // namespace

std::unique_ptr<TrackingDvi> make_tracking_dvi(MPI_Comm comm, const TrackingProblem& problem,
                                               const TrackingOptions& options) {
  return std::make_unique<Tracking>(comm, problem, options);
}

}  // namespace sweepvi
