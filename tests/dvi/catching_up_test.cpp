// ranks: 1 2 3
// several: *-CatchingUpBox.Decay*:*.AHalfPlaneOfConstant*:*.ATurning*
// three: *.AChainIsPushedTogether:*.RanksAndOrderDoNotMatter:*.DependentFacesShareTheirMeasure
// First-order sweeping processes against closed forms and brute force.
// timeout: 240
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <numeric>
#include <random>

#include "dvi/systems.hpp"
#include "parallel/gather.hpp"
#include "sweepvi/sweeping.hpp"

namespace sweepvi::test {
namespace {

using std::numbers::pi;
constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr double epsilon = std::numeric_limits<double>::epsilon();

using Faces = std::function<void(double t, Mat G, Vec g)>;

/// What a run left, on every rank, in scene order; row 0 is the start.
struct History {
  struct Happening {
    double t;
    PetscInt constraint;
    bool impact;
    double impulse;
  };
  bool certified = false;
  std::string obstacle;
  PetscInt steps = 0, predicted = 0;
  double worst_ratio = 0.0, penetration = 0.0;
  std::vector<double> t;
  std::vector<std::vector<double>> u, w, mu;
  std::vector<Happening> events;
};

/// Values that ranks own, ordered by their scene numbers.
std::vector<double> in_order(MPI_Comm comm, const std::vector<PetscInt>& order,
                             const std::vector<double>& mine) {
  std::vector<PetscInt> numbers = gather(comm, order);
  std::vector<double> values = gather(comm, mine);
  std::vector<double> result(values.size());
  for (std::size_t k = 0; k < numbers.size(); ++k)
    result[static_cast<std::size_t>(numbers[k])] = values[k];
  broadcast(comm, result);
  return result;
}

History march(SweepingSystem system, const TimeGrid& grid, bool deal_out = true,
              const Faces& faces = nullptr) {
  const MPI_Comm comm = system.comm();
  if (deal_out) distribute(system);
  system.move_faces = faces;
  const auto dvi = make_sweeping_dvi(system, grid);
  const std::vector<PetscInt>& rows = system.is_box() ? system.state_order : system.face_order;
  History run;
  const auto record = [&](double t) {
    std::vector<double> x;
    {
      const ReadArray values(dvi->x());
      x.assign(values.data(), values.data() + values.size());
    }
    run.t.push_back(t);
    run.u.push_back(in_order(comm, system.state_order, x));
    run.w.push_back(in_order(comm, rows, dvi->w()));
    run.mu.push_back(in_order(comm, rows, dvi->mu()));
  };
  record(grid.start);
  TimeMarch time_march(*dvi, grid);
  time_march.observe([&](const Step& step, const StepReport& report) {
    record(step.t_new);
    run.predicted += report.predicted ? 1 : 0;
    run.worst_ratio = std::max(run.worst_ratio, report.residual);
    run.penetration = std::max(run.penetration, dvi->penetration());
    std::vector<History::Happening> mine;
    for (const StepEvent& event : dvi->events())
      mine.push_back(
          {step.t_new, rows[static_cast<std::size_t>(event.constraint)], event.impact, event.impulse});
    mine = gather(comm, mine);
    broadcast(comm, mine);
    run.events.insert(run.events.end(), mine.begin(), mine.end());
  });
  const StepReport report = time_march.run();
  run.certified = report.certified && time_march.steps_taken() == grid.steps;
  run.obstacle = report.obstacle;
  run.steps = time_march.steps_taken();
  return run;
}

History march(const DenseSweeping& given, const TimeGrid& grid, bool deal_out = true,
              const Faces& faces = nullptr) {
  return march(SweepingSystem::dense(PETSC_COMM_WORLD, given), grid, deal_out, faces);
}

/// On every rank the whole process: small ones of many steps, which would only wait for messages.
History march_alone(const DenseSweeping& given, const TimeGrid& grid, const Faces& faces = nullptr) {
  return march(SweepingSystem::dense(PETSC_COMM_SELF, given), grid, false, faces);
}

/// Fills rows of G and g that this rank owns from functions of the face number.
Faces turning(std::function<std::vector<double>(double t, PetscInt face)> row,
              std::function<double(double t, PetscInt face)> right) {
  return [row = std::move(row), right = std::move(right)](double t, Mat G, Vec g) {
    PetscInt first = 0;
    PetscInt last = 0;
    check(MatGetOwnershipRange(G, &first, &last));
    {
      const WriteArray values(g);
      for (PetscInt face = first; face < last; ++face) {
        const std::vector<double> entries = row(t, face);
        for (std::size_t j = 0; j < entries.size(); ++j)
          check(MatSetValue(G, face, static_cast<PetscInt>(j), entries[j], INSERT_VALUES));
        values[face - first] = right(t, face);
      }
    }
    check(MatAssemblyBegin(G, MAT_FINAL_ASSEMBLY));
    check(MatAssemblyEnd(G, MAT_FINAL_ASSEMBLY));
  };
}

/// Largest distance, over all rows, from an exact solution.
double sup_error(const History& run, const std::function<std::vector<double>(double)>& exact) {
  double worst = 0.0;
  for (std::size_t k = 0; k < run.t.size(); ++k)
    worst = std::max(worst, distance(run.u[k], exact(run.t[k])));
  return worst;
}

/// The error of `run` with 80, 160, 320 steps: order one, from both sides (an order too good is a bug, too).
/// Implicit one-step scheme: order 1 + O(h); an event somewhere within its step moves an error by some per
/// cent.
void expect_order_one(const std::function<History(PetscInt steps)>& run,
                      const std::function<std::vector<double>(double)>& exact, double band = 0.1) {
  double previous = 0.0;
  for (const PetscInt steps : {80, 160, 320}) {
    const History result = run(steps);
    EXPECT_TRUE(result.certified);
    const double error = sup_error(result, exact);
    if (previous > 0.0) {
      EXPECT_NEAR(std::log2(previous / error), 1.0, band) << steps << " steps, error " << error;
    }
    previous = error;
  }
}

// ---- closed forms ---------------------------------------------------------------------------------

// -u' - u in N_[l(t), oo)(u), l = 0.5 + 0.4 sin(2 pi t), u(0) = 1. Free decay until it meets l; then u = l
// while the measure l' + l is positive; at its first zero u falls behind l, decaying freely, and so on.
TEST(CatchingUpBox, DecayOnAMovingBoundConvergesWithOrderOne) {
  const Signal lower{0.5, 0.4, 1.0, 0.0};
  const auto measure = [&](double t) { return lower.value(t, 1) + lower.value(t); };
  const auto root = [](const std::function<double(double)>& f, double from) {
    double t = from + 1e-3;  // later than rounding of a root at `from`, earlier than the next one
    const bool positive = f(t) > 0.0;
    while (t < 2.5 && (f(t) > 0.0) == positive)
      t += 1e-3;
    double low = t - 1e-3;
    double high = t;
    for (int k = 0; k < 60; ++k) {
      const double middle = 0.5 * (low + high);
      ((f(middle) > 0.0) == positive ? low : high) = middle;
    }
    return 0.5 * (low + high);
  };
  struct Phase {
    double begin, value;
    bool held;
  };
  std::vector<Phase> phases = {{0.0, 1.0, false}};
  while (phases.back().begin < 2.0 && phases.size() < 20) {
    const Phase last = phases.back();
    const auto free = [&](double t) { return last.value * std::exp(last.begin - t) - lower.value(t); };
    const double end = root(last.held ? std::function<double(double)>(measure) : free, last.begin);
    phases.push_back({end, lower.value(end), !last.held});
  }
  ASSERT_GE(phases.size(), 4U);
  ASSERT_LE(phases.size(), 8U);
  const auto exact = [&](double t) {
    std::size_t k = 0;
    while (k + 1 < phases.size() && phases[k + 1].begin <= t)
      ++k;
    return std::vector<double>{phases[k].held ? lower.value(t)
                                              : phases[k].value * std::exp(phases[k].begin - t)};
  };
  const auto run = [&](PetscInt steps) {
    return march_alone({.u0 = {1.0}, .A = {-1.0}, .lower = {lower}}, {0.0, 2.0, steps});
  };
  expect_order_one(run, exact, 0.2);  // contact and release fall anywhere within a step

  // What is held is exactly on the bound, and the measures are those of the equation, O(h^2) each.
  const History fine = run(1000);
  int held = 0;
  for (std::size_t k = 1; k < fine.t.size(); ++k) {
    if (fine.mu[k][0] == 0.0) continue;
    ++held;
    EXPECT_EQ(fine.u[k][0], lower.value(fine.t[k]));
    EXPECT_EQ(fine.w[k][0], 0.0);
    EXPECT_GT(fine.mu[k][0], 0.0);
    if (fine.mu[k - 1][0] > 0.0) {
      EXPECT_NEAR(fine.mu[k][0], 2e-3 * measure(fine.t[k]), 0.5 * 4e-6 * 0.4 * 4.0 * pi * pi * 1.1);
    }
  }
  EXPECT_GT(held, 200);
}

// A half-plane n.u >= v t pushes a point from u_0: u = u_0 + n max(0, v t - n.u_0), at every grid time up to
// rounding.
TEST(CatchingUpPolyhedron, AHalfPlaneOfConstantSpeedIsFollowedExactly) {
  const std::vector<double> normal = {0.6, 0.8};
  const double speed = 1.5;
  const auto faces =
      turning([&](double, PetscInt) { return normal; }, [&](double t, PetscInt) { return speed * t; });
  DenseSweeping given{.u0 = {0.3, 0.4}, .G = normal, .g = {Signal{}}, .faces_turn = true};
  const History run = march(given, {0.0, 2.0, 37}, false, faces);
  ASSERT_TRUE(run.certified);
  EXPECT_LE(sup_error(run,
                      [&](double t) {
                        const double push = std::max(0.0, speed * t - 0.5);
                        return std::vector<double>{0.3 + 0.6 * push, 0.4 + 0.8 * push};
                      }),
            37 * 4 * epsilon);       // a rounding of values up to 3 in each step
  ASSERT_EQ(run.events.size(), 1U);  // one contact, no lift-off
  EXPECT_NEAR(run.events[0].t, 0.5 / speed, 2.0 / 37);

  // With A = -a I and f along the face: u = v t n + s(t) (-0.8, 0.6), s' = -a s + p, once in contact.
  const double a = 2.0;
  const double p = 0.5;
  given.u0 = {0.0, 0.0};
  given.A = {-a, 0.0, 0.0, -a};
  given.f = {Signal{-0.8 * p, 0, 0, 0}, Signal{0.6 * p, 0, 0, 0}};
  expect_order_one(
      [&](PetscInt steps) {
        return march_alone(given, {0.0, 2.0, steps}, faces);
      },
      [&](double t) {
        const double s = p / a * (1.0 - std::exp(-a * t));
        return std::vector<double>{0.6 * speed * t - 0.8 * s, 0.8 * speed * t + 0.6 * s};
      });
}

// A half-plane n.u >= g that turns, n = (cos wt, sin wt), e = (-sin wt, cos wt). In contact u = g n + s e,
// and u' = mu n gives s' = -g w and mu = -s w: the point is pushed along the involute of a circle of radius
// g.
TEST(CatchingUpPolyhedron, ATurningHalfPlanePushesAlongAnInvolute) {
  const double g = 0.5;
  const double omega = 1.2;
  const auto faces = turning(
      [&](double t, PetscInt) {
        return std::vector<double>{std::cos(omega * t), std::sin(omega * t)};
      },
      [&](double, PetscInt) { return g; });
  const DenseSweeping given{.u0 = {g, -0.3}, .G = {1.0, 0.0}, .g = {Signal{}}, .faces_turn = true};
  expect_order_one(
      [&](PetscInt steps) {
        return march_alone(given, {0.0, 3.0, steps}, faces);
      },
      [&](double t) {
        const double c = std::cos(omega * t);
        const double d = std::sin(omega * t);
        const double s = -0.3 - g * omega * t;
        return std::vector<double>{g * c - s * d, g * d + s * c};
      },
      0.05);
}

// A point in a turning regular polygon of inradius rho, at distance r > rho from the centre. It rests until a
// face comes by; then, with m the inward normal, u = -rho m + s e(m), where s' = rho w runs from -sqrt(r^2 -
// rho^2) to 0: the measure -s w is then used up, and the point stays for ever on the circle of radius rho,
// which no face enters.
TEST(CatchingUpPolyhedron, ATurningPolygonLeavesThePointOnItsIncircle) {
  const double rho = 0.8;
  const double omega = 2.0;
  for (const int corners : {3, 8}) {
    const double radius = rho / std::cos(pi / corners) - 0.25 * rho * (1.0 / std::cos(pi / corners) - 1.0);
    const double s0 = std::sqrt(radius * radius - rho * rho);
    const double from_contact =
        std::acos(rho / radius);  // from the direction of the point to the foot of the face
    const double first_contact = pi / corners - from_contact;
    const auto inward = [&](double t, PetscInt face) {
      const double angle = omega * t + 2.0 * pi * static_cast<double>(face) / corners;
      return std::vector<double>{-std::cos(angle), -std::sin(angle)};
    };
    const auto faces = turning(inward, [&](double, PetscInt) { return -rho; });
    // The point starts at the direction of a corner, half way between faces 0 and 1; face 0 comes to it.
    const double direction = pi / corners;
    DenseSweeping given{.u0 = {radius * std::cos(direction), radius * std::sin(direction)},
                        .faces_turn = true};
    for (int face = 0; face < corners; ++face)
      for (const double entry : inward(0.0, face))
        given.G.push_back(entry);
    given.g.assign(static_cast<std::size_t>(corners), Signal{-rho, 0, 0, 0});
    const double contact = first_contact / omega;
    const double release = contact + s0 / (rho * omega);
    const auto exact = [&](double t) {
      if (t < contact) return given.u0;
      const double angle = omega * std::min(t, release);  // of the outward normal of face 0
      const double s = s0 - rho * omega * (std::min(t, release) - contact);
      return std::vector<double>{rho * std::cos(angle) - s * std::sin(angle),
                                 rho * std::sin(angle) + s * std::cos(angle)};
    };
    EXPECT_NEAR(distance(exact(contact), given.u0), 0.0, 1e-14);  // the two phases meet
    expect_order_one(
        [&](PetscInt steps) {
          return march_alone(given, {0.0, 1.5, steps}, faces);
        },
        exact, 0.15);
  }
}

// ---- play and stop --------------------------------------------------------------------------------

// Play: -u' in N_[y - r, y + r](u). Between the turning points of y, all of them grid times here, u either
// rests or follows y at the distance r: exact at every grid time but for the rounding of y -+ r. The sum of
// |mu| over a cycle is what the input drags along, 4 (a - r).
TEST(Play, IsExactOnMonotonePieces) {
  const double a = 2.0;
  const double r = 0.5;
  const PetscInt steps = 800;  // two cycles
  const History run =
      march({.u0 = {0.0}, .lower = {Signal{-r, a, 1.0, 0.0}}, .upper = {Signal{r, a, 1.0, 0.0}}},
            {0.0, 2.0, steps});
  ASSERT_TRUE(run.certified);
  EXPECT_EQ(run.predicted, steps);
  const auto y = [&](double t) { return a * std::sin(2.0 * pi * t); };
  double pushed = 0.0;
  for (std::size_t k = 0; k < run.t.size(); ++k) {
    const double t = run.t[k];
    const double phase = t - std::floor(t);
    double exact = 0.0;
    if (t <= 0.25)
      exact = std::max(0.0, y(t) - r);
    else if (phase > 0.25 && phase <= 0.75)
      exact = std::min(a - r, y(t) + r);
    else
      exact = std::max(r - a, y(t) - r);
    EXPECT_NEAR(run.u[k][0], exact, 4 * a * epsilon) << t;
    if (t > 1.0) pushed += std::abs(run.mu[k][0]);
  }
  EXPECT_NEAR(pushed, 4.0 * (a - r), 400 * 2 * epsilon);
}

// Stop: -s' in N_[-r, r](s) - y'. Saturated it is on the bound, exactly; on the way it sums h y'(t_k), for
// which there is a closed form (a sum of cosines), and is first order against s = y - play.
TEST(Stop, SumsTheRateOfItsInput) {
  const double a = 2.0;
  const double r = 0.5;
  const double omega = 2.0 * pi;
  const DenseSweeping given{.u0 = {0.0},
                            .f = {Signal{0.0, a * omega, 1.0, 0.5 * pi}},
                            .lower = {Signal{-r, 0, 0, 0}},
                            .upper = {Signal{r, 0, 0, 0}}};
  const auto exact = [&](double t) {
    const double y = a * std::sin(omega * t);
    const double phase = t - std::floor(t);
    if (t <= 0.25) return std::vector<double>{std::min(r, y)};
    if (phase > 0.25 && phase <= 0.75) return std::vector<double>{std::max(-r, y - (a - r))};
    return std::vector<double>{std::min(r, y + (a - r))};
  };
  expect_order_one([&](PetscInt steps) { return march_alone(given, {0.0, 2.0, 4 * steps}); }, exact);

  const PetscInt steps = 200;
  const double h = 1.0 / steps;
  const History run = march(given, {0.0, 1.0, steps});
  // sum_{j<=k} h a w cos(w t_j) = y_h(t_k) with
  const auto y_h = [&](std::size_t k) {
    const double t = h * static_cast<double>(k);
    return a * omega * h * (std::sin(omega * (t + 0.5 * h)) - std::sin(0.5 * omega * h)) /
           (2.0 * std::sin(0.5 * omega * h));
  };
  double play = 0.0;
  for (std::size_t k = 1; k < run.u.size(); ++k) {
    play = std::clamp(play, y_h(k) - r, y_h(k) + r);
    EXPECT_NEAR(run.u[k][0], y_h(k) - play, 200 * 4 * epsilon);
    if (run.mu[k][0] != 0.0) {
      EXPECT_EQ(std::abs(run.u[k][0]), r);
    }
  }
}

// ---- projections ----------------------------------------------------------------------------------

/// Small polyhedra side by side, as one process: each a copy of its own in `components` dimensions.
struct Polyhedra {
  std::size_t count, components, faces;
  DenseSweeping process;

  Eigen::MatrixXd G(std::size_t copy) const {
    const std::size_t n = count * components;
    Eigen::MatrixXd result(faces, components);
    for (std::size_t i = 0; i < faces; ++i)
      for (std::size_t j = 0; j < components; ++j)
        result(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) =
            process.G[(copy * faces + i) * n + copy * components + j];
    return result;
  }
  Eigen::VectorXd g(std::size_t copy, double t) const {
    Eigen::VectorXd result(faces);
    for (std::size_t i = 0; i < faces; ++i)
      result(static_cast<Eigen::Index>(i)) = process.g[copy * faces + i].value(t);
    return result;
  }
  /// I - hA of a copy.
  Eigen::MatrixXd K(std::size_t copy, double h) const {
    const auto size = static_cast<Eigen::Index>(components);
    Eigen::MatrixXd result = Eigen::MatrixXd::Identity(size, size);
    const std::size_t n = count * components;
    for (std::size_t i = 0; i < components && !process.A.empty(); ++i)
      for (std::size_t j = 0; j < components; ++j)
        result(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) -=
            h * process.A[(copy * components + i) * n + copy * components + j];
    return result;
  }
  Eigen::VectorXd of(const std::vector<double>& u, std::size_t copy) const {
    return Eigen::Map<const Eigen::VectorXd>(u.data() + copy * components,
                                             static_cast<Eigen::Index>(components));
  }
};

/// Many faces meet at a point that is theirs in common (half of the time all of them), many are small
/// integers, repeated, opposite, or scaled by 1000; they move by up to half of their distance.
Polyhedra random_polyhedra(unsigned seed, std::size_t count, std::size_t components, std::size_t faces,
                           bool with_A) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform;
  std::exponential_distribution<double> exponential;
  Polyhedra p{count, components, faces, {}};
  const std::size_t n = count * components;
  p.process.u0.resize(n);
  p.process.G.assign(count * faces * n, 0.0);
  if (with_A) p.process.A.assign(n * n, 0.0);
  for (std::size_t copy = 0; copy < count; ++copy) {
    const double degenerate = uniform(random) < 0.5 ? 1.0 : uniform(random);
    const bool integers = uniform(random) < 0.5;
    std::vector<double> centre(components);
    for (std::size_t j = 0; j < components; ++j) {
      centre[j] = integers ? std::round(normal(random)) : normal(random);
      p.process.u0[copy * components + j] = centre[j] + 3.0 * normal(random);
    }
    const bool rigid = uniform(random) < 0.5;
    std::vector<double> way(components);
    for (double& entry : way)
      entry = normal(random);
    std::vector<std::vector<double>> rows;
    for (std::size_t i = 0; i < faces; ++i) {
      std::vector<double> row(components, 0.0);
      if (i > 1 && uniform(random) < 0.3) {
        row = rows[random() % rows.size()];
        const double factor = uniform(random) < 0.5 ? 1.0 : 1000.0;
        for (double& entry : row)
          entry *= factor;
      }
      while (std::all_of(row.begin(), row.end(), [](double entry) { return entry == 0.0; }))
        for (double& entry : row)
          entry = integers ? std::round(1.5 * normal(random)) : normal(random);
      rows.push_back(row);
      double through = 0.0;
      double length = 0.0;
      for (std::size_t j = 0; j < components; ++j) {
        p.process.G[(copy * faces + i) * n + copy * components + j] = row[j];
        through += row[j] * centre[j];
        length = std::hypot(length, row[j]);
      }
      const double slack = uniform(random) < degenerate ? 0.0 : length * exponential(random);
      const double along = std::inner_product(row.begin(), row.end(), way.begin(), 0.0);
      if (rigid)
        p.process.g.push_back({through - slack, along, 1.0, 1.0});
      else
        p.process.g.push_back(
            {through - slack - 0.5 * length, 0.5 * length * uniform(random), 1.0, 6.0 * uniform(random)});
    }
    for (std::size_t i = 0; i < components && with_A; ++i)  // skew, with damping: monotone, not symmetric
      for (std::size_t j = 0; j < i; ++j) {
        const double turn = 5.0 * normal(random);
        p.process.A[(copy * components + i) * n + copy * components + j] = turn;
        p.process.A[(copy * components + j) * n + copy * components + i] = -turn;
        p.process.A[(copy * components + i) * n + copy * components + i] = -uniform(random);
      }
  }
  return p;
}

/// Solves K u = c + G' y, 0 <= y _|_ G u - g >= 0 by trying every set of at most n faces: one of them has
/// independent rows and is right (Caratheodory).
Eigen::VectorXd by_enumeration(const Eigen::MatrixXd& K, const Eigen::VectorXd& c, const Eigen::MatrixXd& G,
                               const Eigen::VectorXd& g) {
  const Eigen::Index n = K.rows();
  Eigen::VectorXd best;
  double least =
      infinity;  // the worst violation of a condition: rounding for the right set, of order 1 for others
  std::vector<Eigen::Index> set;
  const std::function<void(Eigen::Index)> visit = [&](Eigen::Index next) {
    const auto size = static_cast<Eigen::Index>(set.size());
    Eigen::MatrixXd saddle = Eigen::MatrixXd::Zero(n + size, n + size);
    Eigen::VectorXd right(n + size);
    saddle.topLeftCorner(n, n) = K;
    right.head(n) = c;
    for (Eigen::Index i = 0; i < size; ++i) {
      const double length = G.row(set[static_cast<std::size_t>(i)]).norm();
      saddle.block(n + i, 0, 1, n) = G.row(set[static_cast<std::size_t>(i)]) / length;
      saddle.block(0, n + i, n, 1) = -saddle.block(n + i, 0, 1, n).transpose();
      right(n + i) = g(set[static_cast<std::size_t>(i)]) / length;
    }
    const Eigen::FullPivLU<Eigen::MatrixXd> factors(saddle);
    if (factors.rcond() > 1e-9) {
      const Eigen::VectorXd solution = factors.solve(right);
      const Eigen::VectorXd u = solution.head(n);
      double worst = 0.0;
      for (Eigen::Index i = 0; i < G.rows(); ++i)
        worst = std::max(worst, (g(i) - G.row(i).dot(u)) / G.row(i).norm());
      for (Eigen::Index i = 0; i < size; ++i)
        worst = std::max(worst, -solution(n + i));
      if (worst < least) {
        least = worst;
        best = u;
      }
    }
    if (size == n) return;
    for (Eigen::Index i = next; i < G.rows(); ++i) {
      set.push_back(i);
      visit(i + 1);
      set.pop_back();
    }
  };
  visit(0);
  EXPECT_LT(least, 1e-11);
  return best;
}

// Condition numbers of the vertices stay below about 1e3 here, and values below 10: rounding leaves 1e-12.
TEST(CatchingUpPolyhedron, ProjectsAsEnumerationDoes) {
  const TimeGrid grid{0.0, 1.0, 8};
  int vertices = 0;
  int crowded = 0;  // more active faces than dimensions
  for (const auto& [components, faces, with_A] :
       {std::tuple{2U, 9U, false}, {3U, 10U, false}, {3U, 8U, true}}) {
    const Polyhedra p = random_polyhedra(7 * components + faces, 24, components, faces, with_A);
    const History run = march(p.process, grid);
    ASSERT_TRUE(run.certified) << run.obstacle;
    EXPECT_EQ(run.predicted, grid.steps);
    for (std::size_t k = 1; k < run.t.size(); ++k)
      for (std::size_t copy = 0; copy < p.count; ++copy) {
        const Eigen::VectorXd expected =
            by_enumeration(p.K(copy, grid.h()), p.of(run.u[k - 1], copy), p.G(copy), p.g(copy, run.t[k]));
        const double error = (p.of(run.u[k], copy) - expected).norm();
        EXPECT_LE(error, 1e-12 * (1.0 + expected.norm())) << "copy " << copy << ", step " << k;
        std::size_t active = 0;
        for (std::size_t i = 0; i < faces; ++i)
          active += run.w[k][copy * faces + i] == 0.0 ? 1U : 0U;
        vertices += active >= components ? 1 : 0;
        crowded += active > components ? 1 : 0;
      }
  }
  EXPECT_GT(vertices, 100);
  EXPECT_GT(crowded, 40);
}

// Where faces are dependent, the measures are the smallest. x >= 0 twice, y >= 0, x + y >= 0, from (-1, -1):
// a, a, b, c with 2 a + c = 1, b + c = 1 and least 2 a^2 + b^2 + 2 c^2 are a = 2/7, b = 4/7, c = 3/7.
// Whatever happened before.
TEST(CatchingUpPolyhedron, DependentFacesShareTheirMeasure) {
  const DenseSweeping given{.u0 = {-1.0, -1.0},
                            .f = {Signal{-0.5, 0, 0, 0}, Signal{-0.5, 0, 0, 0}},
                            .G = {1, 0, 1, 0, 0, 1, 1, 1},
                            .g = std::vector<Signal>(4)};
  const History run = march(given, {0.0, 2.0, 4});
  ASSERT_TRUE(run.certified);
  for (std::size_t k = 1; k < run.u.size(); ++k) {
    const double size = k == 1 ? 1.25 : 0.25;  // what is projected: (-1, -1) + h f, then h f
    EXPECT_EQ(run.u[k], (std::vector<double>{0.0, 0.0}));
    const std::vector<double> expected = {2 * size / 7, 2 * size / 7, 4 * size / 7, 3 * size / 7};
    EXPECT_LE(distance(run.mu[k], expected), 1e-7);  // delta = 1e-8, and rounding over delta
  }
}

// Hundreds of faces around a point, meeting in fours and more: certified at every step, whatever the ranks.
TEST(CatchingUpPolyhedron, IsNotDisturbedByRedundancy) {
  for (const unsigned seed : {1U, 2U, 3U}) {
    const Polyhedra p = random_polyhedra(seed, 1, 4 + seed, 150, seed == 2);
    const History run = march(p.process, {0.0, 1.0, 8});
    EXPECT_TRUE(run.certified) << run.obstacle;
    EXPECT_EQ(run.predicted, 8);
    EXPECT_LE(run.worst_ratio, 1e-14);
  }
}

// The wedge y >= x / 1e6, y <= -x / 1e6 + 1e-7 is open towards x = -oo only beyond x = 0.05: nearly parallel
// faces, a measure of 1e5. Its tip is known to 1e-16 * 1e6.
TEST(CatchingUpPolyhedron, NearlyParallelFaces) {
  const DenseSweeping given{
      .u0 = {1.0, 0.0}, .G = {-1e-6, 1.0, -1e-6, -1.0}, .g = {Signal{}, Signal{-1e-7, 0, 0, 0}}};
  const History run = march(given, {0.0, 1.0, 2});
  ASSERT_TRUE(run.certified) << run.obstacle;
  EXPECT_NEAR(run.u[1][0], 0.05, 1e-9);
  EXPECT_NEAR(run.u[1][1], 5e-8, 1e-15);
  EXPECT_NEAR(run.mu[1][0], 0.95 / 2e-6, 1e-3);
}

// Box with coupling: every set of lower, free and upper components is tried.
TEST(CatchingUpBox, SolvesAsEnumerationDoes) {
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  constexpr std::size_t n = 4;
  const TimeGrid grid{0.0, 1.0, 10};
  int held = 0;
  for (int sample = 0; sample < 8; ++sample) {
    DenseSweeping given;
    for (std::size_t i = 0; i < n; ++i) {
      given.u0.push_back(normal(random));
      given.f.push_back({2.0 * normal(random), normal(random), 1.0, normal(random)});
      const bool point = i == 3;  // an interval of length 0
      given.lower.push_back({i == 2 ? -infinity : -0.3, i == 2 ? 0.0 : 0.5, 1.0, 1.0 * sample});
      given.upper.push_back({point ? -0.3 : 0.2, 0.5, 1.0, 1.0 * sample});
      for (std::size_t j = 0; j < n; ++j)
        given.A.push_back(normal(random) - (i == j ? 4.0 : 0.0));
    }
    const History run = march(given, grid);
    ASSERT_TRUE(run.certified);
    Eigen::MatrixXd K = Eigen::MatrixXd::Identity(n, n);
    for (std::size_t i = 0; i < n; ++i)
      for (std::size_t j = 0; j < n; ++j)
        K(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) -= grid.h() * given.A[i * n + j];
    for (std::size_t k = 1; k < run.t.size(); ++k) {
      // The box as a polyhedron.
      Eigen::MatrixXd G(2 * n, n);
      Eigen::VectorXd g(2 * n);
      Eigen::VectorXd c(n);
      G << Eigen::MatrixXd::Identity(n, n), -Eigen::MatrixXd::Identity(n, n);
      for (std::size_t i = 0; i < n; ++i) {
        const auto row = static_cast<Eigen::Index>(i);
        g(row) = std::max(-1e3, given.lower[i].value(run.t[k]));
        g(row + static_cast<Eigen::Index>(n)) = -given.upper[i].value(run.t[k]);
        c(row) = run.u[k - 1][i] + grid.h() * given.f[i].value(run.t[k]);
      }
      const Eigen::VectorXd expected = by_enumeration(K, c, G, g);
      for (std::size_t i = 0; i < n; ++i) {
        EXPECT_NEAR(run.u[k][i], expected(static_cast<Eigen::Index>(i)),
                    1e-13);  // well conditioned, of order 1
        if (run.mu[k][i] == 0.0) continue;
        ++held;
        // On the bound, which is found as sin a cos b + cos a sin b.
        EXPECT_NEAR(run.u[k][i], (run.mu[k][i] > 0.0 ? given.lower : given.upper)[i].value(run.t[k]), 1e-15);
        EXPECT_EQ(run.w[k][i], 0.0);
      }
    }
  }
  EXPECT_GT(held, 100);
}

// SNESVI on its own finds the same, by both types, where nothing is singular.
TEST(CatchingUp, SnesAloneFindsTheSame) {
  const TimeGrid grid{0.0, 1.0, 10};
  const DenseSweeping polygon{
      .u0 = {0.0, 0.0},
      .A = {-1.0, 2.0, -2.0, -1.0},
      .G = {1, 0.2, -0.5, 1, -0.5, -1},
      .g = {Signal{-0.4, 1.0, 1.0, 0.0}, Signal{-0.5, 0.5, 1.0, 1.0}, Signal{-0.7, 0.5, 1.0, 2.0}}};
  const DenseSweeping box{.u0 = {0.0, 0.0},
                          .A = {-1.0, 2.0, -2.0, -1.0},
                          .lower = {Signal{-0.4, 1.0, 1.0, 0.0}, Signal{-0.5, 0.5, 1.0, 1.0}},
                          .upper = {Signal{0.4, 1.0, 1.0, 0.0}, Signal{infinity, 0.0, 0.0, 0.0}}};
  for (const DenseSweeping* given : {&polygon, &box}) {
    const History reference = march(*given, grid);
    ASSERT_TRUE(reference.certified);
    for (const char* type : {SNESVINEWTONRSLS, SNESVINEWTONSSLS}) {
      const ScopedOption chosen("-snes_type", type);
      const ScopedOption none("-sweepvi_predictor", "none");
      const History run = march(*given, grid);
      ASSERT_TRUE(run.certified) << type;
      EXPECT_EQ(run.predicted, 0);
      for (std::size_t k = 0; k < run.u.size(); ++k)
        EXPECT_LE(distance(run.u[k], reference.u[k]), 1e-11);  // 1e-12 of the terms is where SNES may stop
    }
  }
}

// ---- many of them ---------------------------------------------------------------------------------

// u_{i+1} - u_i >= d, u_0 >= y(t): while y rises, u_i = max(u_i(0), y + i d); when it falls, all rest. In a
// step the face below element i carries those above it that move.
TEST(CatchingUpPolyhedron, AChainIsPushedTogether) {
  constexpr std::size_t n = 60;
  const double d = 0.01;
  const Signal y{0.0, 1.0, 0.5, 0.0};
  DenseSweeping given;
  given.G.assign(n * n, 0.0);
  for (std::size_t i = 0; i < n; ++i) {
    given.u0.push_back(0.02 * static_cast<double>(i) + 0.005);
    given.G[i * n + i] = 1.0;
    if (i > 0) given.G[i * n + i - 1] = -1.0;
    given.g.push_back(i == 0 ? y : Signal{d, 0, 0, 0});
  }
  const TimeGrid grid{0.0, 1.0, 40};  // up to 0.5 s, and back
  for (const bool deal_out : {false, true}) {
    const History run = march(given, grid, deal_out);
    ASSERT_TRUE(run.certified);
    EXPECT_EQ(run.predicted, 40);
    for (std::size_t k = 1; k < run.t.size(); ++k) {
      const double height = y.value(std::min(run.t[k], 0.5));
      std::vector<double> moved(n);
      for (std::size_t i = 0; i < n; ++i) {
        EXPECT_NEAR(run.u[k][i], std::max(given.u0[i], height + d * static_cast<double>(i)),
                    1e-13);  // 40 sums of order 1
        moved[i] = run.u[k][i] - run.u[k - 1][i];
      }
      double above = 0.0;
      for (std::size_t i = n; i-- > 0;) {
        above += moved[i];
        EXPECT_NEAR(run.mu[k][i], above, 1e-12);
      }
    }
    EXPECT_EQ(run.u[20][0], 1.0);  // on its bound, exactly
    std::size_t impacts = 0;
    for (const auto& event : run.events)
      impacts += event.impact ? 1U : 0U;
    EXPECT_EQ(impacts, n);
  }
}

TEST(CatchingUpPolyhedron, RanksAndOrderDoNotMatter) {
  const Polyhedra p = random_polyhedra(5, 10, 3, 9, true);
  const TimeGrid grid{0.0, 1.0, 6};
  const History in_order_given = march(p.process, grid, false);
  const History dealt_out = march(p.process, grid, true);
  for (std::size_t k = 0; k < in_order_given.u.size(); ++k) {
    EXPECT_LE(distance(in_order_given.u[k], dealt_out.u[k]), 1e-12);
    // Measures of dependent faces are the smallest ones up to rounding over delta = 1e-8, of values up to 10.
    EXPECT_LE(distance(in_order_given.mu[k], dealt_out.mu[k]), 1e-6);
  }
}

// ---- empty sets and nonsense ----------------------------------------------------------------------

void expect_bad_input(const std::function<void()>& action, const std::string& text) {
  try {
    action();
    ADD_FAILURE() << "nothing was thrown; expected " << text;
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ExitCode::bad_input);
    EXPECT_NE(std::string(error.what()).find(text), std::string::npos) << error.what();
  }
}

TEST(CatchingUpBox, AnEmptyBoxIsRefusedWithItsTime) {
  const DenseSweeping given{.u0 = {0.0, 0.0},
                            .lower = {Signal{}, Signal{0.0, 1.0, 1.0, 0.0}},
                            .upper = {Signal{1.0, 0.0, 0.0, 0.0}, Signal{0.5, 0.0, 0.0, 0.0}}};
  // sin(2 pi t) > 0.5 from t = 1/12 on.
  expect_bad_input([&] { march(given, {0.0, 1.0, 100}); }, "K(t) is empty at t = 0.09 s: component 1");
  EXPECT_TRUE(march(given, {0.0, 0.08, 8}).certified);
}

TEST(CatchingUpPolyhedron, AnEmptyPolyhedronIsProvedWithItsTime) {
  // x + y >= 0.3 sin(2 pi t), x <= 0, y <= 0: empty once the sine is positive, by 0.3 sin / (1 + 1 + sqrt 2)
  // at least.
  DenseSweeping given{.u0 = {0.0, 0.0},
                      .G = {1, 1, -1, 0, 0, -1, 1, -1},
                      .g = {Signal{0.0, 0.3, 1.0, pi}, Signal{}, Signal{}, Signal{-10.0, 0, 0, 0}}};
  const History run = march(given, {0.0, 1.0, 16});
  EXPECT_FALSE(run.certified);
  EXPECT_EQ(run.steps, 8);  // up to 0.5 s, where the sine changes sign
  const std::string gap = std::to_string(0.3 * std::sin(pi / 8) / (2 + std::sqrt(2))).substr(0, 7);
  EXPECT_EQ(run.obstacle.find("K(t) is empty at t = 0.5625 s: faces 0, 1, 2 exclude every point, by " + gap),
            0U)
      << run.obstacle << ", expected " << gap;

  given.g[0] = Signal{0.1, 0, 0, 0};
  expect_bad_input([&] { march(given, {0.0, 1.0, 16}); }, "K(t) is empty at t = 0 s: faces 0, 1, 2 exclude");
}

// A set that misses being empty is not called so, nor one that is a point; one that is empty is, with many
// faces too.
TEST(CatchingUpPolyhedron, EmptinessIsProvedOrNotClaimed) {
  std::mt19937 random(11);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform;
  const TimeGrid grid{0.0, 1.0, 1};
  for (int sample = 0; sample < 40; ++sample) {
    const bool together = sample < 3;
    const std::size_t n = 2 + random() % 4;
    const std::size_t m = 12;
    DenseSweeping given;
    Eigen::VectorXd centre(n);
    for (std::size_t j = 0; j < n; ++j) {
      centre(static_cast<Eigen::Index>(j)) = normal(random);
      given.u0.push_back(normal(random));
    }
    Eigen::VectorXd last = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(n));
    double last_g = 0.0;
    for (std::size_t i = 0; i < m; ++i) {
      Eigen::VectorXd row(n);
      for (Eigen::Index j = 0; j < row.size(); ++j) {
        row(j) = normal(random);
        given.G.push_back(row(j));
      }
      const double g = row.dot(centre) - (i < 3 ? 0.0 : uniform(random));
      given.g.push_back({g, 0, 0, 0});
      if (i >= 3) continue;  // some of the faces through the centre are contradicted by the last one
      const double weight = uniform(random);
      last -= weight * row;
      last_g -= weight * g;
    }
    given.G.insert(given.G.end(), last.data(), last.data() + last.size());
    for (const double gap : {-1e-3, -1e-7, 0.0, 1e-6, 1e-3, 1.0}) {
      DenseSweeping moved = given;
      moved.g.push_back({last_g + gap * last.norm(), 0, 0, 0});
      if (gap <= 0.0) {
        const History run = together ? march(moved, grid) : march_alone(moved, grid);
        EXPECT_TRUE(run.certified || gap == 0.0) << run.obstacle;  // a point up to rounding may be none
        EXPECT_EQ(run.obstacle, "");
      } else {
        expect_bad_input([&] { together ? march(moved, grid) : march_alone(moved, grid); },
                         "K(t) is empty at t = 0 s");
      }
    }
  }
}

TEST(CatchingUp, AStartOutsideIsProjectedByTheFirstStep) {
  const History box = march(
      {.u0 = {-2.0, 3.0}, .lower = {Signal{}, Signal{}}, .upper = {Signal{1, 0, 0, 0}, Signal{1, 0, 0, 0}}},
      {0.0, 1.0, 2});
  EXPECT_EQ(box.w[0], (std::vector<double>{-2.0, -2.0}));
  EXPECT_EQ(box.u[1], (std::vector<double>{0.0, 1.0}));
  EXPECT_EQ(box.mu[1], (std::vector<double>{2.0, -2.0}));
  EXPECT_EQ(box.u[2], box.u[1]);
  ASSERT_EQ(box.events.size(), 2U);
  EXPECT_EQ(box.events[0].t, 0.5);
  EXPECT_TRUE(box.events[0].impact && box.events[1].impact);
  const History corner = march(
      {.u0 = {-2.0, -3.0}, .G = {1, 0, 0, 4}, .g = {Signal{1, 0, 0, 0}, Signal{2, 0, 0, 0}}}, {0.0, 1.0, 2});
  EXPECT_EQ(corner.u[1], (std::vector<double>{1.0, 0.5}));
  EXPECT_EQ(corner.u[2], corner.u[1]);
  EXPECT_EQ(corner.events.size(), 2U);
}

TEST(CatchingUp, WhatMakesNoSenseIsRefused) {
  const auto refused = [](const DenseSweeping& given, const std::string& text) {
    expect_bad_input([&] { march(given, {0.0, 1.0, 1}); }, text);
  };
  const Signal zero{};
  refused({.u0 = {}}, "at least one component");
  refused({.u0 = {0.0}}, "no set is given");
  refused({.u0 = {0.0}, .lower = {zero}, .G = {1}, .g = {zero}}, "both a box and a polyhedron");
  refused({.u0 = {0.0}, .lower = {zero, zero}}, "lower has 2 entries, expected 1");
  refused({.u0 = {0.0}, .f = {zero, zero}, .lower = {zero}}, "f has 2 entries, expected 1");
  refused({.u0 = {0.0}, .A = {1, 2}, .lower = {zero}}, "A has 2 entries, expected 1");
  refused({.u0 = {0.0}, .G = {1, 2}, .g = {zero}}, "G has 2 entries, expected 1");
  refused({.u0 = {0.0, 0.0}, .G = {1, 2, 0, 0}, .g = {zero, zero}}, "row 1 of G is zero");
  refused({.u0 = {infinity}, .lower = {zero}}, "u0 holds a number that is not finite");
  refused({.u0 = {0.0}, .lower = {Signal{infinity, 0, 0, 0}}}, "lower holds a number that is not finite");
  refused({.u0 = {0.0}, .G = {1}, .g = {Signal{-infinity, 0, 0, 0}}}, "g holds a number that is not finite");
}

}  // namespace
}  // namespace sweepvi::test
