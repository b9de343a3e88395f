#include "io/unresolved_signals.hpp"

#include <algorithm>
#include <cmath>
#include <variant>

namespace sweepvi {

namespace {

struct Counter {
  double h;
  std::int64_t count = 0;
  double fastest = 0.0;

  void see(const Signal& signal) {
    const double frequency = std::abs(signal.frequency);
    if (!signal.varies() || !(frequency * h > most_periods_in_step)) return;
    ++count;
    fastest = std::max(fastest, frequency);
  }
  void see(const std::vector<Signal>& signals) {
    for (const Signal& signal : signals)
      see(signal);
  }

  void operator()(const LinearSpec& model) { see(model.f); }
  void operator()(const LagrangianSpec& model) { see(model.f); }
  void operator()(const SweepingSpec& model) {
    for (const auto* signals : {&model.f, &model.lower, &model.upper, &model.g})
      see(*signals);
  }
  void operator()(const ImpactSpec& model) {
    see(model.force);
    if (model.reference) see(model.reference->force);
  }
  void operator()(const ChainSpec& model) {
    for (const auto& force : model.forces)
      see(force.values);
  }
};

}  // namespace

void find_unresolved_signals(MPI_Comm comm, Scene& scene) {
  if (scene.time.scheme == Scheme::hybrid) return;
  Counter counter{scene.time.step};
  std::visit(counter, scene.model);  // complete on rank 0
  MPI_Bcast(&counter.count, 1, MPI_INT64_T, 0, comm);
  MPI_Bcast(&counter.fastest, 1, MPI_DOUBLE, 0, comm);
  scene.time.unresolved_signals = counter.count;
  scene.time.fastest_signal = counter.fastest;
}

}  // namespace sweepvi
