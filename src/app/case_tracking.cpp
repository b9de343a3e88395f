#include <fmt/format.h>

#include <array>
#include <cmath>
#include <numeric>

#include "app/case.hpp"
#include "io/step_events.hpp"
#include "sweepvi/tracking.hpp"

namespace sweepvi::app {

namespace {

double largest(const Signal& force) {
  return std::abs(force.offset) + (force.varies() ? std::abs(force.amplitude) : 0.0);
}

/// A plant that tracks a reference; the scene's model with `regulator` and `reference`.
class TrackingCase final : public Case {
public:
  TrackingCase(MPI_Comm comm, const Scene& scene)
      : spec_(std::get<ImpactSpec>(scene.model)),
        dvi_(make_tracking_dvi(
            comm,
            {.plant = {spec_.kappa, spec_.x0, spec_.v0, spec_.force},
             .reference = {spec_.reference->kappa, spec_.reference->x0, spec_.reference->v0,
                           spec_.reference->force},
             .gains = *spec_.regulator},
            {.theta = scene.time.theta, .gamma = scene.time.gamma, .resample = spec_.resample})) {}

  Dvi& dvi() override { return *dvi_; }
  Recording recording(const OutputSpec& output) const override;
  std::string form() const override { return "states and signs"; }
  std::int64_t constraints() const override { return 2; }
  std::int64_t contact_changes() const override { return count_constraints(dvi_->events()); }
  StateOrder state_order() const override;
  Lines report(std::int64_t unknowns) const override;

private:
  using Read = std::function<void(const TrackingState&, double*)>;
  Quantity quantity(std::string name, std::string description, std::string units,
                    std::vector<std::string> names, Read read) const;

  ImpactSpec spec_;
  std::unique_ptr<TrackingDvi> dvi_;
};

// Rank 0 owns all there is.
Quantity TrackingCase::quantity(std::string name, std::string description, std::string units,
                                std::vector<std::string> names, Read read) const {
  Quantity quantity{
      .name = std::move(name), .description = std::move(description), .units = std::move(units)};
  quantity.total = static_cast<PetscInt>(names.size());
  quantity.names = std::move(names);
  int rank = 0;
  MPI_Comm_rank(dvi_->comm(), &rank);
  for (PetscInt i = 0; rank == 0 && i < quantity.total; ++i)
    quantity.positions.push_back(i);
  quantity.read = [this, rank, copy = std::move(read)](double* to) {
    if (rank == 0) copy(dvi_->tracked(), to);
  };
  return quantity;
}

// Rank 0 owns all unknowns.
StateOrder TrackingCase::state_order() const {
  StateOrder order;
  check(VecGetSize(dvi_->state(), &order.states.total));
  PetscInt local = 0;
  check(VecGetLocalSize(dvi_->state(), &local));
  order.states.mine.resize(static_cast<std::size_t>(local));
  std::iota(order.states.mine.begin(), order.states.mine.end(), 0);
  return order;
}

Recording TrackingCase::recording(const OutputSpec&) const {
  const auto put = [](std::initializer_list<double> values, double* to) {
    std::copy(values.begin(), values.end(), to);
  };
  Recording recording;
  recording.quantities = {
      quantity("/x", "positions of plant and reference, then their velocities, on the wall after the impact",
               "m, m/s", {"x", "x_ref", "x'", "x_ref'"},
               [put](const TrackingState& state, double* to) {
                 put({state.x, state.x_ref, state.velocity, state.velocity_ref}, to);
               }),
      quantity("/z", "the same, transformed", "m, m/s", {"s", "s_ref", "v", "v_ref"},
               [put](const TrackingState& state, double* to) {
                 put({state.s, state.s_ref, state.v, state.v_ref}, to);
               }),
      quantity("/lambda", "signs of s, v, s_ref, v_ref, s - s_ref, v - v_ref in the last step", "1",
               {"lambda_s", "lambda_v", "lambda_sref", "lambda_vref", "lambda_es", "lambda_ev"},
               [](const TrackingState& state, double* to) {
                 std::copy(state.lambda.begin(), state.lambda.end(), to);
               }),
      quantity("/u", "control in the step that ends at t", "m/s^2", {"u"},
               [](const TrackingState& state, double* to) { *to = state.control; })};
  recording.events = [this](double t) { return events_of(dvi_->events(), {0, 1}, t); };
  recording.impulse_units = "m/s";
  return recording;
}

Lines TrackingCase::report(std::int64_t unknowns) const {
  const auto [mu1, mu2] = *spec_.regulator;
  const auto mass = [](double kappa, const Signal& force) {
    return fmt::format("kappa = {:.6g} (e = {:.6g}), |force| at most {:.6g} m/s^2", kappa,
                       (1.0 - kappa) / (1.0 + kappa), largest(force));
  };
  const ImpactSpec::Reference& reference = *spec_.reference;
  const double bound =
      (1.0 + spec_.kappa) * (mu1 + mu2 + largest(reference.force) / (1.0 - reference.kappa)) +
      largest(spec_.force);
  Lines lines;
  lines.emplace_back("plant", mass(spec_.kappa, spec_.force));
  lines.emplace_back("reference", mass(reference.kappa, reference.force));
  lines.emplace_back("gains", fmt::format("mu1 = {:.6g}, mu2 = {:.6g} m/s^2: {}", mu1, mu2,
                                          tracking_gains_suffice(*spec_.regulator)
                                              ? "0 < mu2 < mu1, errors vanish in finite time off the wall"
                                              : "0 < mu2 < mu1 fails, errors need not vanish"));
  if (spec_.kappa != reference.kappa)
    lines.emplace_back("  restitution", "not the same: each bounce brings errors back");
  lines.emplace_back("control", fmt::format("|u| at most {:.6g} m/s^2", bound));
  lines.emplace_back("form", form());
  lines.emplace_back("unknowns", fmt::format("{} (4 states + 6 signs)", unknowns));
  return lines;
}

}  // namespace

std::unique_ptr<Case> make_tracking_case(MPI_Comm comm, Scene& scene) {
  return std::make_unique<TrackingCase>(comm, scene);
}

}  // namespace sweepvi::app
