#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "app/case.hpp"
#include "io/impact_recording.hpp"
#include "model/chain.hpp"
#include "sweepvi/impact_oscillators.hpp"
#include "sweepvi/partition.hpp"

namespace sweepvi::app {

namespace {

/// The chain a scene describes; a single oscillator is a chain of one.
ChainSpec take_chain(Scene& scene) {
  if (auto* chain = std::get_if<ChainSpec>(&scene.model)) return std::exchange(*chain, ChainSpec{});
  const auto& one = std::get<ImpactSpec>(scene.model);
  const Element& element = *find_element("zhuravlev-ivanov");
  ChainSpec chain = ChainSpec::of(element, 1);
  chain.keys[*element.kappa] = {{one.kappa}};
  chain.forces.front() = {{one.force}};
  chain.regulator = one.regulator;
  chain.x0 = {one.x0, one.v0};
  return chain;
}

ImpactOptions options_of(const Scene& scene, const ChainSpec& chain) {
  const auto* one = std::get_if<ImpactSpec>(&scene.model);
  return {.theta = scene.time.theta,
          .gamma = scene.time.gamma,
          .regulator = chain.regulator,
          .resample = one != nullptr && one->resample};
}

std::pair<double, double> bounds_of(const std::vector<double>& values) {
  const auto [least, most] = std::minmax_element(values.begin(), values.end());
  return {*least, *most};
}

std::string range_text(double least, double most) {
  return least == most ? fmt::format("{:.6g}", least) : fmt::format("{:.6g} to {:.6g}", least, most);
}

/// Impact oscillators in (s, v), one or a chain: zhuravlev-ivanov.
class ImpactCase final : public Case {
public:
  ImpactCase(MPI_Comm comm, Scene& scene) {
    const ChainSpec chain = take_chain(scene);
    options_ = options_of(scene, chain);
    const auto* one = std::get_if<ImpactSpec>(&scene.model);
    if (scene.time.scheme == Scheme::hybrid &&
        (options_.regulator || options_.resample || (one != nullptr && one->reference)))
      throw InputError(
          "the scheme hybrid takes no regulator, reference or resample: a controller acts once in each step. "
          "Use "
          "zhuravlev-ivanov");
    const PerElement<double>& kappa = chain.keys[*chain.element->kappa];
    kappa_ = bounds_of(kappa.values);
    for (const PerElement<Signal>& forces : chain.forces)
      for (const Signal& force : forces.values)
        force_ = std::max(force_, std::abs(force.offset) + std::abs(force.amplitude));
    springs_ = chain.weights || (chain.coupling != 0.0 && chain.count > 1);

    system_ = make_chain(comm, chain);
    RelativeDegree degree = analyse_relative_degree(system_);
    distribute(system_, degree);
    std::vector<double> own_kappa;
    for (const PetscInt number : system_.constraint_order)
      own_kappa.push_back(kappa[number]);
    oscillators_ = make_impact_oscillators(system_, std::move(own_kappa));
    dvi_ = make_impact_dvi(*oscillators_, scene.time.grid(), options_);
    if (scene.time.scheme == Scheme::hybrid) hybrid_ = make_hybrid(*dvi_, *oscillators_, system_);
  }

  Dvi& dvi() override { return *dvi_; }
  HybridProcess* hybrid() override { return hybrid_.get(); }
  Recording recording(const OutputSpec& output) const override {
    return impact_recording(output, system_, *oscillators_, *dvi_);
  }
  std::string form() const override { return "s, v and their signs"; }
  std::int64_t constraints() const override { return system_.constraints(); }
  std::int64_t edge_cut() const override { return system_.edge_cut; }
  std::int64_t contact_changes() const override { return count_constraints(dvi_->events()); }
  StateOrder state_order() const override { return {{}, {system_.constraint_order, system_.constraints()}}; }
  Lines report(std::int64_t unknowns) const override;

private:
  std::string gains_text() const;

  ImpactOptions options_;
  std::pair<double, double> kappa_;  // least and most
  double force_ = 0.0;               // bound on all
  bool springs_ = false;
  LinearSystem system_;
  std::unique_ptr<ImpactOscillators> oscillators_;
  std::unique_ptr<ImpactDvi> dvi_;
  std::unique_ptr<HybridProcess> hybrid_;
};

/// HO's condition, which is sufficient for rest in finite time, not necessary.
std::string ImpactCase::gains_text() const {
  const Regulator& gains = *options_.regulator;
  const bool suffice = gains_suffice(gains, force_);
  return fmt::format(
      "mu1 = {:.6g}, mu2 = {:.6g}; |force| <= M = {:.6g}: the gain condition M < mu2 < mu1 - M "
      "{}{}",
      gains.mu1, gains.mu2, force_,
      suffice ? "holds, rest is reached in finite time" : "does not hold, rest is not guaranteed",
      springs_ ? " (springs are not counted in M)" : "");
}

Lines ImpactCase::report(std::int64_t unknowns) const {
  const auto restitution = [](double kappa) { return (1.0 - kappa) / (1.0 + kappa); };
  const std::int64_t count = system_.constraints();
  Lines lines;
  lines.emplace_back("sizes", fmt::format("{} oscillator{}{}", count, count == 1 ? "" : "s",
                                          count == 1 ? ""
                                          : springs_ ? ", with springs"
                                                     : ", not coupled"));
  lines.emplace_back("restitution",
                     fmt::format("e = {}, from kappa = {}",
                                 range_text(restitution(kappa_.second), restitution(kappa_.first)),
                                 range_text(kappa_.first, kappa_.second)));
  if (options_.regulator) lines.emplace_back("regulator", gains_text());
  lines.emplace_back(
      "time stepping",
      fmt::format("theta = {} for states, gamma = {} for signs{}", options_.theta, options_.gamma,
                  options_.resample ? ", (s, v) anew from (x, x') before each step" : ""));
  lines.emplace_back("form", form());
  lines.emplace_back("unknowns", fmt::format("{} (4 per oscillator)", unknowns));
  return lines;
}

}  // namespace

std::unique_ptr<Case> make_impact_case(MPI_Comm comm, Scene& scene) {
  return std::make_unique<ImpactCase>(comm, scene);
}

}  // namespace sweepvi::app
