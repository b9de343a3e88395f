#include <algorithm>

#include "hybrid/named_numbers.hpp"
#include "petsc/sparse.hpp"
#include "sweepvi/hybrid.hpp"
#include "sweepvi/lagrangian.hpp"

namespace sweepvi {

namespace {

/// A mechanical system with restitution, stepped by Moreau and Jean's scheme.
class MechanicalProcess final : public HybridProcess {
public:
  MechanicalProcess(MechanicalDvi& dvi, const LagrangianSystem& system)
      : dvi_(dvi), system_(first_order_form(system)), degree_(analyse_relative_degree(system_)) {}

  Dvi& dvi() override { return dvi_; }
  const LinearSystem& system() const override { return system_; }
  const RelativeDegree& degree() const override { return degree_; }
  bool keeps_positions() const override { return true; }

  void read(double, Vec x, std::vector<double>& z) override {
    {
      const ReadArray q(dvi_.position());
      const ReadArray v(dvi_.velocity());
      const WriteArray pairs(x);
      for (PetscInt j = 0; j < q.size(); ++j) {
        pairs[2 * j] = q[j];
        pairs[2 * j + 1] = v[j];
      }
    }
    NamedNumbers take(false, {{"gap", [&](std::span<double> gap) { spread(gap, 0, z); }},
                              {"gap velocity", [&](std::span<double> rate) { spread(rate, 1, z); }}});
    dvi_.visit(take);
  }

  void write(Vec x, const std::vector<double>& z, const std::vector<double>&,
             const std::vector<Side>& contact, const std::vector<double>& mu) override {
    const auto part_of_x = [&](PetscInt first) {
      return [=](std::span<double> values) {
        const ReadArray pairs(x);
        for (std::size_t j = 0; j < values.size(); ++j)
          values[j] = pairs[2 * static_cast<PetscInt>(j) + first];
      };
    };
    const auto part_of_z = [&](std::size_t first) {
      return [&, first](std::span<double> values) {
        for (std::size_t a = 0; a < values.size(); ++a)
          values[a] = z[2 * a + first];
      };
    };
    const auto of_contact = [&](double open, double closed) {
      return [&, open, closed](std::span<double> values) {
        for (std::size_t a = 0; a < values.size(); ++a)
          values[a] = contact[a] == Side::none ? open : closed;
      };
    };
    NamedNumbers put(
        true, {{"q", part_of_x(0)},
               {"v", part_of_x(1)},
               {"gap", part_of_z(0)},
               {"gap velocity", part_of_z(1)},
               {"level", of_contact(1.0, 2.0)},
               {"contact", of_contact(0.0, 1.0)},
               {"side", of_contact(0.0, 1.0)},
               {"mu",
                [&](std::span<double> values) {
                  for (std::size_t a = 0; a < mu.size(); ++a) {
                    values[2 * a] = 0.0;
                    values[2 * a + 1] = mu[a];
                  }
                }},
               {"nu", [](std::span<double> values) { std::fill(values.begin(), values.end(), 0.0); }}});
    dvi_.visit(put);
  }

  std::vector<Side> in_contact() override {
    std::vector<Side> contact(degree_.degree.size(), Side::none);
    NamedNumbers take(false, {{"contact", [&](std::span<double> flags) {
                                 for (std::size_t a = 0; a < flags.size(); ++a)
                                   if (flags[a] != 0.0) contact[a] = Side::lower;
                               }}});
    dvi_.visit(take);
    return contact;
  }

  void tell(std::vector<StepEvent> events) override { dvi_.tell(std::move(events)); }

  StepReport reset(StepSolver& solver, const Step& step, std::vector<char>& met) override {
    StepReport report = jump_of(dvi_, solver, step);
    for (const StepEvent& event : dvi_.events())
      met[static_cast<std::size_t>(event.constraint)] = 1;
    return report;
  }

  // (q, v) of each coordinate.
  void show_states(StateVisitor& visitor, const char* name, std::vector<double>& numbers) override {
    visitor.visit(name, Belongs::state, numbers, 2);
  }

private:
  static void spread(std::span<double> from, std::size_t first, std::vector<double>& z) {
    for (std::size_t a = 0; a < from.size(); ++a)
      z[2 * a + first] = from[a];
  }

  MechanicalDvi& dvi_;
  LinearSystem system_;
  RelativeDegree degree_;
};

}  // namespace

std::unique_ptr<HybridProcess> make_hybrid(MechanicalDvi& dvi, const LagrangianSystem& system) {
  return std::make_unique<MechanicalProcess>(dvi, system);
}

}  // namespace sweepvi
