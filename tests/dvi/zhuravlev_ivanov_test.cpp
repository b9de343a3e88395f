// ranks: 1 2 3
// several: *-ZhuravlevIvanov.RandomBallsConverge:ZhuravlevIvanov.*OrderOne:ZhuravlevIvanov.Ball*
// three: Chain.*
// timeout: 240

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <random>
#include <sstream>

#include "dvi/impact_branch.hpp"
#include "dvi/systems.hpp"
#include "model/chain.hpp"
#include "parallel/gather.hpp"
#include "petsc/sparse.hpp"
#include "sweepvi/impact_oscillators.hpp"
#include "sweepvi/partition.hpp"

namespace sweepvi::test {
namespace {

/// Oscillators with springs to the next ones (and no ends), drag, and forces that may depend on x and x' in
/// any way; dealt out in order.
class Oscillators final : public ImpactOscillators {
public:
  struct Spec {
    std::vector<double> kappa, x0, v0;
    double spring = 0.0;
    /// The force on oscillator i, and its derivatives by x and x'; empty: differences are taken.
    std::function<double(double t, PetscInt i, double x, double velocity)> force;
    std::function<std::pair<double, double>(double t, PetscInt i, double x, double velocity)> derivatives =
        {};
    bool linear = true;
    bool reads_velocities = false;
  };
  Oscillators(MPI_Comm comm, Spec spec) : comm_(comm), spec_(std::move(spec)) {
    auto total = static_cast<PetscInt>(spec_.kappa.size());
    check(PetscSplitOwnership(comm, &count_, &total));
    total_ = total;
    springs_ = springs();
    first_ = row_range(springs_.get()).first;
  }

  std::vector<double> kappa() const override {
    return {spec_.kappa.begin() + first_, spec_.kappa.begin() + first_ + count_};
  }
  void start(Vec x, Vec velocity) const override {
    const WriteArray positions(x);
    const WriteArray velocities(velocity);
    std::copy_n(spec_.x0.begin() + first_, count_, positions.data());
    std::copy_n(spec_.v0.begin() + first_, count_, velocities.data());
  }
  void acceleration(double t, Vec x, Vec velocity, Vec a) const override {
    check(MatMult(springs_.get(), x, a));
    const ReadArray positions(x);
    const ReadArray velocities(velocity);
    const WriteArray sum(a);
    for (PetscInt i = 0; i < count_; ++i)
      sum[i] += spec_.force(t, first_ + i, positions[i], velocities[i]);
  }
  Matrix pattern() const override { return springs(); }
  bool jacobian(double t, Vec x, Vec velocity, Mat by_x, Mat by_velocity) const override {
    if (!spec_.derivatives) return false;
    check(MatCopy(springs_.get(), by_x, SAME_NONZERO_PATTERN));
    const ReadArray positions(x);
    const ReadArray velocities(velocity);
    for (PetscInt i = 0; i < count_; ++i) {
      const auto [along_x, along_velocity] = spec_.derivatives(t, first_ + i, positions[i], velocities[i]);
      check(MatSetValue(by_x, first_ + i, first_ + i, along_x, ADD_VALUES));
      if (by_velocity != nullptr)
        check(MatSetValue(by_velocity, first_ + i, first_ + i, along_velocity, ADD_VALUES));
    }
    return true;
  }
  bool linear() const override { return spec_.linear; }
  bool reads_velocities() const override { return spec_.reads_velocities; }

private:
  Matrix springs() const {
    PetscInt last = 0;
    MPI_Scan(&count_, &last, 1, MPIU_INT, MPI_SUM, comm_);
    RowBuilder rows;
    for (PetscInt i = last - count_; i < last; ++i) {
      rows.add(i, 0.0);
      for (const PetscInt j : {i - 1, i + 1}) {
        if (j < 0 || j >= total_) continue;
        rows.add(j, spec_.spring);
        rows.add(i, -spec_.spring);
      }
      rows.end_row();
    }
    return rows.finish(comm_, count_);
  }

  MPI_Comm comm_;
  Spec spec_;
  PetscInt count_ = PETSC_DECIDE, total_ = 0, first_ = 0;
  Matrix springs_;
};

constexpr double gravity = 9.81;

Oscillators::Spec balls(std::vector<double> kappa, std::vector<double> x0, std::vector<double> v0) {
  return {.kappa = std::move(kappa),
          .x0 = std::move(x0),
          .v0 = std::move(v0),
          .force = [](double, PetscInt, double, double) { return -gravity; },
          .derivatives =
              [](double, PetscInt, double, double) {
                return std::pair{0.0, 0.0};
              }};
}

/// What a run leaves at each step, from the start on, on every rank.
struct History {
  std::vector<double> t;
  std::vector<std::vector<double>> x, velocity, s, v, lambda_s, lambda_v;
  PetscInt iterations = 0, predicted = 0, impacts = 0, lift_offs = 0;
  StepSolver::Rungs rungs{};
  double residual = 0.0, dissipated = 0.0, kinetic = 0.0;
  bool certified = false;
};

/// Whole vectors of one layout on every rank.
class Everywhere {
public:
  explicit Everywhere(Vec layout) : comm_(PetscObjectComm(reinterpret_cast<PetscObject>(layout))) {
    PetscInt local = 0;
    check(VecGetLocalSize(layout, &local));
    int ranks = 1;
    MPI_Comm_size(comm_, &ranks);
    counts_.resize(static_cast<std::size_t>(ranks));
    const int mine = static_cast<int>(local);
    MPI_Allgather(&mine, 1, MPI_INT, counts_.data(), 1, MPI_INT, comm_);
    starts_ = starts_of_pieces(counts_);
  }
  std::vector<double> operator()(Vec vector) const {
    const ReadArray mine(vector);
    std::vector<double> all(static_cast<std::size_t>(starts_.back() + counts_.back()));
    MPI_Allgatherv(mine.data(), static_cast<int>(mine.size()), MPI_DOUBLE, all.data(), counts_.data(),
                   starts_.data(), MPI_DOUBLE, comm_);
    return all;
  }

private:
  MPI_Comm comm_;
  std::vector<int> counts_, starts_;
};

/// @param meddle  called after each step
History march(const ImpactOscillators& oscillators, const TimeGrid& grid, const ImpactOptions& options = {},
              const std::function<void(const Step&, ImpactDvi&)>& meddle = {}) {
  const auto dvi = make_impact_dvi(oscillators, grid, options);
  const Everywhere everywhere(dvi->x());
  History run;
  std::array<PetscInt, 2> counts{};
  const auto record = [&](double t) {
    run.t.push_back(t);
    run.x.push_back(everywhere(dvi->x()));
    run.velocity.push_back(everywhere(dvi->velocity()));
    run.s.push_back(everywhere(dvi->s()));
    run.v.push_back(everywhere(dvi->v()));
    run.lambda_s.push_back(everywhere(dvi->lambda_s()));
    run.lambda_v.push_back(everywhere(dvi->lambda_v()));
    for (const StepEvent& event : dvi->events())
      ++counts[event.impact ? 0 : 1];
  };
  record(grid.start);
  TimeMarch time_march(*dvi, grid);
  time_march.observe([&](const Step& step, const StepReport& report) {
    record(step.t_new);
    run.iterations += report.iterations;
    run.predicted += report.predicted ? 1 : 0;
    ++run.rungs[static_cast<std::size_t>(report.rung)];
    run.residual = std::max(run.residual, report.residual);
    if (meddle) meddle(step, *dvi);
  });
  run.certified = time_march.run().certified && time_march.steps_taken() == grid.steps;
  MPI_Allreduce(MPI_IN_PLACE, counts.data(), 2, MPIU_INT, MPI_SUM, dvi->comm());
  run.impacts = counts[0];
  run.lift_offs = counts[1];
  std::array<double, 2> sums = {dvi->dissipated(), dvi->kinetic()};
  MPI_Allreduce(MPI_IN_PLACE, sums.data(), 2, MPI_DOUBLE, MPI_SUM, dvi->comm());
  run.dissipated = sums[0];
  run.kinetic = sums[1];
  return run;
}

/// The largest |a - b| over steps and oscillators.
double difference(const std::vector<std::vector<double>>& a, const std::vector<std::vector<double>>& b,
                  double factor = 1.0) {
  EXPECT_EQ(a.size(), b.size());
  double worst = 0.0;
  for (std::size_t k = 0; k < std::min(a.size(), b.size()); ++k)
    for (std::size_t i = 0; i < a[k].size(); ++i)
      worst = std::max(worst, std::abs(a[k][i] - factor * b[k][i]));
  return worst;
}

double sign(double value) {
  return value > 0.0 ? 1.0 : value < 0.0 ? -1.0 : 0.0;
}

/// A ball thrown from x0 >= 0 with v0 over its wall, in closed form: bounce by bounce, at rest after the
/// last.
class Ball {
public:
  Ball(double kappa, double x0, double v0) : e_((1.0 - kappa) / (1.0 + kappa)), x0_(x0), v0_(v0) {
    const double down = std::sqrt(v0 * v0 + 2.0 * gravity * x0);  // speed at the first impact
    first_ = (v0 + down) / gravity;
    rise_ = e_ * down;  // speed after it
    rest_ = first_ + 2.0 * rise_ / (gravity * (1.0 - e_));
  }
  double rest() const { return rest_; }
  double x(double t) const {
    if (t < first_) return x0_ + t * (v0_ - 0.5 * gravity * t);
    if (t >= rest_) return 0.0;
    // After n bounces rest - t = 2 rise e^n / (g (1 - e)).
    const double left = (rest_ - t) * gravity * (1.0 - e_) / (2.0 * rise_);
    const double n = std::floor(std::log(left) / std::log(e_));
    const double speed = rise_ * std::pow(e_, n);
    const double since = t - (rest_ - 2.0 * speed / (gravity * (1.0 - e_)));
    return std::max(0.0, since * (speed - 0.5 * gravity * since));
  }

private:
  double e_, x0_, v0_, first_ = 0.0, rise_ = 0.0, rest_ = 0.0;
};

std::string reference(const char* name) {
  return std::string(std::getenv("SWEEPVI_SOURCE")) + "/tests/reference/" + name;
}

// The ball of HO section II. The reference made the same steps in another program: it agrees to the rounding
// of 40000 steps, and what is counted or a time exactly.
TEST(ZhuravlevIvanov, BallIsThatOfThePaper) {
  std::ifstream file(reference("zi_ball.json"));
  const auto known = nlohmann::json::parse(file);
  const double first_impact = std::stod(known["impacts"][0]["t"].get<std::string>());
  const double accumulation = std::stod(known["zeno"].get<std::string>());
  const Ball exact(0.41, 1.0, 6.0);
  EXPECT_NEAR(exact.rest(), accumulation, 1e-14);
  const Oscillators ball(PETSC_COMM_SELF, balls({0.41}, {1.0}, {6.0}));
  for (const auto& scheme : known["scheme"]) {
    const double h = scheme["h"];
    if (h < 1e-4) continue;
    const TimeGrid grid{0.0, 4.0, static_cast<PetscInt>(std::lround(4.0 / h))};
    const History run = march(ball, grid);
    ASSERT_TRUE(run.certified);
    double all = 0.0, before = 0.0, after = 0.0, first = 0.0, last = 0.0;
    int sign_changes = 0;
    for (std::size_t k = 0; k < run.t.size(); ++k) {
      const double error = std::abs(run.x[k][0] - exact.x(run.t[k]));
      all = std::max(all, error);
      if (run.t[k] < first_impact - 0.05) before = std::max(before, error);
      if (run.t[k] > accumulation) after = std::max(after, error);
      if (first == 0.0 && run.s[k][0] <= 0.0) first = run.t[k];
      if (run.s[k][0] != 0.0 || run.v[k][0] != 0.0) last = run.t[k];
      if (k > 0 && sign(run.s[k][0]) != sign(run.s[k - 1][0])) ++sign_changes;
    }
    EXPECT_NEAR(all, scheme["err_sup_all"].get<double>(), 1e-11);
    EXPECT_NEAR(before, scheme["err_before_first_impact"].get<double>(), 1e-11);
    EXPECT_EQ(after, 0.0);
    EXPECT_NEAR(first, scheme["first_impact"].get<double>(), 1e-9);
    EXPECT_NEAR(last, scheme["last_moving"].get<double>(), 1e-9);
    EXPECT_NEAR(last + h, scheme["rest_time"].get<double>(), 1e-9);
    EXPECT_EQ(sign_changes, scheme["n_sign_changes"].get<int>());
    EXPECT_LE(run.residual, 1e-14);
    EXPECT_EQ(run.rungs[0] + run.rungs[1], grid.steps);  // predictor or chosen
    // Impacts took what there was but for implicit Euler's own damping, 190 h to 330 h for these h.
    const double energy = 0.5 * 6.0 * 6.0 + gravity;
    EXPECT_LT(run.dissipated, energy);
    EXPECT_GE(run.dissipated, energy - 400.0 * h);
  }
}

/// Random balls; the same on all ranks.
Oscillators::Spec random_balls(std::size_t count) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> kappa(0.02, 0.98), x0(0.0, 2.0), v0(-4.0, 6.0);
  Oscillators::Spec spec = balls({}, {}, {});
  for (std::size_t i = 0; i < count; ++i) {
    spec.kappa.push_back(kappa(random));
    spec.x0.push_back(x0(random));
    spec.v0.push_back(v0(random));
  }
  return spec;
}

// A thousand balls against their bounces in closed form, |x - exact| <= C h over 4 s. C is large where kappa
// is small: the implicit scheme damps each of very many flights. The worst, kappa = 0.02, has C = 136, 169,
// 205 at h = 5e-3, 1.25e-3, 6.25e-4, the mean over the balls 11.8, 14.8, 15.8: first order in the limit, a
// little less before, where some balls are off by all of their height.
TEST(ZhuravlevIvanov, RandomBallsConverge) {
  const Oscillators::Spec spec = random_balls(1000);
  const Oscillators oscillators(PETSC_COMM_WORLD, spec);
  std::vector<Ball> exact;
  for (std::size_t i = 0; i < spec.kappa.size(); ++i)
    exact.emplace_back(spec.kappa[i], spec.x0[i], spec.v0[i]);
  double previous = 0.0;
  for (const PetscInt steps : {800, 3200}) {
    const TimeGrid grid{0.0, 4.0, steps};
    const History run = march(oscillators, grid);
    ASSERT_TRUE(run.certified);
    EXPECT_EQ(run.rungs[0] + run.rungs[1], steps);
    double worst = 0.0, sum = 0.0;
    for (std::size_t i = 0; i < exact.size(); ++i) {
      double error = 0.0;
      for (std::size_t k = 0; k < run.t.size(); ++k)
        error = std::max(error, std::abs(run.x[k][i] - exact[i].x(run.t[k])));
      worst = std::max(worst, error);
      sum += error;
    }
    std::printf("h = %.2e  C = %.4g, mean over the balls %.4g\n", grid.h(), worst / grid.h(),
                sum / grid.h() / static_cast<double>(exact.size()));
    EXPECT_LE(worst, 250.0 * grid.h());
    if (previous > 0.0) {
      EXPECT_NEAR(std::log(previous / sum) / std::log(4.0), 0.9, 0.1);
    }
    previous = sum;
  }
}

// HO (3) with the paper's gains. Both programs round 4000 steps: 1e-10 is what is promised. Where it rests,
// the signs are not unique, and compared is only what they do.
TEST(ZhuravlevIvanov, RegulatorIsTheReference) {
  std::ifstream file(reference("regulator_v0_5.csv"));
  std::string line;
  std::getline(file, line);
  Oscillators::Spec spec = balls({0.5}, {6.0}, {2.5});
  spec.force = [](double, PetscInt, double, double) { return 0.0; };
  const Oscillators oscillators(PETSC_COMM_SELF, spec);
  const History run = march(oscillators, {0.0, 4.0, 4000}, {.regulator = Regulator{30.0, 17.0}});
  ASSERT_TRUE(run.certified);
  std::size_t rows = 0;
  for (; std::getline(file, line); ++rows) {
    std::array<double, 5> known{};  // t s v lambda_s lambda_v
    std::istringstream fields(line);
    for (double& value : known) {
      std::string field;
      std::getline(fields, field, ',');
      value = std::stod(field);
    }
    const std::size_t k = 10 * rows;
    EXPECT_NEAR(run.t[k], known[0], 1e-12);
    EXPECT_NEAR(run.s[k][0], known[1], 1e-10);
    EXPECT_NEAR(run.v[k][0], known[2], 1e-10);
    if (known[1] == 0.0) continue;
    EXPECT_EQ(run.lambda_s[k][0], known[3]);
    EXPECT_EQ(run.lambda_v[k][0], known[4]);
  }
  EXPECT_EQ(rows, 401U);
  EXPECT_EQ(run.s.back()[0], 0.0);
  EXPECT_EQ(run.v.back()[0], 0.0);
}

// theta = 1/2 integrates a parabola exactly: nothing but rounding of 100 steps before the first impact
// at 1.37 s, and x stays above the wall ever after.
TEST(ZhuravlevIvanov, MidpointFliesExactly) {
  const Oscillators ball(PETSC_COMM_SELF, balls({0.41}, {1.0}, {6.0}));
  const Ball exact(0.41, 1.0, 6.0);
  const double apex = 6.0 / gravity;
  const TimeGrid grid{0.0, 2.0 * apex, 100};
  for (const double gamma : {1.0, 0.5}) {
    const History run = march(ball, grid, {.theta = 0.5, .gamma = gamma});
    ASSERT_TRUE(run.certified);
    for (std::size_t k = 0; k < run.t.size(); ++k) {
      // The sign of v changes at the apex, a grid point: with gamma < 1 it does so for two steps.
      if (gamma < 1.0 && run.t[k] > apex - 1.5 * grid.h()) break;
      EXPECT_NEAR(run.x[k][0], exact.x(run.t[k]), 1e-13) << gamma << ' ' << run.t[k];
    }
  }
}

// Branches --------------------------------------------------------------------------------------------

/// The residual of one oscillator's equations with the acceleration a + by_x x^ + by_velocity x'^, from their
/// definition.
std::array<double, 2> equations(const OscillatorStep& k, const OscillatorState& u) {
  const double p = k.gamma * u.lambda_s + (1.0 - k.gamma) * k.old.lambda_s;
  const double q = k.gamma * u.lambda_v + (1.0 - k.gamma) * k.old.lambda_v;
  const double R = 1.0 - k.kappa * p * q;
  const double v = k.theta * u.v + (1.0 - k.theta) * k.old.v;
  const double x = k.theta * std::abs(u.s) + (1.0 - k.theta) * std::abs(k.old.s);
  const double a = k.a + k.by_x * x + k.by_velocity * R * v * p;
  return {u.s - k.old.s - k.h * R * v, u.v - k.old.v - k.h / R * (p * (a - k.mu1) - q * k.mu2)};
}

/// Near rest, where branches meet; with every other s or v exactly 0.
OscillatorStep random_step(std::mt19937& random, bool implicit, bool controlled) {
  std::uniform_real_distribution<double> unit(0.0, 1.0), around(-1.0, 1.0);
  OscillatorStep k;
  k.h = 0.01;
  k.kappa = 0.02 + 0.96 * unit(random);
  if (!implicit) {
    k.theta = 0.5 + 0.5 * unit(random);
    k.gamma = 0.5 + 0.5 * unit(random);
  }
  if (controlled) {
    k.mu1 = 20.0 * unit(random);
    k.mu2 = 10.0 * unit(random);
  }
  k.a = 10.0 * around(random);
  if (!implicit) k.by_x = 100.0 * around(random);
  if (k.theta == 1.0 && controlled) k.by_velocity = 10.0 * around(random);
  k.old.s = unit(random) < 0.2 ? 0.0 : 3.0 * k.h * k.h * 10.0 * around(random);
  k.old.v = unit(random) < 0.2 ? 0.0 : 3.0 * k.h * 10.0 * around(random);
  k.old.lambda_s = k.old.s != 0.0 ? sign(k.old.s) : around(random);
  k.old.lambda_v = k.old.v != 0.0 ? sign(k.old.v) : around(random);
  k.terms = std::abs(k.a) + std::abs(k.by_x);
  return k;
}

// Whatever the state, the branch chosen solves the oscillator's VI: equations to rounding of their terms,
// signs in
// [-1, 1] and those of s and v. HO Lemma 1: there always is one.
TEST(Branches, TheOneChosenIsASolution) {
  std::mt19937 random(2);
  std::array<std::array<int, 2>, 2> found{};  // by s = 0 and v = 0, on the way from elsewhere
  for (int trial = 0; trial < 200000; ++trial) {
    const OscillatorStep step = random_step(random, trial % 2 == 0, trial % 4 >= 2);
    const Branch branch = choose_branch(step);
    const OscillatorState& u = branch.state;
    const OscillatorTerms terms = terms_of(step, u);
    const auto [of_s, of_v] = equations(step, u);
    ASSERT_LE(std::abs(of_s), 1e-14 * terms.s) << trial;
    ASSERT_LE(std::abs(of_v), 1e-14 * terms.v) << trial;
    ASSERT_LE(branch.misfit, 1e-14) << trial;
    ASSERT_LE(std::abs(u.lambda_s), 1.0) << trial;
    ASSERT_LE(std::abs(u.lambda_v), 1.0) << trial;
    if (std::abs(u.s) > 1e-14 * terms.s) {
      ASSERT_EQ(u.lambda_s, sign(u.s)) << trial;
    }
    if (std::abs(u.v) > 1e-14 * terms.v) {
      ASSERT_EQ(u.lambda_v, sign(u.v)) << trial;
    }
    ASSERT_FALSE(prefers_another(step, u)) << trial;
    if (step.old.s != 0.0 && step.old.v != 0.0) ++found[u.s == 0.0 ? 1 : 0][u.v == 0.0 ? 1 : 0];
  }
  for (const auto& row : found)
    for (const int count : row)
      EXPECT_GT(count, 5);
}

// Implicit, without control. HO (1): where the acceleration points away from the wall, nothing comes to rest
// or stays there, and x does not change sides without need; where it points to the wall the rest is the
// limit.
TEST(Branches, NothingRestsAgainstTheAcceleration) {
  std::mt19937 random(3);
  int from_rest = 0, several = 0;
  for (int trial = 0; trial < 100000; ++trial) {
    OscillatorStep step = random_step(random, true, false);
    if (trial % 3 == 0) step.old.s = step.old.v = 0.0;
    const bool at_rest = step.old.s == 0.0 && step.old.v == 0.0;
    const OscillatorState u = choose_branch(step).state;
    if (step.a > 0.0) {
      EXPECT_FALSE(u.s == 0.0 && u.v == 0.0);
      // Staying on the side of s_k: v^ + h a / R of its sign, as in HO (23).
      const double side = sign(step.old.s);
      for (const double sign_v : {1.0, -1.0}) {
        const double R = 1.0 - step.kappa * side * sign_v;
        const double v = step.old.v + step.h / R * side * step.a;
        const double s = step.old.s + step.h * R * v;
        if (side * s > 0.0 && sign_v * v > 0.0) {
          EXPECT_EQ(u.lambda_s, side);
        }
      }
      const OscillatorState still{0.0, 0.0, 0.0, 1.0};
      if (!at_rest) continue;
      ++from_rest;
      EXPECT_EQ(u.lambda_s, 1.0);
      EXPECT_EQ(u.lambda_v, 1.0);
      // v = h a / R and s = h R v; staying at rest solves the equations, too, and is refused.
      EXPECT_NEAR(u.s, step.h * step.h * step.a, 1e-15 * step.a);
      EXPECT_EQ(equations(step, still), (std::array{0.0, 0.0}));
      EXPECT_TRUE(prefers_another(step, still));
      ++several;
    } else if (at_rest) {
      EXPECT_EQ(u.s, 0.0);
      EXPECT_EQ(u.v, 0.0);
      EXPECT_FALSE(prefers_another(step, u));
    }
  }
  EXPECT_GT(from_rest, 1000);
  EXPECT_EQ(several, from_rest);
}

// HO Remark 1, for a single step; at rest with the acceleration positive both signs are right, and 1 is
// taken.
TEST(Branches, ChangeOfSignsIsASymmetry) {
  std::mt19937 random(4);
  for (int trial = 0; trial < 100000; ++trial) {
    const OscillatorStep step = random_step(random, trial % 2 == 0, trial % 4 >= 2);
    if (step.old.s == 0.0 && step.old.v == 0.0) continue;
    OscillatorStep mirrored = step;
    mirrored.old = {-step.old.s, -step.old.v, -step.old.lambda_s, -step.old.lambda_v};
    const OscillatorState u = choose_branch(step).state;
    const OscillatorState m = choose_branch(mirrored).state;
    EXPECT_EQ(u.s, -m.s);
    EXPECT_EQ(u.v, -m.v);
    EXPECT_EQ(u.lambda_s, -m.lambda_s);
    EXPECT_EQ(u.lambda_v, -m.lambda_v);
  }
}

// The process -----------------------------------------------------------------------------------------

// From rest at s = 0 a ball with a positive force leaves, x = F t (t + h) / 2 as implicit Euler has it; one
// with a negative force stays where it is.
TEST(ZhuravlevIvanov, PositiveForceLifts) {
  for (const double force : {2.0, -2.0}) {
    Oscillators::Spec spec = balls({0.3, 0.5, 0.9}, {0.0, 0.0, 0.0}, {0.0, 0.0, 0.0});
    spec.force = [force](double, PetscInt, double, double) { return force; };
    const Oscillators oscillators(PETSC_COMM_WORLD, spec);
    const TimeGrid grid{0.0, 1.0, 100};
    const History run = march(oscillators, grid);
    ASSERT_TRUE(run.certified);
    EXPECT_EQ(run.lift_offs, force > 0.0 ? 3 : 0);
    for (std::size_t k = 0; k < run.t.size(); ++k)
      for (const double x : run.x[k])
        EXPECT_NEAR(x, std::max(0.0, 0.5 * force * run.t[k] * (run.t[k] + grid.h())), 1e-14);
  }
}

// Two steps take the ball off the wall: SNES alone, starting from rest, finds that resting solves the VI.
// That is certified, and refused all the same.
TEST(ZhuravlevIvanov, SpuriousRestIsNoSolution) {
  Oscillators::Spec spec = balls({0.5}, {0.0}, {0.0});
  spec.force = [](double, PetscInt, double, double) { return 2.0; };
  const Oscillators oscillators(PETSC_COMM_SELF, spec);
  const ScopedOption sweeps("-sweepvi_zi_sweeps", "0");
  const ScopedOption predictor("-sweepvi_predictor", "none");
  const TimeGrid grid{0.0, 1.0, 100};
  const auto dvi = make_impact_dvi(oscillators, grid);
  // The start says lambda_s = 1; someone who comes from rest has 0.
  {
    const WriteArray u(dvi->state());
    u[2] = 0.0;
  }
  TimeMarch time_march(*dvi, grid);
  const StepReport report = time_march.step();
  EXPECT_FALSE(report.certified);
  EXPECT_LE(report.residual, 1e-10);
}

// HO Remark 1: (s, v) and (-s, -v) are the same ball. Turned around in mid-flight, everything that follows is
// the mirror image, bit by bit; what is physical is the same.
TEST(ZhuravlevIvanov, MirroredRunIsTheMirrorImage) {
  const Oscillators oscillators(PETSC_COMM_WORLD, random_balls(20));
  const TimeGrid grid{0.0, 2.0, 500};
  const History run = march(oscillators, grid);
  const History mirrored = march(oscillators, grid, {}, [](const Step& step, ImpactDvi& dvi) {
    if (step.number == 7) check(VecScale(dvi.state(), -1.0));
  });
  ASSERT_TRUE(run.certified && mirrored.certified);
  EXPECT_EQ(difference(run.x, mirrored.x), 0.0);
  EXPECT_EQ(difference(run.velocity, mirrored.velocity), 0.0);
  for (std::size_t k = 8; k < run.t.size(); ++k)
    for (std::size_t i = 0; i < 20; ++i) {
      EXPECT_EQ(run.s[k][i], -mirrored.s[k][i]);
      EXPECT_EQ(run.v[k][i], -mirrored.v[k][i]);
    }
}

// Through (x, x') and back at each sample, HO IV: by Remark 1 nothing changes but rounding, of 1000 steps of
// size up to 10, each time R v / R.
TEST(ZhuravlevIvanov, ResamplingIsTheSame) {
  const Oscillators oscillators(PETSC_COMM_WORLD, random_balls(20));
  const TimeGrid grid{0.0, 4.0, 1000};
  for (const bool controlled : {false, true}) {
    ImpactOptions options;
    if (controlled) options.regulator = Regulator{40.0, 15.0};
    const History direct = march(oscillators, grid, options);
    options.resample = true;
    const History resampled = march(oscillators, grid, options);
    ASSERT_TRUE(direct.certified && resampled.certified);
    EXPECT_LE(difference(direct.x, resampled.x), 1e-9);
    EXPECT_GT(direct.impacts, 20);
    EXPECT_EQ(direct.impacts, resampled.impacts);
    // What a step starts from is sgn(s) = 1: at most one change of sign in it.
    double lowest = 0.0;
    for (const auto& row : direct.s)
      for (const double s : row)
        lowest = std::min(lowest, s);
    EXPECT_LT(lowest, -0.1);
  }
}

// General accelerations -------------------------------------------------------------------------------

/// Driven, with a cubic spring and quadratic drag, and linear springs to the neighbours.
Oscillators::Spec nonlinear(std::size_t count, bool own_derivatives) {
  Oscillators::Spec spec;
  spec.spring = 3.0;
  spec.linear = false;
  spec.reads_velocities = true;
  spec.force = [](double t, PetscInt i, double x, double velocity) {
    return -4.0 - x * x * x - 0.5 * velocity * std::abs(velocity) +
           6.0 * std::sin(3.0 * t + static_cast<double>(i));
  };
  if (own_derivatives)
    spec.derivatives = [](double, PetscInt, double x, double velocity) {
      return std::pair{-3.0 * x * x, -std::abs(velocity)};
    };
  for (std::size_t i = 0; i < count; ++i) {
    spec.kappa.push_back(0.3 + 0.4 * static_cast<double>(i) / static_cast<double>(count));
    spec.x0.push_back(0.5 + 0.1 * static_cast<double>(i % 3));
    spec.v0.push_back(0.0);
  }
  return spec;
}

// Against central differences of the residual, at random points: 1e-6 of steps of 1e-5 in values of size 1
// to 30.
TEST(ZhuravlevIvanov, JacobianIsThatOfTheResidual) {
  constexpr PetscInt size = 16;
  const Oscillators oscillators(PETSC_COMM_SELF, nonlinear(4, true));
  const TimeGrid grid{0.0, 2.0, 20};  // h = 0.1: nothing is small
  for (const ImpactOptions& options :
       {ImpactOptions{}, ImpactOptions{.theta = 0.6, .gamma = 0.7, .regulator = Regulator{5.0, 2.0}}}) {
    const auto dvi = make_impact_dvi(oscillators, grid, options);
    std::mt19937 random(5);
    std::uniform_real_distribution<double> around(-1.0, 1.0);
    const Vector u = duplicate(dvi->state()), f = duplicate(u.get()), g = duplicate(u.get());
    const Matrix jacobian = dvi->create_jacobian();
    for (int trial = 0; trial < 20; ++trial) {
      {
        const WriteArray old(dvi->state());
        const WriteArray now(u.get());
        for (PetscInt i = 0; i < size; ++i) {
          old[i] = around(random);
          now[i] = around(random);
        }
      }
      dvi->begin({1, 0.3, 0.4, 0.1}, f.get(), g.get(), f.get());
      dvi->jacobian(u.get(), jacobian.get());
      for (PetscInt column = 0; column < size; ++column) {
        const double step = 1e-5;
        const double at = ReadArray(u.get())[column];
        WriteArray(u.get())[column] = at + step;
        dvi->residual(u.get(), f.get());
        WriteArray(u.get())[column] = at - step;
        dvi->residual(u.get(), g.get());
        WriteArray(u.get())[column] = at;
        const ReadArray ahead(f.get()), behind(g.get());
        for (PetscInt row = 0; row < size; ++row) {
          double entry = 0.0;
          check(MatGetValue(jacobian.get(), row, column, &entry));
          ASSERT_NEAR(entry, (ahead[row] - behind[row]) / (2.0 * step), 1e-6)
              << row << ' ' << column << ' ' << options.theta;
        }
      }
    }
  }
}

// Forward differences: 1e-7 of values up to 30, and second derivatives of size 10.
TEST(ZhuravlevIvanov, DifferencesAreTheDerivatives) {
  const Oscillators own(PETSC_COMM_WORLD, nonlinear(5, true));
  ImpactJacobian derivative(own);
  const Vector x = make_vector(PETSC_COMM_WORLD, static_cast<PetscInt>(own.kappa().size()));
  const Vector velocity = duplicate(x.get());
  own.start(x.get(), velocity.get());
  check(VecCopy(x.get(), velocity.get()));  // away from the kink of v |v|
  derivative.evaluate(0.7, x.get(), velocity.get());
  Matrix by_x = add(derivative.by_x(), 0.0, derivative.by_x());
  Matrix by_velocity = add(derivative.by_velocity(), 0.0, derivative.by_velocity());
  derivative.finite_differences(0.7, x.get(), velocity.get());
  for (const auto& [exact, differences] :
       {std::pair{by_x.get(), derivative.by_x()}, std::pair{by_velocity.get(), derivative.by_velocity()}}) {
    double error = 0.0, size = 0.0;
    check(MatNorm(add(differences, -1.0, exact).get(), NORM_INFINITY, &error));
    check(MatNorm(exact, NORM_INFINITY, &size));
    EXPECT_GT(size, 0.1);
    EXPECT_LE(error, 1e-6);
    EXPECT_GT(error, 0.0);
  }
}

// With and without derivatives of their own: what solves a step does not depend on how it was found. The two
// differ by what the certificate leaves, 1e-14 of the terms of 400 steps.
TEST(ZhuravlevIvanov, ARunByDifferencesIsTheSame) {
  const TimeGrid grid{0.0, 4.0, 400};
  const History own = march(Oscillators(PETSC_COMM_WORLD, nonlinear(5, true)), grid);
  const History differences = march(Oscillators(PETSC_COMM_WORLD, nonlinear(5, false)), grid);
  ASSERT_TRUE(own.certified && differences.certified);
  EXPECT_GT(own.impacts, 10);
  EXPECT_GT(own.lift_offs, 3);
  EXPECT_EQ(own.impacts, differences.impacts);
  EXPECT_LE(difference(own.x, differences.x), 1e-10);
}

// First order: differences between runs, each with a quarter of the step of the one before, shrink fourfold
// (in L1 over time: where an impact falls in its step moves single values more).
TEST(ZhuravlevIvanov, NonlinearOrderOne) {
  const Oscillators oscillators(PETSC_COMM_SELF, nonlinear(3, true));
  std::vector<History> runs;
  for (const PetscInt steps : {500, 2000, 8000})
    runs.push_back(march(oscillators, {0.0, 2.0, steps}));
  std::array<double, 2> distance{};
  for (std::size_t r = 0; r < 2; ++r)
    for (std::size_t k = 0; k <= 500; ++k)
      for (std::size_t i = 0; i < 3; ++i)
        distance[r] += std::abs(runs[r].x[k << (2 * r)][i] - runs[r + 1].x[k << (2 * r + 2)][i]);
  EXPECT_NEAR(std::log(distance[0] / distance[1]) / std::log(4.0), 1.0, 0.1);
}

// Springs ---------------------------------------------------------------------------------------------

// Two ways to a step: oscillator by oscillator until nothing changes, or only two such sweeps and then Newton
// on all of them. Rounding of 500 steps.
TEST(ZhuravlevIvanov, NewtonFindsTheSameSteps) {
  Oscillators::Spec spec = random_balls(12);
  spec.spring = 50.0;
  const Oscillators oscillators(PETSC_COMM_WORLD, spec);
  const TimeGrid grid{0.0, 1.6, 200};
  const History swept = march(oscillators, grid);
  const ScopedOption sweeps("-sweepvi_zi_sweeps", "2");
  const History newton = march(oscillators, grid);
  ASSERT_TRUE(swept.certified && newton.certified);
  EXPECT_EQ(swept.predicted, 200);
  EXPECT_GT(swept.impacts, 30);
  EXPECT_EQ(swept.impacts, newton.impacts);
  EXPECT_LE(difference(swept.x, newton.x), 1e-11);
  EXPECT_LE(difference(swept.velocity, newton.velocity), 1e-11);
}

// h^2 times the stiffness is 16: sweeps contract by 0.97 and do not get there, Newton has to. Certified is
// certified; what the springs do in so large a step, to pull all x together within a few, is implicit
// Euler's.
TEST(ZhuravlevIvanov, StiffSpringsTakeNewton) {
  Oscillators::Spec spec = random_balls(12);
  spec.spring = 1e6;
  const Oscillators oscillators(PETSC_COMM_WORLD, spec);
  const History run = march(oscillators, {0.0, 0.4, 100});
  ASSERT_TRUE(run.certified);
  EXPECT_LE(run.residual, 1e-10);
  const auto [least, most] = std::minmax_element(run.x.back().begin(), run.x.back().end());
  EXPECT_LE(*most - *least, 1e-3);
}

/// A chain as scenes have it, dealt out over the ranks.
struct Chain {
  Chain(MPI_Comm comm, const ChainSpec& spec) : system(make_chain(comm, spec)) {
    RelativeDegree degree = analyse_relative_degree(system);
    distribute(system, degree);
    std::vector<double> kappa;
    for (const PetscInt number : system.constraint_order)
      kappa.push_back(spec.keys[0][number]);
    oscillators = make_impact_oscillators(system, std::move(kappa));
  }
  LinearSystem system;
  std::unique_ptr<ImpactOscillators> oscillators;
};

ChainSpec chain_of(std::int64_t count, double coupling) {
  ChainSpec spec = ChainSpec::of(*find_element("zhuravlev-ivanov"), count);
  spec.coupling = coupling;
  spec.keys[0].values.clear();
  for (std::int64_t i = 0; i < count; ++i)
    spec.keys[0].values.push_back(0.3 + 0.4 * static_cast<double>(i % 7) / 7.0);
  return spec;
}

// Without springs a chain is so many balls: bit by bit, whichever rank has them.
TEST(Chain, WithoutSpringsIsSingleBalls) {
  const std::int64_t count = 30;
  const ChainSpec spec = chain_of(count, 0.0);
  const Chain chain(PETSC_COMM_WORLD, spec);
  const TimeGrid grid{0.0, 2.0, 400};
  const History together = march(*chain.oscillators, grid);
  ASSERT_TRUE(together.certified);
  std::vector<double> number(chain.system.constraint_order.begin(), chain.system.constraint_order.end());
  Vector numbers = make_vector(PETSC_COMM_WORLD, static_cast<PetscInt>(number.size()));
  std::copy(number.begin(), number.end(), WriteArray(numbers.get()).data());
  number = everywhere(numbers.get());
  for (std::size_t i = 0; i < number.size(); ++i) {
    const auto element = static_cast<std::int64_t>(number[i]);
    ChainSpec single = ChainSpec::of(*spec.element, 1);
    const double golden = 0.6180339887498949 * static_cast<double>(element);
    single.keys[0] = {{spec.keys[0][element]}};
    single.x0 = {1.0 + 0.5 * (golden - std::floor(golden)), 0.0};
    const Chain alone(PETSC_COMM_SELF, single);
    const History ball = march(*alone.oscillators, grid);
    for (std::size_t k = 0; k < ball.t.size(); ++k) {
      ASSERT_EQ(together.s[k][i], ball.s[k][0]);
      ASSERT_EQ(together.v[k][i], ball.v[k][0]);
    }
  }
}

// With springs: all come to rest, held by gravity; until then the energy only falls. What impacts took is
// most of it, the rest is implicit Euler's damping, O(h).
TEST(Chain, WithSpringsComesToRest) {
  const Chain chain(PETSC_COMM_WORLD, chain_of(50, 5.0));
  const TimeGrid grid{0.0, 4.0, 1000};
  std::vector<double> energies;
  const auto energy = [&](const ImpactDvi& dvi) {
    double sum = dvi.kinetic() + chain.oscillators->potential(dvi.x()).value_or(0.0);
    MPI_Allreduce(MPI_IN_PLACE, &sum, 1, MPI_DOUBLE, MPI_SUM, PETSC_COMM_WORLD);
    return sum;
  };
  const History run = march(*chain.oscillators, grid, {},
                            [&](const Step&, const ImpactDvi& dvi) { energies.push_back(energy(dvi)); });
  ASSERT_TRUE(run.certified);
  EXPECT_EQ(run.predicted, grid.steps);
  for (std::size_t i = 0; i < 50; ++i) {
    EXPECT_EQ(run.s.back()[i], 0.0);
    EXPECT_EQ(run.v.back()[i], 0.0);
    EXPECT_LT(std::abs(run.lambda_s.back()[i]), 1.0);
  }
  EXPECT_EQ(run.kinetic, 0.0);
  EXPECT_EQ(energies.back(), 0.0);  // x = 0: no spring, no height
  EXPECT_LE(run.dissipated, energies.front());
  EXPECT_GE(run.dissipated, 0.9 * energies.front());
  double up = 0.0;
  for (std::size_t k = 1; k < energies.size(); ++k)
    up = std::max(up, energies[k] - energies[k - 1]);
  EXPECT_LE(up, 1e-13 * energies.front());  // rounding of the sums
}

// What makes no sense is refused, on every rank.
TEST(ZhuravlevIvanov, NonsenseIsRefused) {
  const auto refused = [](const Oscillators::Spec& spec, const ImpactOptions& options = {}) {
    const Oscillators oscillators(PETSC_COMM_WORLD, spec);
    EXPECT_THROW(make_impact_dvi(oscillators, {0.0, 1.0, 10}, options), Error);
  };
  for (const double kappa : {0.0, 1.0, -0.5, std::nan("")})
    refused(balls({0.5, kappa}, {1.0, 1.0}, {0.0, 0.0}));
  refused(balls({0.5, 0.5}, {1.0, -0.1}, {0.0, 0.0}));
  for (const double weight : {0.0, 1.5}) {
    refused(balls({0.5}, {1.0}, {0.0}), {.theta = weight});
    refused(balls({0.5}, {1.0}, {0.0}), {.gamma = weight});
  }
  const LinearSystem other = make_chain(PETSC_COMM_WORLD, ChainSpec::of(*find_element("jerk"), 4));
  EXPECT_THROW(make_impact_oscillators(other, {0.5}), Error);
}

}  // namespace
}  // namespace sweepvi::test
