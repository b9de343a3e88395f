#include <algorithm>

#include "dvi/level_state.hpp"
#include "hybrid/named_numbers.hpp"
#include "sweepvi/hybrid.hpp"

namespace sweepvi {

namespace {

/// A linear system with levels, stepped by HOMSP.
class LevelProcess final : public HybridProcess {
public:
  LevelProcess(ConstrainedDvi& dvi, const LinearSystem& system, const RelativeDegree& degree)
      : dvi_(dvi), system_(system), degree_(degree) {
    upper_.assign(degree.degree.size(), PETSC_INFINITY);
    if (!system.wmax) return;
    const ReadArray walls(system.wmax.get());
    std::copy_n(walls.data(), walls.size(), upper_.begin());
  }

  Dvi& dvi() override { return dvi_; }
  const LinearSystem& system() const override { return system_; }
  const RelativeDegree& degree() const override { return degree_; }

  void read(double, Vec x, std::vector<double>& z) override {
    check(VecCopy(dvi_.x(), x));
    if (degree_.lowest > 0) z = dvi_.z();
  }

  void write(Vec x, const std::vector<double>& z, const std::vector<double>& w,
             const std::vector<Side>& contact, const std::vector<double>& mu) override {
    const auto zero = [](std::span<double> values) { std::fill(values.begin(), values.end(), 0.0); };
    const auto width = static_cast<std::size_t>(dvi_.mu_levels());
    const std::size_t count = contact.size();
    NamedNumbers put(true,
                     {{"x",
                       [&](std::span<double> values) {
                         const ReadArray from(x);
                         std::copy_n(from.data(), from.size(), values.begin());
                       }},
                      {"z",
                       [&](std::span<double> values) {
                         for (std::size_t a = 0; a < count; ++a) {
                           values[a * width] = w[a];
                           for (int i = 1; i <= degree_.degree[a]; ++i)
                             values[a * width + static_cast<std::size_t>(i - 1)] = z[at(a, i)];
                         }
                       }},
                      {"mu",
                       [&](std::span<double> values) {
                         zero(values);
                         for (std::size_t a = 0; a < count; ++a)
                           values[a * width + static_cast<std::size_t>(last_level(a) - 1)] = mu[a];
                       }},
                      {"w", [&](std::span<double> values) { std::copy_n(w.begin(), count, values.begin()); }},
                      {"level",
                       [&](std::span<double> values) {
                         for (std::size_t a = 0; a < count; ++a)
                           values[a] = contact[a] == Side::none ? 1.0 : last_level(a);
                       }},
                      {"side",
                       [&](std::span<double> values) {
                         for (std::size_t a = 0; a < count; ++a)
                           values[a] = sign(contact[a]);
                       }},
                      {"nu", zero},
                      {"nu above", zero}});
    dvi_.visit(put);
  }

  std::vector<Side> in_contact() override {
    std::vector<Side> contact(upper_.size(), Side::none);
    const std::vector<double>& z = dvi_.z();
    for (std::size_t a = 0; a < contact.size() && degree_.lowest > 0; ++a) {
      const bool above = z[at(a, 1)] == upper_[a];
      bool rests = above || z[at(a, 1)] == 0.0;
      for (int i = 2; i <= degree_.degree[a]; ++i)
        rests = rests && z[at(a, i)] == 0.0;
      if (rests) contact[a] = above ? Side::upper : Side::lower;
    }
    return contact;
  }

  void tell(std::vector<StepEvent> events) override { dvi_.tell(std::move(events)); }

  // The gap closes without a measure, before this jump; what follows on the levels above does not.
  StepReport reset(StepSolver& solver, const Step& step, std::vector<char>& met) override {
    StepReport report = jump_of(dvi_, solver, step);
    if (!report.certified) return report;
    std::vector<StepEvent> events;
    for (const StepEvent& event : dvi_.events()) {
      char& told = met[static_cast<std::size_t>(event.constraint)];
      if (event.level > 1 && told == 0) events.push_back({event.constraint, event.side, 1, true, 0.0});
      if (event.level > 1 || told == 0) events.push_back(event);
      told = 1;
    }
    dvi_.tell(std::move(events));
    return report;
  }

private:
  int last_level(std::size_t a) const { return std::max(1, degree_.degree[a]); }
  std::size_t at(std::size_t a, int level) const {
    return static_cast<std::size_t>(degree_.first_level[a]) + static_cast<std::size_t>(level - 1);
  }

  ConstrainedDvi& dvi_;
  const LinearSystem& system_;
  const RelativeDegree& degree_;
  std::vector<double> upper_;
};

}  // namespace

std::unique_ptr<HybridProcess> make_hybrid(ConstrainedDvi& dvi, const LinearSystem& system,
                                           const RelativeDegree& degree) {
  return std::make_unique<LevelProcess>(dvi, system, degree);
}

}  // namespace sweepvi
