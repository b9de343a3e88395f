// Who should linearise? The oscillators of Huber and Oza lead to a small nonlinear box VI in each step. It
// can be handed to the solver as it is (inner linearisation), or be linearised again and again, each affine
// VI being solved exactly and its solution taken whole (outer linearisation). The authors "strongly advise
// against" the second (CDC 2016, section V.A). Here both solve the same steps, and are counted.
//
// Every step starts from the last state, with no idea of the signs to come; what marches on is a guess by
// branches. Compared are SNESVI on the nonlinear problem, its reduced-space and its semismooth type alone;
// outer linearisation; and the whole ladder, SNESVI on its first rungs and pivoting on its last. A step
// counts as solved if the point found is certified and no spurious rest, and as `same` if it is the solution
// that the march takes, of several. The steps are those of
// - one run over 3 s of each of the three systems with the paper's data: a ball, the regulator (3), tracking
// (4)-(8);
// - 5 steps each of many random ones: any restitution, forces down to -20 m/s^2, gains mu1 from 10 to 40
// m/s^2, starts
//   within 10 h (m) of the wall at up to 5 m/s.
//
// Run:    example_linearisation                          (h = 1e-2 s, 1000 random systems of each kind: a
// minute)
//         example_linearisation -step 1e-1 -systems 200
// Expect: outer linearisation solves every step of all balls and regulators, with 1 to 4 affine VIs a step.
// Of the
//         random tracking problems it solves 99.96, 98.7, 90.3 % at h = 1e-3, 1e-2, 1e-1: the others cycle.
//         SNESVI alone solves less: semismooth 96.8, 96.2, 76.8 %, reduced space 85.0, 76.4, 35.5 %. The
//         ladder, which has both, solves 100, 99.9, 99.0 %.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "sweepvi/impact_oscillators.hpp"
#include "sweepvi/time_march.hpp"
#include "sweepvi/tracking.hpp"

using namespace sweepvi;

namespace {

/// A ball on rank 0: x'' = force, bouncing.
class Ball final : public ImpactOscillators {
public:
  Ball(MPI_Comm comm, double kappa, double x0, double velocity0, double force)
      : comm_(comm), kappa_(kappa), x0_(x0), velocity0_(velocity0), force_(force) {
    int rank = 0;
    MPI_Comm_rank(comm, &rank);
    count_ = rank == 0 ? 1 : 0;
  }
  std::vector<double> kappa() const override {
    return std::vector<double>(static_cast<std::size_t>(count_), kappa_);
  }
  void start(Vec x, Vec velocity) const override {
    check(VecSet(x, x0_));
    check(VecSet(velocity, velocity0_));
  }
  void acceleration(double, Vec, Vec, Vec a) const override { check(VecSet(a, force_)); }
  Matrix pattern() const override {
    Matrix none;
    check(MatCreateAIJ(comm_, count_, count_, PETSC_DETERMINE, PETSC_DETERMINE, 0, nullptr, 0, nullptr,
                       none.put()));
    check(MatAssemblyBegin(none.get(), MAT_FINAL_ASSEMBLY));
    check(MatAssemblyEnd(none.get(), MAT_FINAL_ASSEMBLY));
    return none;
  }
  bool jacobian(double, Vec, Vec, Mat, Mat) const override { return true; }  // zero
  bool linear() const override { return true; }
  bool reads_velocities() const override { return false; }

private:
  MPI_Comm comm_;
  PetscInt count_ = 0;
  double kappa_, x0_, velocity0_, force_;
};

// ---- what is counted ----

struct Score {
  PetscInt solved = 0, same = 0, iterations = 0, most = 0;
  void add(const StepReport& report, bool same_as_march) {
    ++solved;
    same += same_as_march ? 1 : 0;
    iterations += report.iterations;
    most = std::max(most, report.iterations);
  }
};

enum Method { reduced_space, semismooth, outer, ladder, method_count };
constexpr const char* method_names[] = {"reduced space", "semismooth", "outer", "ladder"};

struct Scores {
  PetscInt steps = 0;
  Score of[method_count];
};

/// An option for one scope.
class Option {
public:
  Option(const char* name, const char* value) : name_(name) {
    check(PetscOptionsSetValue(nullptr, name, value));
  }
  ~Option() { static_cast<void>(PetscOptionsClearValue(nullptr, name_)); }
  Option(const Option&) = delete;
  Option& operator=(const Option&) = delete;

private:
  const char* name_;
};

/// A solver of single steps that starts from the last state.
class Contender {
public:
  Contender(Dvi& dvi, const char* linearisation, const char* snes_type) {
    const Option from_last_state("-sweepvi_predictor", "none");
    const Option who("-sweepvi_linearisation", linearisation);
    const Option type("-snes_type", snes_type);
    check(SNESCreate(dvi.comm(), snes_.put()));
    solver_ = std::make_unique<StepSolver>(snes_.get(), dvi);
  }
  StepReport solve(const Step& step) { return solver_->solve(step); }
  Vec solution() const { return solver_->solution(); }

private:
  NonlinearSolver snes_;
  std::unique_ptr<StepSolver> solver_;
};

/// Whether two points have the same states; signs need not be unique. Unknowns come in groups of `group`,
/// states first.
bool same_states(Vec a, Vec b, PetscInt group, PetscInt states) {
  double worst = 0.0;
  double largest = 0.0;
  {
    const ReadArray x(a);
    const ReadArray y(b);
    for (PetscInt i = 0; i < x.size(); ++i) {
      if (i % group >= states) continue;
      worst = std::max(worst, std::abs(x[i] - y[i]));
      largest = std::max(largest, std::abs(y[i]));
    }
  }
  double both[] = {worst, largest};
  MPI_Allreduce(MPI_IN_PLACE, both, 2, MPI_DOUBLE, MPI_MAX,
                PetscObjectComm(reinterpret_cast<PetscObject>(a)));
  return both[0] <=
         1e-7 * both[1] + 1e-9;  // certified points differ by far less, other solutions by h and more
}

/// Takes `steps` steps of h. Before each one all contenders solve it.
void compete(Dvi& dvi, PetscInt group, double h, PetscInt steps, Scores& scores) {
  Contender first(dvi, "inner", SNESVINEWTONRSLS);
  Contender second(dvi, "inner", SNESVINEWTONSSLS);
  Contender third(dvi, "outer", SNESVINEWTONRSLS);
  Vector found[3];
  for (Vector& point : found)
    check(VecDuplicate(dvi.state(), point.put()));
  const TimeGrid grid{0.0, h * static_cast<double>(steps), steps};
  TimeMarch march(dvi, grid);
  for (PetscInt k = 0; k < steps; ++k) {
    const Step step{k + 1, grid.time(k), grid.time(k + 1), grid.h()};
    StepReport reports[3];
    int i = 0;
    for (Contender* contender : {&first, &second, &third}) {
      reports[i] = contender->solve(step);
      check(VecCopy(contender->solution(), found[i].get()));
      ++i;
    }
    if (!march.step().certified) throw Error(ExitCode::unsolved, "the march failed");
    ++scores.steps;
    bool same[3];
    for (i = 0; i < 3; ++i)
      same[i] = same_states(found[i].get(), dvi.state(), group, group == 10 ? 4 : 2);
    // SNESVI alone: the first rung of the ladder, where it succeeds.
    if (reports[0].certified && reports[0].rung == Rung::chosen)
      scores.of[reduced_space].add(reports[0], same[0]);
    if (reports[1].certified && reports[1].rung == Rung::chosen)
      scores.of[semismooth].add(reports[1], same[1]);
    if (reports[2].certified) scores.of[outer].add(reports[2], same[2]);
    if (reports[0].certified) scores.of[ladder].add(reports[0], same[0]);
  }
}

// ---- the problems ----

/// A system of one kind: the paper's, or a random one.
struct Kind {
  const char* name;
  bool regulated = false;
  bool tracking = false;
};

class Draw {
public:
  double operator()(double low, double high) { return low + (high - low) * uniform_(engine_); }

private:
  std::mt19937 engine_{1};  // the same numbers on all ranks and in all runs
  std::uniform_real_distribution<double> uniform_{0.0, 1.0};
};

void run_of_the_paper(MPI_Comm comm, const Kind& kind, double h, Scores& scores) {
  const auto steps = static_cast<PetscInt>(std::lround(3.0 / h));
  const TimeGrid grid{0.0, h * static_cast<double>(steps), steps};
  if (kind.tracking) {
    const auto dvi = make_tracking_dvi(comm, {.plant = {0.5, 6.0, 5.0, Signal{-9.81}},
                                              .reference = {0.5, 3.0, 3.0, Signal{-19.81}},
                                              .gains = {30.0, 17.0}});
    compete(*dvi, 10, h, steps, scores);
    return;
  }
  const Ball ball = kind.regulated ? Ball(comm, 0.5, 6.0, 2.5, 0.0) : Ball(comm, 0.41, 1.0, 6.0, -9.81);
  ImpactOptions options;
  if (kind.regulated) options.regulator = {30.0, 17.0};
  const auto dvi = make_impact_dvi(ball, grid, options);
  compete(*dvi, 4, h, steps, scores);
}

void random_system(MPI_Comm comm, const Kind& kind, double h, Draw& draw, Scores& scores) {
  constexpr PetscInt steps = 5;
  const double mu1 = draw(10.0, 40.0);
  const double mu2 = mu1 * draw(0.05, 0.95);
  const auto bouncer = [&] {
    const double kappa = draw(0.05, 0.95);
    const double x0 = draw(0.0, 10.0) * h;
    const double velocity0 = draw(-5.0, 5.0);
    return Bouncer{kappa, x0, velocity0, Signal{draw(-20.0, 0.0)}};
  };
  const Bouncer plant = bouncer();
  if (kind.tracking) {
    const auto dvi = make_tracking_dvi(comm, {.plant = plant, .reference = bouncer(), .gains = {mu1, mu2}});
    compete(*dvi, 10, h, steps, scores);
    return;
  }
  const Ball ball(comm, plant.kappa, plant.x0, plant.velocity0, plant.force(0.0, 0.0, 0.0));
  ImpactOptions options;
  if (kind.regulated) options.regulator = {mu1, mu2};
  const auto dvi = make_impact_dvi(ball, {0.0, h * static_cast<double>(steps), steps}, options);
  compete(*dvi, 4, h, steps, scores);
}

void print(MPI_Comm comm, const std::string& name, const Scores& scores) {
  for (int method = 0; method < method_count; ++method) {
    const Score& score = scores.of[method];
    const auto steps = static_cast<double>(scores.steps);
    const double solved = std::max(1.0, static_cast<double>(score.solved));
    check(PetscPrintf(comm, "%-17s %-14s %7d %8d %8.3f %8.3f %8.2f %5d\n", name.c_str(), method_names[method],
                      static_cast<int>(scores.steps), static_cast<int>(score.solved),
                      100.0 * static_cast<double>(score.solved) / steps,
                      100.0 * static_cast<double>(score.same) / steps,
                      static_cast<double>(score.iterations) / solved, static_cast<int>(score.most)));
  }
}

void study(MPI_Comm comm) {
  PetscReal h = 1e-2;
  PetscInt systems = 1000;
  check(PetscOptionsGetReal(nullptr, nullptr, "-step", &h, nullptr));
  check(PetscOptionsGetInt(nullptr, nullptr, "-systems", &systems, nullptr));
  if (!(h > 0.0)) throw InputError("-step must be > 0 [s]");
  check(PetscPrintf(comm, "h = %g s; iterations are those of solved steps\n", h));
  check(PetscPrintf(comm, "%-17s %-14s %7s %8s %8s %8s %8s %5s\n", "problem", "method", "steps", "solved",
                    "%", "same %", "mean it.", "max"));
  Draw draw;
  for (const Kind& kind : {Kind{"ball"}, Kind{"regulator", true}, Kind{"tracking", true, true}}) {
    Scores paper;
    run_of_the_paper(comm, kind, h, paper);
    print(comm, std::string(kind.name), paper);
    Scores random;
    for (PetscInt i = 0; i < systems; ++i)
      random_system(comm, kind, h, draw, random);
    if (systems > 0) print(comm, std::string("random ") + kind.name, random);
  }
}

}  // namespace

int main(int argc, char** argv) {
  const Session session(argc, argv);
  try {
    study(session.comm());
  } catch (const Error& error) {
    int rank = 0;
    MPI_Comm_rank(session.comm(), &rank);
    if (rank == 0) std::fprintf(stderr, "linearisation: %s\n", error.what());
    return static_cast<int>(error.code());
  }
  return 0;
}
