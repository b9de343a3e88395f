// ranks: 1 2
// several: TwoWalls.BothForms*:TwoWalls.DegreesZeroAndOne*:TwoWalls.NoStepPassesBoth
// timeout: 300
// Two-sided constraints, 0 <= w <= wmax: mirror symmetry, exact impact times, walls passed in one step,
// degrees 0 and 1 with D, and the three schemes.
#include <gtest/gtest.h>

#include <numbers>

#include "dvi/level_state.hpp"
#include "dvi/runs.hpp"

namespace sweepvi::test {
namespace {

constexpr double inf = PETSC_INFINITY;

/// The same with x -> -x, f -> -f, w -> wmax - w: what was below is above. Only for w0 = 0.
DenseSystem reflected(DenseSystem given) {
  for (double& x : given.x0)
    x = -x;
  for (Signal& signal : given.f)
    signal = signal.scaled(-1.0);
  given.w0 = given.wmax;
  return given;
}

struct Named {
  const char* name;
  DenseSystem system;
};

/// One constraint each, of degree 1, 2, 3 (with zero dynamics) and 4 (a flexible joint), driven from wall to
/// wall; and two flexible joints whose measures reach each other's outputs.
std::vector<Named> driven_systems() {
  std::vector<Named> systems;
  systems.push_back(
      {"r = 1",
       {.A = {-0.2}, .B = {2.0}, .C = {1.0}, .x0 = {0.375}, .f = {{0.125, 2.0, 0.25, 0.0}}, .wmax = {1.0}}});
  systems.push_back({"r = 2",
                     {.A = {0, 1, 0, -0.125},
                      .B = {0, 1.5},
                      .C = {1, 0},
                      .x0 = {0.375, 0.0},
                      .f = {{0.0, 0.1, 0.2, 0.3}, {0.0, 2.0, 0.25, 0.0}},
                      .wmax = {0.75}}});
  systems.push_back({"r = 3",
                     {.A = {0, 1, 0, 0, 0, 0, 0, 1, 0, 0, -1, -1, -1, 0, 1, 0, 0, 0, 0, 1, 1, 0, 0, -1, 0},
                      .B = {0, 0, 1, 0, 0},
                      .C = {1, 0, 0, 0, 0},
                      .x0 = {0.75, 0, 0, 0, 0},
                      .f = {{}, {0.0, 0.1, 0.2, 0.4}, {0.5, 3.0, 0.15, 0.0}, {}, {-0.5}},
                      .wmax = {1.0}}});
  systems.push_back({"r = 4",
                     {.A = {0, 0, 1, 0, 0, 0, 0, 1, -11, 10, -0.5, 0, 10, -10, 0, -0.5},
                      .B = {0, 0, 0, 0.5},
                      .C = {1, 0, 0, 0},
                      .x0 = {0.375, 0.375, 0, 0},
                      .f = {{}, {}, {0.5, 3.0, 0.2, 0.0}, {}},
                      .wmax = {1.0}}});
  std::vector<double> a(64, 0.0);
  const auto at = [&](int i, int j) -> double& { return a[static_cast<std::size_t>(8 * i + j)]; };
  for (int i = 0; i < 4; ++i)
    at(i, 4 + i) = 1.0;  // x = (q1, p1, q2, p2, velocities)
  for (const int i : {0, 2}) {
    at(4 + i, i) = -12.0, at(4 + i, i + 1) = 10.0, at(4 + i, 2 - i) = 1.0;
    at(5 + i, i) = 10.0, at(5 + i, i + 1) = -10.0, at(5 + i, 5 + i) = -0.5;
  }
  std::vector<double> b(16, 0.0);
  std::vector<double> c(16, 0.0);
  b[5 * 2] = b[7 * 2 + 1] = 1.0;
  c[0] = c[8 + 2] = 1.0;
  std::vector<Signal> f(8);
  f[4] = {0.5, 3.0, 0.2, 0.0};
  f[6] = {0.25, 3.0, 0.15, 1.0};
  systems.push_back(
      {"two of r = 4",
       {.A = a, .B = b, .C = c, .x0 = {0.5, 0.5, 0.625, 0.625, 0, 0, 0, 0}, .f = f, .wmax = {1.0, 0.75}}});
  return systems;
}

const TimeGrid grid{0.0, 12.0, 400};

TEST(TwoWalls, MirrorSymmetry) {
  for (const Named& driven : driven_systems()) {
    for (const char* form : {"box-on-z", "primal-dual"}) {
      SCOPED_TRACE(std::string(driven.name) + ", " + form);
      const Record plain = simulate(driven.system, grid, {.form = form});
      const Record mirror = simulate(reflected(driven.system), grid, {.form = form});
      ASSERT_TRUE(plain.certified && mirror.certified);
      std::vector<std::vector<double>> x = mirror.x;
      std::vector<double> w = mirror.w;
      std::vector<double> z = mirror.z;
      std::vector<double> mu = mirror.mu;
      for (auto& row : x)
        for (double& value : row)
          value = -value;
      for (double& value : z)
        value = -value;
      for (double& value : mu)
        value = -value;
      for (std::size_t k = 0; k < plain.steps; ++k) {
        for (std::size_t a = 0; a < plain.constraints; ++a) {
          const double wmax = driven.system.wmax[a];
          w[plain.at(k, a)] = wmax - w[plain.at(k, a)];
          z[plain.at(k, a, 1)] += wmax;
        }
      }
      // What is bounded below in one is bounded above in the other: rounding differs, the steps do not.
      EXPECT_LE(worst(x, plain.x), 1e-12);
      EXPECT_LE(worst(w, plain.w), 1e-12);
      EXPECT_LE(worst(z, plain.z), 1e-12);
      EXPECT_LE(worst(mu, plain.mu), 1e-12);
      EXPECT_EQ(mirror.level, plain.level);
      std::vector<double> side = mirror.side;
      for (double& value : side)
        value = 0.0 - value;
      EXPECT_EQ(side, plain.side);
      ASSERT_EQ(mirror.events.size(), plain.events.size());
      for (std::size_t e = 0; e < plain.events.size(); ++e) {
        EXPECT_EQ(sign(mirror.events[e].side), -sign(plain.events[e].side));
        EXPECT_EQ(mirror.events[e].level, plain.events[e].level);
        EXPECT_EQ(mirror.events[e].impact, plain.events[e].impact);
        EXPECT_NEAR(mirror.events[e].impulse, -plain.events[e].impulse, 1e-10);
      }

      // It touches both walls and passes none. A wall pushes inwards only, and a constraint that stood at it
      // as the step began (with r = 4 a neighbour's impact may lift it off in that very step); on level 1 one
      // that gets there.
      for (std::size_t a = 0; a < plain.constraints; ++a) {
        const double wmax = driven.system.wmax[a];
        const auto r = static_cast<std::size_t>(plain.degree[a]);
        int at_wall[2] = {0, 0};
        for (std::size_t k = 0; k < plain.steps; ++k) {
          const double value = plain.w[plain.at(k, a)];
          EXPECT_GE(value, 0.0);
          EXPECT_LE(value, wmax);
          for (std::size_t i = 1; i <= r; ++i) {
            const double push = plain.mu[plain.at(k, a, i)];
            if (push == 0.0) continue;
            const Side wall = push > 0.0 ? Side::lower : Side::upper;
            if (i == 1) {
              EXPECT_EQ(value, push > 0.0 ? 0.0 : wmax);
            } else {
              EXPECT_EQ(plain.side[plain.at(k, a)], sign(wall)) << "level " << i;
            }
            at_wall[push > 0.0 ? 0 : 1] += i == r ? 1 : 0;
          }
        }
        EXPECT_GT(at_wall[0], 5);
        EXPECT_GT(at_wall[1], 5);
      }
    }
  }
}

TEST(TwoWalls, BothFormsAreTheSameStep) {
  for (const Named& driven : driven_systems()) {
    SCOPED_TRACE(driven.name);
    const Record box = simulate(driven.system, grid, {.form = "box-on-z"});
    ASSERT_TRUE(box.certified);
    for (const auto& [type, predictor] :
         {std::pair{SNESVINEWTONRSLS, "active-set"}, {SNESVINEWTONSSLS, "none"}}) {
      SCOPED_TRACE(std::string(type) + ", predictor " + predictor);
      const Record other =
          simulate(driven.system, grid, {.form = "primal-dual", .snes_type = type, .predictor = predictor});
      ASSERT_TRUE(other.certified);
      // Rounding of 400 steps; W has a condition below 100.
      EXPECT_LE(worst(other.x, box.x), 1e-11);
      EXPECT_LE(worst(other.z, box.z), 1e-11);
      EXPECT_LE(worst(other.w, box.w), 1e-11);
      EXPECT_LE(worst(other.mu, box.mu), 1e-11);
      EXPECT_EQ(other.level, box.level);
      EXPECT_EQ(other.side, box.side);
    }
  }
}

// ------------------------------------------------------------------------------------------ a driven mass

struct Contact {
  double t;
  Side side;
  bool impact;
};

/// q'' = F sin(omega t) between walls at 0 and L, plastic impacts. Flight from rest at (t0, q0), in closed
/// form; a mass at a wall stays until the force changes sign.
class DrivenMass {
public:
  static constexpr double F = 2.0, L = 0.8, frequency = 0.25, q0 = 0.3, end = 11.5;

  DrivenMass() {
    double t0 = 0.0;
    double q = q0;
    pieces_.push_back({t0, q, true});
    while (true) {
      // The first time outside the walls, to 1e-3 s, then by bisection.
      double before = t0;
      double after = t0;
      while (after <= end && inside(flight(t0, q, after))) {
        before = after;
        after += 1e-3;
      }
      if (after > end) return;
      for (int i = 0; i < 60; ++i) {
        const double middle = 0.5 * (before + after);
        (inside(flight(t0, q, middle)) ? before : after) = middle;
      }
      const Side side = flight(t0, q, after) > 0.5 * L ? Side::upper : Side::lower;
      contacts.push_back({before, side, true});
      q = side == Side::upper ? L : 0.0;
      pieces_.push_back({before, q, false});
      const double pushing = std::sin(omega * before) * (side == Side::upper ? 1.0 : -1.0);
      EXPECT_GT(pushing, 0.1);  // it stays, or this solution does not hold
      const double half_turn = std::numbers::pi / omega;
      t0 = half_turn * std::ceil(before / half_turn);
      if (t0 > end) return;
      contacts.push_back({t0, side, false});
      pieces_.push_back({t0, q, true});
    }
  }

  double at(double t) const {
    const auto next =
        std::find_if(pieces_.begin() + 1, pieces_.end(), [t](const Piece& piece) { return piece.t > t; });
    const Piece& piece = *(next - 1);
    return piece.flies ? flight(piece.t, piece.q, t) : piece.q;
  }

  std::vector<Contact> contacts;

private:
  struct Piece {
    double t, q;
    bool flies;
  };
  static constexpr double omega = 2.0 * std::numbers::pi * frequency;
  static bool inside(double q) { return q >= 0.0 && q <= L; }
  static double flight(double t0, double q, double t) {
    return q + F / omega * (t - t0) * std::cos(omega * t0) -
           F / (omega * omega) * (std::sin(omega * t) - std::sin(omega * t0));
  }
  std::vector<Piece> pieces_;
};

TEST(TwoWalls, DrivenMassMeetsBothWallsOnTime) {
  int ranks = 1;
  MPI_Comm_size(PETSC_COMM_WORLD, &ranks);
  const DrivenMass exact;
  ASSERT_GE(exact.contacts.size(), 10U);
  const DenseSystem mass = {.A = {0, 1, 0, 0},
                            .B = {0, 1},
                            .C = {1, 0},
                            .x0 = {DrivenMass::q0, 0.0},
                            .f = {{}, {0.0, DrivenMass::F, DrivenMass::frequency, 0.0}},
                            .wmax = {DrivenMass::L}};
  for (const char* form : {"box-on-z", "primal-dual"}) {
    double previous = 0.0;
    for (const PetscInt steps : {115, 460, 1840}) {
      if (ranks > 1 && steps > 460) continue;  // a single mass is on one rank anyway, the others wait
      const TimeGrid times{0.0, DrivenMass::end, steps};
      const double h = times.h();
      SCOPED_TRACE(std::string(form) + ", h = " + std::to_string(h));
      const Record run = simulate(mass, times, {.form = form});
      ASSERT_TRUE(run.certified);
      std::vector<Contact> found;
      for (const Record::Event& event : run.events)
        if (event.level == 1 || !event.impact) found.push_back({event.t, event.side, event.impact});
      ASSERT_EQ(found.size(), exact.contacts.size());
      for (std::size_t i = 0; i < found.size(); ++i) {
        // Implicit Euler runs ahead by h v, and what happens within a step shows at its end. Lift-offs are
        // grid times (t = 2, 4, ...), where the force is 0 up to rounding: one step later is right.
        EXPECT_LE(std::abs(found[i].t - exact.contacts[i].t), h + 1e-9);
        EXPECT_EQ(found[i].side, exact.contacts[i].side);
        EXPECT_EQ(found[i].impact, exact.contacts[i].impact);
      }
      double error = 0.0;
      for (PetscInt k = 1; k <= steps; ++k)
        error = std::max(error, std::abs(run.w[static_cast<std::size_t>(k - 1)] - exact.at(times.time(k))));
      EXPECT_LE(error, 2.0 * h);  // 1.7 h: the mass is at most at 2.5 m/s
      if (previous > 0.0) {
        EXPECT_NEAR(std::log(previous / error) / std::log(4.0), 1.0, 0.1);
      }
      previous = error;
    }
  }
}

// At 10 m/s a step of 0.1 s is a hundred times the distance between the walls, and the force, which changes
// sign in each step, throws the mass back and forth.
TEST(TwoWalls, NoStepPassesBoth) {
  const double wmax = 0.01;
  const DenseSystem mass = {.A = {0, 1, 0, 0},
                            .B = {0, 1},
                            .C = {1, 0},
                            .x0 = {0.005, 10.0},
                            .f = {{}, {0.0, 500.0, 4.3, 0.4}},
                            .wmax = {wmax}};
  const DenseSystem jerk = {.A = {0, 1, 0, 0, 0, 1, -1, -1, -1},
                            .B = {0, 0, 1},
                            .C = {1, 0, 0},
                            .x0 = {0.005, 10.0, -50.0},
                            .f = {{}, {}, {0.0, 5000.0, 4.3, 0.4}},
                            .wmax = {wmax}};
  for (const DenseSystem& given : {mass, jerk}) {
    for (const char* form : {"box-on-z", "primal-dual"}) {
      SCOPED_TRACE(form);
      const Record run = simulate(given, {0.0, 10.0, 100}, {.form = form});
      ASSERT_TRUE(run.certified);
      int walls[2] = {0, 0};
      for (const double w : run.w) {
        EXPECT_GE(w, 0.0);
        EXPECT_LE(w, wmax);
        walls[0] += w == 0.0 ? 1 : 0;
        walls[1] += w == wmax ? 1 : 0;
      }
      EXPECT_GT(walls[0], 10);
      EXPECT_GT(walls[1], 10);
      EXPECT_EQ(run.w.front(), wmax);  // 10 m/s upwards
    }
  }
}

// Data outside the walls are projected by the first step onto the nearer wall.
TEST(TwoWalls, StartOutsideIsProjected) {
  for (const char* form : {"box-on-z", "primal-dual"}) {
    for (const double start : {-0.3, 1.3}) {
      SCOPED_TRACE(form);
      const DenseSystem mass = {
          .A = {0, 1, 0, 0}, .B = {0, 1}, .C = {1, 0}, .x0 = {start, 0.0}, .wmax = {1.0}};
      const Record run = simulate(mass, {0.0, 1.0, 10}, {.form = form});
      ASSERT_TRUE(run.certified);
      for (const double w : run.w)
        EXPECT_EQ(w, start < 0.0 ? 0.0 : 1.0);
      EXPECT_NEAR(run.mu[run.at(0, 0, 1)], start < 0.0 ? 0.3 : -0.3, 1e-15);
      ASSERT_FALSE(run.events.empty());
      EXPECT_EQ(run.events.front().side, start < 0.0 ? Side::lower : Side::upper);
    }
  }
}

// ------------------------------------------------------------------------------------------ degrees 0 and 1

/// One implicit Euler step of x' = A x + B lambda + f, w = C x + D lambda + w0 by trying all 3^m cases: each
/// w_a is at 0 (lambda_a >= 0), at wmax_a (lambda_a <= 0), or between (lambda_a = 0). Exactly one must fit.
struct Enumerated {
  Eigen::VectorXd x, w, lambda;
};

Enumerated enumerate(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b, const Eigen::MatrixXd& c,
                     const Eigen::MatrixXd& d, const Eigen::VectorXd& wmax, const Eigen::VectorXd& x_old,
                     const Eigen::VectorXd& f, double h) {
  const Eigen::Index m = c.rows();
  const Eigen::MatrixXd solve = (Eigen::MatrixXd::Identity(a.rows(), a.rows()) - h * a).inverse();
  const Eigen::VectorXd free = solve * (x_old + h * f);
  const Eigen::MatrixXd delassus = h * c * solve * b + d;
  const Eigen::VectorXd w_free = c * free;
  Enumerated result;
  int fits = 0;
  const int cases = static_cast<int>(std::pow(3, m));
  for (int number = 0; number < cases; ++number) {
    Eigen::MatrixXd matrix = delassus;
    Eigen::VectorXd right = -w_free;
    std::vector<int> kind;
    for (int rest = number, i = 0; i < m; ++i, rest /= 3) {
      kind.push_back(rest % 3);
      if (kind.back() == 1) right(i) += wmax(i);
      if (kind.back() == 2) {
        matrix.row(i).setZero();
        matrix(i, i) = 1.0;
        right(i) = 0.0;
      }
    }
    const Eigen::VectorXd lambda = matrix.fullPivLu().solve(right);
    const Eigen::VectorXd w = w_free + delassus * lambda;
    bool valid = true;
    for (Eigen::Index i = 0; i < m; ++i) {
      const int k = kind[static_cast<std::size_t>(i)];
      valid = valid && (k == 0   ? lambda(i) >= 0.0
                        : k == 1 ? lambda(i) <= 0.0 && wmax(i) < inf
                                 : w(i) > 0.0 && w(i) < wmax(i));
    }
    if (!valid) continue;
    ++fits;
    result = {free + h * solve * b * lambda, w, lambda};
  }
  EXPECT_EQ(fits, 1);
  return result;
}

TEST(TwoWalls, DegreesZeroAndOneByEnumeration) {
  Eigen::Matrix3d a;
  Eigen::Matrix<double, 3, 2> b;
  Eigen::Matrix<double, 2, 3> c;
  a << -0.5, 1.0, 0.0, -1.0, -0.5, 0.3, 0.2, 0.0, -1.0;
  b << 1.0, 0.3, -0.2, 0.8, 0.1, 0.5;
  c << 1.0, 0.2, 0.0, 0.1, 0.9, 0.3;
  Eigen::Matrix2d coupled;
  Eigen::Matrix2d one;
  coupled << 0.5, -0.3, 0.2, 0.25;  // positive definite, not symmetric
  one << 0.4, 0.0, 0.0, 0.0;        // the second constraint has degree 1
  const std::vector<Signal> f = {{0.3, 2.0, 0.25, 0.0}, {0.2, 1.5, 0.4, 1.0}, {0.1}};
  const TimeGrid times{0.0, 12.0, 240};
  const double h = times.h();
  for (const Eigen::Matrix2d& d : {coupled, one, Eigen::Matrix2d(Eigen::Matrix2d::Zero())}) {
    for (const Eigen::Vector2d& wmax : {Eigen::Vector2d(0.6, 0.5), Eigen::Vector2d(inf, 0.5)}) {
      const DenseSystem given = {.A = row_major(a),
                                 .B = row_major(b),
                                 .C = row_major(c),
                                 .x0 = {0.2, 0.1, 0.0},
                                 .D = row_major(d),
                                 .f = f,
                                 .wmax = {wmax(0), wmax(1)}};
      for (const char* type : {SNESVINEWTONRSLS, SNESVINEWTONSSLS}) {
        SCOPED_TRACE(std::string(type) + ", D_00 = " + std::to_string(d(0, 0)) + ", D_01 = " +
                     std::to_string(d(0, 1)) + (wmax(0) < inf ? ", two upper walls" : ", one upper wall"));
        const Record run = simulate(given, times, {.snes_type = type});
        ASSERT_TRUE(run.certified);
        Eigen::VectorXd x(3);
        x << 0.2, 0.1, 0.0;
        double worst_w = 0.0;
        double worst_mu = 0.0;
        double worst_x = 0.0;
        int walls[2] = {0, 0};
        for (PetscInt k = 1; k <= times.steps; ++k) {
          Eigen::VectorXd force(3);
          for (Eigen::Index i = 0; i < 3; ++i)
            force(i) = f[static_cast<std::size_t>(i)].value(times.time(k));
          const Enumerated step = enumerate(a, b, c, d, wmax, x, force, h);
          x = step.x;
          const auto row = static_cast<std::size_t>(k - 1);
          for (std::size_t i = 0; i < 2; ++i) {
            const auto at = static_cast<Eigen::Index>(i);
            worst_w = std::max(worst_w, std::abs(run.w[run.at(row, i)] - step.w(at)));
            worst_mu = std::max(worst_mu, std::abs(run.mu[run.at(row, i, 1)] - h * step.lambda(at)));
            walls[0] += step.lambda(at) > 0.0 ? 1 : 0;
            walls[1] += step.lambda(at) < 0.0 ? 1 : 0;
          }
          for (std::size_t i = 0; i < 3; ++i)
            worst_x = std::max(worst_x, std::abs(run.x[row][i] - x(static_cast<Eigen::Index>(i))));
        }
        // Two direct solutions of small, well conditioned systems: rounding, damped from step to step.
        EXPECT_LE(worst_w, 1e-12);
        EXPECT_LE(worst_mu, 1e-12);
        EXPECT_LE(worst_x, 1e-12);
        EXPECT_GT(walls[0], 10);
        EXPECT_GT(walls[1], 10);
      }
    }
  }
}

// For r = 1 the three schemes are the same step, with an upper wall too.
TEST(TwoWalls, SchemesAgreeForDegreeOne) {
  const DenseSystem given = driven_systems().front().system;
  const Record homsp = simulate(given, grid, {.form = "primal-dual"});
  ASSERT_TRUE(homsp.certified);
  EXPECT_LT(*std::min_element(homsp.mu.begin(), homsp.mu.end()), 0.0);
  EXPECT_GT(*std::max_element(homsp.mu.begin(), homsp.mu.end()), 0.0);
  for (const Scheme scheme : {Scheme::zd_euler, Scheme::naive_euler}) {
    SCOPED_TRACE(name_of(scheme));
    const Record run = simulate(given, grid, {.scheme = scheme});
    ASSERT_TRUE(run.certified);
    EXPECT_LE(worst(run.x, homsp.x), 1e-13);  // rounding of a contracting system
    EXPECT_LE(worst(run.w, homsp.w), 1e-13);
    EXPECT_LE(worst(run.mu, homsp.mu), 1e-13);
  }
}

// For r = 2 they are not, and still keep between the walls.
TEST(TwoWalls, OtherSchemesKeepBetweenTheWalls) {
  const Named driven = driven_systems()[1];
  for (const Scheme scheme : {Scheme::zd_euler, Scheme::naive_euler}) {
    SCOPED_TRACE(name_of(scheme));
    const Record run = simulate(driven.system, grid, {.scheme = scheme});
    ASSERT_TRUE(run.certified);
    EXPECT_EQ(*std::min_element(run.w.begin(), run.w.end()), 0.0);
    EXPECT_EQ(*std::max_element(run.w.begin(), run.w.end()), driven.system.wmax[0]);
    EXPECT_LT(*std::min_element(run.mu.begin(), run.mu.end()), 0.0);
    EXPECT_GT(*std::max_element(run.mu.begin(), run.mu.end()), 0.0);
  }
}

}  // namespace
}  // namespace sweepvi::test
