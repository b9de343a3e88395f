// ranks: 1 2 3
// several: Coupled.DegreesOneToFourInBothForms:SharedInputs.AreRefusedAsABoxOnZ
// three: Coupled.DegreesOneToFourInBothForms
// timeout: 240
// Constraints of relative degrees 1, 2, 3 and 4 in one system, coupled and forced: both forms of the box VI
// are the same step. And what distinguishes raw inputs from decoupled ones.
#include <gtest/gtest.h>

#include <random>

#include "dvi/runs.hpp"

namespace sweepvi::test {
namespace {

const TimeGrid grid{0.0, 10.0, 400};

struct Matrices {
  Eigen::MatrixXd A, B, C;
  Eigen::VectorXd x0;
  std::vector<Signal> f = {};
};

enum State { y, q2, v2, z1, z2, z3, xi1, xi2, q, dq, p, dp, s, states };

/// w = (y, q2, z1, q) of degrees 1, 2, 3, 4, and zero dynamics (xi1, xi2, s). Every degree sees others, also
/// above level 1: z_{4,3} holds z1 and z_{4,4} holds z2, so a measure of level 1 of constraint 2 moves them.
/// M is diagonal: lambda_b never reaches the derivative r_a of w_a first.
Matrices four_degrees() {
  Matrices m;
  m.A = Eigen::MatrixXd::Zero(states, states);
  const auto row = [&](State state, std::initializer_list<std::pair<State, double>> terms) {
    for (const auto& [column, value] : terms)
      m.A(state, column) = value;
  };
  row(y, {{y, -1.0}, {q2, 0.3}, {v2, 0.2}, {z2, 0.1}, {s, 0.2}});
  row(q2, {{v2, 1.0}});
  row(v2, {{q2, -2.0}, {v2, -0.2}, {y, 0.3}, {z3, 0.1}, {dq, 0.2}, {p, 0.15}});
  row(z1, {{z2, 1.0}});
  row(z2, {{z3, 1.0}});
  row(z3, {{z1, -1.0}, {z2, -1.0}, {z3, -1.0}, {xi2, 1.0}, {q, 0.2}, {v2, 0.3}, {dp, 0.1}});
  row(xi1, {{xi2, 1.0}});
  row(xi2, {{z1, 1.0}, {xi1, -1.0}, {q2, 0.1}});
  row(q, {{dq, 1.0}});
  row(dq, {{q, -11.0}, {p, 10.0}, {dq, -0.1}, {z1, 0.5}});
  row(p, {{dp, 1.0}});
  row(dp, {{q, 10.0}, {p, -10.0}, {v2, 0.2}, {y, 0.1}, {z3, 0.1}, {dp, -0.1}});
  row(s, {{s, -1.0}, {y, 1.0}, {z1, 0.5}, {q, -0.3}});
  m.B = Eigen::MatrixXd::Zero(states, 4);
  m.B(y, 0) = 1.0, m.B(v2, 1) = 1.5, m.B(z3, 2) = 1.0, m.B(dp, 3) = 0.5;
  m.C = Eigen::MatrixXd::Zero(4, states);
  m.C(0, y) = m.C(1, q2) = m.C(2, z1) = m.C(3, q) = 1.0;
  m.x0 = Eigen::VectorXd::Zero(states);
  m.x0(y) = 0.5, m.x0(q2) = m.x0(z1) = 1.0, m.x0(q) = m.x0(p) = 0.6;
  // Also above the inputs, where outputs see the derivatives of f.
  m.f.resize(states);
  m.f[y] = {-0.5, 0.8, 0.3, 0.0};
  m.f[q2] = {0.0, 0.1, 0.2, 0.5};
  m.f[v2] = {-0.5, 1.5, 0.25, 0.0};
  m.f[z1] = {0.0, 0.05, 0.3, 0.2};
  m.f[z3] = {-0.3, 0.6, 0.2, 1.0};
  m.f[dq] = {-1.0, 0.9, 0.15, 2.0};
  m.f[s] = {0.3, 0.2, 0.4, 0.0};
  return m;
}

DenseSystem dense(const Matrices& m) {
  return {.A = row_major(m.A), .B = row_major(m.B), .C = row_major(m.C), .x0 = row_major(m.x0), .f = m.f};
}

/// x = L xhat, L lower triangular in each element. Outputs still give the states one by one, level by level.
Eigen::MatrixXd local_change(unsigned seed) {
  std::mt19937 generator(seed);
  std::uniform_real_distribution<double> diagonal(0.5, 2.0);
  std::uniform_real_distribution<double> below(-0.5, 0.5);
  Eigen::MatrixXd l = Eigen::MatrixXd::Zero(states, states);
  const std::pair<State, State> elements[] = {{y, q2}, {q2, z1}, {z1, q}, {q, s}, {s, states}};
  for (const auto& [first, last] : elements) {
    for (int i = first; i < last; ++i) {
      l(i, i) = diagonal(generator);
      for (int j = first; j < i; ++j)
        l(i, j) = below(generator);
    }
  }
  return l;
}

DenseSystem changed(const Matrices& m, const Eigen::MatrixXd& l) {
  const auto lower = l.triangularView<Eigen::Lower>();  // solving keeps zeros zero
  DenseSystem given =
      dense({.A = lower.solve(m.A * l), .B = lower.solve(m.B), .C = m.C * l, .x0 = lower.solve(m.x0)});
  // A force on state j reaches all rows below it in its element, in step: one signal that varies per element.
  const Eigen::MatrixXd inverse = lower.solve(Eigen::MatrixXd::Identity(states, states));
  given.f.assign(states, {});
  for (Eigen::Index i = 0; i < states; ++i) {
    Signal& sum = given.f[static_cast<std::size_t>(i)];
    for (Eigen::Index j = 0; j <= i; ++j) {
      if (inverse(i, j) == 0.0) continue;
      const Signal part = m.f[static_cast<std::size_t>(j)].scaled(inverse(i, j));
      const double offset = sum.offset + part.offset;
      if (part.varies()) {
        EXPECT_FALSE(sum.varies());
        sum = part;
      }
      sum.offset = offset;
    }
  }
  return given;
}

/// The two runs agree up to the rounding of 400 steps behind a W of condition below 100: 1e-13 was measured,
/// relative to values of up to 20. One step in which a constraint switches in one of them only would show as
/// 1e-4.
constexpr double tolerance = 1e-11;

void expect_same(const Record& a, const Record& b) {
  EXPECT_LE(worst(a.x, b.x), tolerance);
  EXPECT_LE(worst(a.z, b.z), tolerance);
  EXPECT_LE(worst(a.w, b.w), tolerance);
  EXPECT_LE(worst(a.mu, b.mu), tolerance);
  EXPECT_EQ(a.level, b.level);
}

/// Every constraint is hit, rests and flies: or the comparison says nothing.
void expect_contacts(const Record& run) {
  for (std::size_t a = 0; a < run.constraints; ++a) {
    const auto r = static_cast<std::size_t>(run.degree[a]);
    std::size_t resting = 0;
    std::size_t flying = 0;
    for (std::size_t k = 0; k < run.steps; ++k) {
      resting += run.mu[run.at(k, a, r)] > 0.0 ? 1 : 0;
      flying += run.w[run.at(k, a)] > 0.0 ? 1 : 0;
    }
    EXPECT_GT(resting, 10U) << "constraint " << a;
    EXPECT_GT(flying, 10U) << "constraint " << a;
    for (int i = 2; i <= run.degree[a]; ++i)
      EXPECT_TRUE(std::any_of(run.events.begin(), run.events.end(),
                              [&](const Record::Event& event) {
                                return event.constraint == static_cast<PetscInt>(a) && event.impact &&
                                       event.level == i;
                              }))
          << "no impact on level " << i << " of constraint " << a;
  }
}

TEST(Coupled, DegreesOneToFourInBothForms) {
  const DenseSystem given = dense(four_degrees());
  int ranks = 0;
  MPI_Comm_size(PETSC_COMM_WORLD, &ranks);
  // Weights are the same on any number of ranks.
  for (const double theta : ranks == 1 ? std::vector{1.0, 0.7, 0.5} : std::vector{0.7}) {
    SCOPED_TRACE(theta);
    const Record box = simulate(given, grid, {.form = "box-on-z", .theta = theta});
    const Record automatic = simulate(given, grid, {.theta = theta});
    const Record primal_dual = simulate(given, grid, {.form = "primal-dual", .theta = theta});
    EXPECT_EQ(box.degree, (std::vector<double>{1, 2, 3, 4}));
    EXPECT_EQ(automatic.form, Form::box_on_z);
    EXPECT_EQ(box.unknowns, states);
    EXPECT_EQ(primal_dual.unknowns, states + 10);
    ASSERT_TRUE(box.certified && primal_dual.certified && automatic.certified);
    expect_contacts(box);
    expect_same(box, primal_dual);
    EXPECT_EQ(box.x, automatic.x);
  }
}

TEST(Coupled, WithoutPredictorAndWithTheOtherSolver) {
  const DenseSystem given = dense(four_degrees());
  const Record reference = simulate(given, grid, {.form = "box-on-z"});
  struct Case {
    const char *form, *type;
  };
  for (const Case& one : {Case{"box-on-z", SNESVINEWTONSSLS}, Case{"primal-dual", SNESVINEWTONRSLS},
                          Case{"primal-dual", SNESVINEWTONSSLS}}) {
    SCOPED_TRACE(std::string(one.form) + " " + one.type);
    const Record run = simulate(given, grid, {.form = one.form, .snes_type = one.type, .predictor = "none"});
    ASSERT_TRUE(run.certified);
    expect_same(run, reference);
  }
}

TEST(Coupled, LocalChangesOfCoordinates) {
  Matrices m = four_degrees();
  m.f[q2].amplitude = m.f[z3].amplitude = 0.0;  // see `changed`
  m.f[z1].amplitude = 0.3;
  const Record reference = simulate(dense(m), grid, {.form = "primal-dual"});
  for (const unsigned seed : {1U, 2U}) {
    SCOPED_TRACE(seed);
    const Eigen::MatrixXd l = local_change(seed);
    const DenseSystem given = changed(m, l);
    Record box = simulate(given, grid, {.form = "box-on-z"});
    Record primal_dual = simulate(given, grid, {.form = "primal-dual"});
    ASSERT_TRUE(box.certified && primal_dual.certified);
    expect_same(box, primal_dual);
    for (std::vector<double>& x : box.x)
      Eigen::Map<Eigen::VectorXd>(x.data(), states) =
          (l * Eigen::Map<Eigen::VectorXd>(x.data(), states)).eval();
    expect_same(box, reference);
  }
}

// ------------------------------------------------------------------------------------------------ raw inputs

/// Two oscillators z''' = -z - z' - z'' + f_i + (B lambda)_i with B = [2, -1; -1, 2], w = z: lambda_1, which
/// stops the first one, pushes the second one down.
Matrices shared_inputs() {
  Matrices m;
  m.A = Eigen::MatrixXd::Zero(6, 6);
  m.B = Eigen::MatrixXd::Zero(6, 2);
  m.C = Eigen::MatrixXd::Zero(2, 6);
  for (int i = 0; i < 2; ++i) {
    m.A(3 * i, 3 * i + 1) = m.A(3 * i + 1, 3 * i + 2) = 1.0;
    m.A.block(3 * i + 2, 3 * i, 1, 3).setConstant(-1.0);
    m.C(i, 3 * i) = 1.0;
  }
  m.B(2, 0) = m.B(5, 1) = 2.0;
  m.B(5, 0) = m.B(2, 1) = -1.0;
  m.x0.resize(6);
  m.x0 << 0.5, -0.5, -0.2, 2.0, 0.1, 0.0;
  m.f = {{}, {}, {-1.0}, {}, {}, {}};
  return m;
}

/// (x, 1)' = F (x, 1): free motion with `lambda_1` times the first input.
Eigen::MatrixXd flow(const Matrices& m, const Eigen::VectorXd& input, double lambda) {
  Eigen::MatrixXd f = Eigen::MatrixXd::Zero(7, 7);
  f.topLeftCorner(6, 6) = m.A;
  for (Eigen::Index i = 0; i < 6; ++i)
    f(i, 6) = m.f[static_cast<std::size_t>(i)].offset + lambda * input(i);
  return f;
}

Eigen::VectorXd moved(const Eigen::MatrixXd& flow, double t, const Eigen::VectorXd& x) {
  Eigen::VectorXd extended(7);
  extended << x, 1.0;
  return (exponential(t * flow) * extended).head(6);
}

/// The event-driven solution at t = 1.5 if the measures of the first constraint act through `input`.
struct Exact {
  double impact = 0.0;
  Eigen::VectorXd end;
};

Exact event_driven(const Matrices& m, const Eigen::VectorXd& input) {
  const Eigen::MatrixXd free = flow(m, input, 0.0);
  double before = 0.0;
  double after = 1.5;
  for (int i = 0; i < 100; ++i) {
    const double middle = 0.5 * (before + after);
    (moved(free, middle, m.x0)(0) > 0.0 ? before : after) = middle;
  }
  Exact exact{.impact = before, .end = moved(free, before, m.x0)};
  EXPECT_LT(exact.end(1), 0.0);  // z_1 = 0, z_2 < 0, z_3 < 0: all three are stopped
  EXPECT_LT(exact.end(2), 0.0);

  // d_i in span{b, A b, A^2 b} with z_{1,j}(d_i) = delta_ij.
  Eigen::MatrixXd span(6, 3);
  span << input, m.A * input, m.A * m.A * input;
  const Eigen::MatrixXd d = span * span.topRows(3).inverse();
  exact.end -= d * exact.end.head(3).eval();
  // Then z_3' = 0 = f_1 + input_3 lambda; lambda is constant, as f is.
  const double lambda = -m.f[2].offset / input(2);
  EXPECT_GT(lambda, 0.0);
  exact.end = moved(flow(m, input, lambda), 1.5 - exact.impact, exact.end);
  EXPECT_LT(exact.end.head(3).norm(), 1e-14);  // it stays there
  EXPECT_GT(exact.end(3), 0.1);                // and the other one off its wall
  return exact;
}

TEST(SharedInputs, ActAsTheyAre) {
  const Matrices m = shared_inputs();
  const Exact raw = event_driven(m, m.B.col(0));
  const Exact decoupled =
      event_driven(m, m.B * (Eigen::Matrix2d() << 2, -1, -1, 2).finished().inverse().col(0));
  // The same in 40 digits (Taylor series, another program).
  EXPECT_NEAR(raw.impact, 0.7897738536708836148733, 1e-14);
  EXPECT_NEAR(raw.end(3), 1.068504583832910126569, 1e-14);
  EXPECT_NEAR(decoupled.end(3), 1.391111847080592613057, 1e-14);
  ASSERT_GT(std::abs(raw.end(3) - decoupled.end(3)), 0.1);

  double previous = 0.0;
  for (const PetscInt steps : {150, 600, 2400}) {
    const Record run = simulate(dense(m), {0.0, 1.5, steps});
    ASSERT_TRUE(run.certified);
    EXPECT_EQ(run.form, Form::primal_dual);
    const double h = 1.5 / static_cast<double>(steps);
    const double error = std::abs(run.x.back()[3] - raw.end(3));
    EXPECT_LE(error, h);  // 0.73 h
    EXPECT_GT(std::abs(run.x.back()[3] - decoupled.end(3)), 0.1);
    // Order one, but for where in its step the impact falls: it comes late by up to h.
    if (previous > 0.0) {
      EXPECT_NEAR(std::log(previous / error) / std::log(4.0), 1.0, 0.1);
    }
    previous = error;
  }
}

TEST(SharedInputs, AreRefusedAsABoxOnZ) {
  const ScopedOption form("-sweepvi_form", "box-on-z");
  const LinearSystem system = LinearSystem::dense(PETSC_COMM_WORLD, dense(shared_inputs()));
  const RelativeDegree degree = analyse_relative_degree(system);
  EXPECT_FALSE(degree.has_pivots);
  try {
    choose_form(system, degree, Scheme::homsp);
    ADD_FAILURE() << "accepted";
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ExitCode::bad_input);
    for (const char* part :
         {"-sweepvi_form box-on-z does not fit", "the Markov matrix is not diagonal", "use primal-dual"})
      EXPECT_NE(std::string(error.what()).find(part), std::string::npos) << error.what();
  }
}

}  // namespace
}  // namespace sweepvi::test
