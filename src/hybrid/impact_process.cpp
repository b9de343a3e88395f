#include <algorithm>
#include <cmath>
#include <limits>

#include "hybrid/named_numbers.hpp"
#include "sweepvi/hybrid.hpp"
#include "sweepvi/impact_oscillators.hpp"

namespace sweepvi {

namespace {

/// Impact oscillators without a regulator, stepped in (s, v). Between impacts they are linear in (x, x'); at
/// an impact s and v go on as they are, s through 0 to the other sign: x'+ = -e x'-, and nothing is to be
/// solved.
class ImpactProcess final : public HybridProcess {
public:
  ImpactProcess(ImpactDvi& dvi, const ImpactOscillators& oscillators, const LinearSystem& system)
      : dvi_(dvi),
        system_(system),
        degree_(analyse_relative_degree(system)),
        kappa_(oscillators.kappa()),
        side_(kappa_.size(), 1.0) {}

  Dvi& dvi() override { return dvi_; }
  const LinearSystem& system() const override { return system_; }
  const RelativeDegree& degree() const override { return degree_; }

  void read(double, Vec x, std::vector<double>& z) override {
    const ReadArray s(dvi_.s());
    const ReadArray v(dvi_.v());
    const WriteArray pairs(x);
    for (std::size_t i = 0; i < kappa_.size(); ++i) {
      const auto k = static_cast<PetscInt>(i);
      const Physical now = to_physical({s[k], v[k]}, kappa_[i]);
      if (s[k] != 0.0 || v[k] != 0.0) side_[i] = std::copysign(1.0, s[k] != 0.0 ? s[k] : v[k]);
      pairs[2 * k] = z[2 * i] = now.x;
      pairs[2 * k + 1] = z[2 * i + 1] = now.velocity;
    }
  }

  void write(Vec, const std::vector<double>& z, const std::vector<double>&, const std::vector<Side>& contact,
             const std::vector<double>&) override {
    z_ = z;
    contact_ = contact;
    put();
  }

  std::vector<Side> in_contact() override {
    const ReadArray s(dvi_.s());
    const ReadArray v(dvi_.v());
    std::vector<Side> contact(kappa_.size(), Side::none);
    for (std::size_t i = 0; i < kappa_.size(); ++i)
      if (s[static_cast<PetscInt>(i)] == 0.0 && v[static_cast<PetscInt>(i)] == 0.0) contact[i] = Side::lower;
    return contact;
  }

  // (x, x') of each oscillator.
  void show_states(StateVisitor& visitor, const char* name, std::vector<double>& numbers) override {
    visitor.visit(name, Belongs::constraint, numbers, 2);
  }

  void tell(std::vector<StepEvent> events) override { dvi_.tell(std::move(events)); }

  StepReport reset(StepSolver&, const Step&, std::vector<char>& met) override {
    std::vector<StepEvent> impacts;
    for (std::size_t i = 0; i < kappa_.size(); ++i) {
      double& velocity = z_[2 * i + 1];
      if (z_[2 * i] > 0.0 || velocity >= 0.0) continue;
      const double v = velocity / (1.0 + kappa_[i]);
      impacts.push_back({static_cast<PetscInt>(i), Side::lower, 2, true, 2.0 * std::abs(v)});
      met[i] = 1;
      dissipated_ += 2.0 * kappa_[i] * v * v;
      velocity = -(1.0 - kappa_[i]) * v;
      side_[i] = -side_[i];
    }
    put();
    dvi_.tell(std::move(impacts));
    StepReport report;
    report.certified = true;
    return report;
  }

private:
  // At s = 0 the Dvi knows only the velocity after an impact: before it, s is the least there is.
  void put() {
    constexpr double nearly_zero = std::numeric_limits<double>::min();
    NamedNumbers numbers(
        true, {{"s, v and signs",
                [&](std::span<double> u) {
                  for (std::size_t i = 0; i < kappa_.size(); ++i) {
                    const double x = z_[2 * i], velocity = z_[2 * i + 1];
                    const Transformed here = to_transformed({x, velocity}, kappa_[i]);
                    const bool rests = contact_[i] != Side::none;
                    const double s = x == 0.0 && velocity < 0.0 ? nearly_zero : here.s;
                    u[4 * i] = rests ? 0.0 : side_[i] * s;
                    u[4 * i + 1] = rests ? 0.0 : side_[i] * here.v;
                    u[4 * i + 2] = rests ? 0.0 : side_[i];
                    u[4 * i + 3] = rests ? 0.0 : std::copysign(here.v == 0.0 ? 0.0 : 1.0, side_[i] * here.v);
                  }
                }},
               {"dissipated", [&](std::span<double> sum) {
                  sum[0] += dissipated_;
                  dissipated_ = 0.0;
                }}});
    dvi_.visit(numbers);
  }

  ImpactDvi& dvi_;
  const LinearSystem& system_;
  RelativeDegree degree_;
  std::vector<double> kappa_, side_;  // side: sgn(s)
  std::vector<double> z_;
  std::vector<Side> contact_;
  double dissipated_ = 0.0;
};

}  // namespace

std::unique_ptr<HybridProcess> make_hybrid(ImpactDvi& dvi, const ImpactOscillators& oscillators,
                                           const LinearSystem& system) {
  return std::make_unique<ImpactProcess>(dvi, oscillators, system);
}

}  // namespace sweepvi
