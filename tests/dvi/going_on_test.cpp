// A process that is given the state of an earlier moment goes on as if nothing had happened, to the last bit:
// it, its solver and its predictor remember nothing else. Every kind of process, every way to solve its
// steps.
//
// labels: long
// timeout: 300
#include <gtest/gtest.h>

#include <array>
#include <cstdlib>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "../examples/pendulum_chain/pendulum_chain.hpp"
#include "../examples/pendulum_walls/pendulum_walls.hpp"
#include "app/case.hpp"
#include "dvi/systems.hpp"
#include "sweepvi/nonlinear_lagrangian.hpp"

namespace sweepvi::test {
namespace {

using Words = std::vector<std::string>;

/// A process, with all that must outlive it.
struct Process {
  std::shared_ptr<void> owner;
  Dvi* dvi = nullptr;
  TimeGrid grid;
};
using Make = std::function<Process()>;

/// All numbers that a process shows, of this rank.
class Numbers final : public StateVisitor {
public:
  using StateVisitor::visit;
  bool replaces() const override { return false; }
  void visit(const char*, Belongs, std::span<double> values, std::size_t) override {
    all.insert(all.end(), values.begin(), values.end());
  }
  std::vector<double> all;
};

/// What a march leaves: for each of its steps how it was solved, at the end the state.
struct Trace {
  struct Solved {
    PetscInt iterations;
    int attempts;
    double residual;
    bool operator==(const Solved&) const = default;
  };
  std::vector<Solved> steps;
  std::vector<double> end;
};

using AtStep = std::function<void(PetscInt number)>;

Trace march(const Process& process, PetscInt done, const AtStep& at_step) {
  Trace trace;
  TimeMarch time_march(*process.dvi, process.grid, done);
  time_march.observe([&](const Step& step, const StepReport& report) {
    trace.steps.push_back({report.iterations, report.attempts, report.residual});
    at_step(step.number);
  });
  EXPECT_TRUE(time_march.run().certified);
  EXPECT_EQ(time_march.steps_taken(), process.grid.steps);
  Numbers numbers;
  process.dvi->visit(numbers);
  trace.end = numbers.all;
  return trace;
}

void expect_to_go_on(const Make& make) {
  const Process process = make();
  const PetscInt steps = process.grid.steps;
  const std::array<PetscInt, 3> stops = {steps / 7, steps / 2, steps - steps / 7};
  std::array<StateSnapshot, stops.size()> snapshots;
  const Trace whole = march(process, 0, [&](PetscInt number) {
    for (std::size_t i = 0; i < stops.size(); ++i)
      if (stops[i] == number) snapshots[i].take(*process.dvi);
  });
  for (std::size_t i = 0; i < stops.size(); ++i) {
    SCOPED_TRACE("from step " + std::to_string(stops[i]));
    const Process again = make();
    snapshots[i].put_back(*again.dvi);
    const Trace rest = march(again, stops[i], [](PetscInt) {});
    EXPECT_EQ(rest.end, whole.end);
    ASSERT_LE(rest.steps.size(), whole.steps.size());
    EXPECT_TRUE(std::equal(rest.steps.begin(), rest.steps.end(),
                           whole.steps.end() - static_cast<std::ptrdiff_t>(rest.steps.size())));
  }
}

Make example(const std::string& scene, const Words& settings = {}) {
  return [=] {
    struct Owner {
      Scene scene;
      std::unique_ptr<app::Case> model;
    };
    app::CommandLine line;
    line.scene = std::string(std::getenv("SWEEPVI_SOURCE")) + "/examples/" + scene;
    Words words = {"run", line.scene};
    for (const std::string& setting : settings)
      words.insert(words.end(), {"--set", setting});
    line = app::parse_command_line(words);
    auto owner = std::make_shared<Owner>(Owner{app::load(PETSC_COMM_WORLD, line), nullptr});
    const TimeGrid grid = owner->scene.time.grid();
    owner->model = app::make_case(PETSC_COMM_WORLD, owner->scene);
    return Process{owner, &owner->model->dvi(), grid};
  };
}

/// By the predictor, by SNESVI of either type.
struct Way {
  const char *predictor, *type;
};
constexpr std::array ways = {Way{"active-set", SNESVINEWTONRSLS}, Way{"none", SNESVINEWTONRSLS},
                             Way{"none", SNESVINEWTONSSLS}};

void expect_to_go_on_in_all_ways(const Make& make) {
  for (const Way& way : ways) {
    SCOPED_TRACE(std::string(way.predictor) + " " + way.type);
    const ScopedOption predictor("-sweepvi_predictor", way.predictor);
    const ScopedOption type("-snes_type", way.type);
    expect_to_go_on(make);
  }
}

TEST(GoingOn, LevelsInBothForms) {
  const Words few = {"model.count=5", "time.step=5e-2", "time.end=3"};
  for (const char* form : {"box-on-z", "primal-dual"}) {
    SCOPED_TRACE(form);
    const ScopedOption chosen("-sweepvi_form", form);
    expect_to_go_on_in_all_ways(example("jerk_chain/scene.toml", few));
    expect_to_go_on(example("forced_chain/scene.toml", {"time.step=0.2"}));
    expect_to_go_on(example("flexible_chain/scene.toml", few));
  }
}

TEST(GoingOn, SharedInputsAndUpperWalls) {
  expect_to_go_on_in_all_ways(example("shared_input/scene.toml", {"time.step=6e-2"}));
  expect_to_go_on(example("two_walls/scene.toml", {"time.step=4e-2"}));
  expect_to_go_on(example("falling_column/scene.toml", {"model.count=7", "time.step=4e-2", "time.end=4"}));
  expect_to_go_on(example("diode_ladder/scene.toml", {"time.end=0.01"}));
}

TEST(GoingOn, ImpactsByMoreauAndJean) {
  expect_to_go_on_in_all_ways(example("elastic_bar/scene.toml", {"time.step=6e-2"}));
  expect_to_go_on(example("newtons_cradle/apart.toml", {"time.step=2e-2"}));
  expect_to_go_on(example("ball/scene.toml", {"time.step=6e-2"}));
}

TEST(GoingOn, MovingSets) {
  expect_to_go_on_in_all_ways(example("moving_polygon/scene.toml", {"time.step=3e-2"}));
  expect_to_go_on(example("sweeping_chain/scene.toml", {"time.step=1e-2"}));
  expect_to_go_on(example("play_operator/scene.toml", {"time.step=5e-2"}));
}

TEST(GoingOn, ImpactOscillators) {
  const Words few = {"model.count=5", "time.step=2e-2"};
  expect_to_go_on_in_all_ways(example("zi_chain/scene.toml", few));
  const ScopedOption sweeps("-sweepvi_zi_sweeps", "0");  // all left to predictor and SNESVI
  expect_to_go_on_in_all_ways(example("zi_chain/scene.toml", few));
  expect_to_go_on(example("zi_regulator/scene.toml", {"time.step=1e-2"}));
}

TEST(GoingOn, Tracking) {
  expect_to_go_on(example("zi_tracking/scene.toml", {"time.step=1e-2"}));
}

TEST(GoingOn, NonlinearSystems) {
  const TimeGrid grid{0.0, 1.5, 60};
  struct Chain {
    PendulumChain system;
    std::unique_ptr<ConstrainedDvi> dvi;
  };
  struct Walls {
    PendulumWalls system;
    std::unique_ptr<MechanicalDvi> dvi;
  };
  for (const bool own : {true, false}) {
    SCOPED_TRACE(own ? "own Jacobian" : "finite differences");
    expect_to_go_on([&] {
      auto owner =
          std::make_shared<Chain>(Chain{{PETSC_COMM_WORLD, {.count = 5, .own_jacobian = own}}, nullptr});
      owner->dvi = make_zd_dvi(owner->system, grid);
      return Process{owner, owner->dvi.get(), grid};
    });
    expect_to_go_on([&] {
      auto owner =
          std::make_shared<Walls>(Walls{{PETSC_COMM_WORLD, {.count = 4, .own_jacobian = own}}, nullptr});
      owner->dvi = make_moreau_jean(owner->system, {.theta = 0.5}, grid);
      return Process{owner, owner->dvi.get(), grid};
    });
  }
}

}  // namespace
}  // namespace sweepvi::test
