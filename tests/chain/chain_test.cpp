// ranks: 1 2 3
// Chains against their equations, written out here element by element in the order of /x: x' and w agree for
// states and multipliers at random, as dealt out first and by METIS.
#include <fmt/format.h>

#include <functional>
#include <random>

#include "chain/chain_scene.hpp"
#include "parallel/gather.hpp"
#include "petsc/sparse.hpp"
#include "sweepvi/partition.hpp"

namespace sweepvi::test {
namespace {

using Numbers = std::vector<double>;

/// k_ij, row-major, and the coupling to missing neighbours.
struct Weights {
  std::size_t count;
  Numbers k;
  Numbers ends;

  Weights(std::size_t n, const std::function<bool(long, long)>& coupled, double coupling, int neighbours)
      : count(n), k(n * n, 0.0), ends(n, coupling * neighbours) {
    for (std::size_t i = 0; i < n; ++i)
      for (std::size_t j = 0; j < n; ++j)
        if (coupled(static_cast<long>(i), static_cast<long>(j))) {
          k[i * n + j] = coupling;
          ends[i] -= coupling;
        }
  }
  /// S(w)_i
  double operator()(const Numbers& w, std::size_t i) const {
    double sum = -ends[i] * w[i];
    for (std::size_t j = 0; j < count; ++j)
      sum += k[i * count + j] * (w[j] - w[i]);
    return sum;
  }
};

Weights line(std::size_t n, double coupling) {
  return {n, [](long i, long j) { return std::abs(i - j) == 1; }, coupling, 2};
}
Weights ring(std::size_t n, double coupling) {
  return {n, [n](long i, long j) { return (i + 1) % long(n) == j || (j + 1) % long(n) == i; }, coupling, 2};
}
Weights lattice(long nx, long ny, double coupling) {
  return {static_cast<std::size_t>(nx * ny),
          [nx](long i, long j) { return std::abs(i % nx - j % nx) + std::abs(i / nx - j / nx) == 1; },
          coupling, 4};
}

struct Rates {
  Numbers x;  // x'
  Numbers w;
};
using Equations = std::function<Rates(const Numbers& x, const Numbers& lambda)>;

Numbers random_numbers(std::size_t size, std::mt19937& engine) {
  std::uniform_real_distribution<double> distribution(-1.0, 1.0);
  Numbers numbers(size);
  for (double& number : numbers)
    number = distribution(engine);
  return numbers;
}

/// A distributed vector of what stands in scene order.
Vector dealt(Vec like, const Numbers& whole, const std::vector<PetscInt>& order) {
  Vector vector = duplicate(like);
  const WriteArray values(vector.get());
  for (PetscInt i = 0; i < values.size(); ++i)
    values[i] = whole[static_cast<std::size_t>(order[static_cast<std::size_t>(i)])];
  return vector;
}

Numbers collected(Vec vector, const std::vector<PetscInt>& order) {
  std::vector<PetscInt> numbers = gather(PETSC_COMM_WORLD, order);
  broadcast(PETSC_COMM_WORLD, numbers);
  const Numbers values = everywhere(vector);
  Numbers whole(values.size());
  for (std::size_t i = 0; i < values.size(); ++i)
    whole[static_cast<std::size_t>(numbers[i])] = values[i];
  return whole;
}

Rates rates(const LinearSystem& system, double t, const Numbers& x, const Numbers& lambda) {
  const Vector state = dealt(system.x0.get(), x, system.state_order);
  const Vector push = dealt(system.w0.get(), lambda, system.constraint_order);
  Vector rate = duplicate(state.get());
  check(MatMult(system.A.get(), state.get(), rate.get()));
  check(MatMultAdd(system.B.get(), push.get(), rate.get(), rate.get()));
  system.f.add_to(rate.get(), t, 0, 1.0);
  Vector w = duplicate(push.get());
  check(MatMultAdd(system.C.get(), state.get(), system.w0.get(), w.get()));
  return {collected(rate.get(), system.state_order), collected(w.get(), system.constraint_order)};
}

void expect_same(const Numbers& found, const Numbers& expected, const std::string& what) {
  ASSERT_EQ(found.size(), expected.size()) << what;
  for (std::size_t i = 0; i < found.size(); ++i)  // sums of about ten terms of order 10
    EXPECT_NEAR(found[i], expected[i], 1e-13) << what << "[" << i << "]";
}

void expect_equations(const LinearSystem& system, double t, const Equations& equations) {
  std::mt19937 engine(1);
  const auto n = static_cast<std::size_t>(system.states());
  const auto m = static_cast<std::size_t>(system.constraints());
  for (std::size_t trial = 0; trial <= n + m; ++trial) {  // as many as a matrix has columns
    const Numbers x = random_numbers(n, engine);
    const Numbers lambda = random_numbers(m, engine);
    const Rates found = rates(system, t, x, lambda);
    const Rates expected = equations(x, lambda);
    expect_same(found.x, expected.x, "x'");
    expect_same(found.w, expected.w, "w");
  }
}

/// As read, and after METIS. All constraints have relative degree r.
void expect_chain(const std::string& keys, int r, double t, const Equations& equations) {
  SCOPED_TRACE(keys);
  LinearSystem system = chain_system(keys);
  expect_equations(system, t, equations);
  RelativeDegree degree = analyse_relative_degree(system);
  EXPECT_EQ(degree.lowest, r);
  EXPECT_EQ(degree.highest, r);
  check_markov_matrix(system, degree);
  distribute(system, degree);
  expect_equations(system, t, equations);
}

Equations jerk(const Weights& S, const Numbers& a1, double a2, double a3, const Numbers& force) {
  return [=](const Numbers& x, const Numbers& lambda) {
    const std::size_t n = S.count;
    Rates rate{Numbers(5 * n), Numbers(n)};
    for (std::size_t i = 0; i < n; ++i)
      rate.w[i] = x[5 * i];
    for (std::size_t i = 0; i < n; ++i) {
      const double *z = &x[5 * i], *xi = &x[5 * i + 3];
      const double coupled = S(rate.w, i);
      const Numbers own = {z[1], z[2],
                           a1[i] * z[0] + a2 * z[1] + a3 * z[2] + xi[1] + coupled + force[i] + lambda[i],
                           xi[1], -xi[0] + z[0]};
      std::copy(own.begin(), own.end(), rate.x.begin() + static_cast<long>(5 * i));
    }
    return rate;
  };
}

Equations wall(const Weights& S, const Numbers& mass, double damping, const Numbers& force) {
  return [=](const Numbers& x, const Numbers& lambda) {
    const std::size_t n = S.count;
    const Numbers q(x.begin(), x.begin() + static_cast<long>(n));
    Rates rate{Numbers(2 * n), q};
    for (std::size_t i = 0; i < n; ++i) {
      const double v = x[n + i];
      rate.x[i] = v;
      rate.x[n + i] = (-damping * v + S(q, i) + force[i] + lambda[i]) / mass[i];
    }
    return rate;
  };
}

Equations contact(const Numbers& mass, double gravity, double force = 0.0) {
  return [=](const Numbers& x, const Numbers& lambda) {
    const std::size_t n = mass.size();
    Rates rate{Numbers(2 * n), Numbers(n)};
    for (std::size_t i = 0; i < n; ++i) {
      rate.w[i] = i == 0 ? x[0] : x[i] - x[i - 1] - 1.0;
      rate.x[i] = x[n + i];
      const double above = i + 1 < n ? lambda[i + 1] : 0.0;
      rate.x[n + i] = -gravity + (force + lambda[i] - above) / mass[i];
    }
    return rate;
  };
}

Equations flexible(const Weights& S, const Numbers& mass, double inertia, const Numbers& joint, double ground,
                   double force, double damping = 0.0) {
  return [=](const Numbers& x, const Numbers& lambda) {
    const std::size_t n = S.count;
    Rates rate{Numbers(4 * n), Numbers(n)};
    for (std::size_t i = 0; i < n; ++i)
      rate.w[i] = x[4 * i];
    for (std::size_t i = 0; i < n; ++i) {
      const double q = x[4 * i], p = x[4 * i + 1];
      rate.x[4 * i] = x[4 * i + 2];
      rate.x[4 * i + 1] = x[4 * i + 3];
      rate.x[4 * i + 2] =
          (joint[i] * (p - q) + S(rate.w, i) - ground * q - damping * x[4 * i + 2] + force) / mass[i];
      rate.x[4 * i + 3] = (joint[i] * (q - p) + lambda[i]) / inertia;
    }
    return rate;
  };
}

TEST(Chain, JerkElementsFollowTheirEquations) {
  expect_chain(
      "element = \"jerk\"\ncount = 4\ncoupling = 0.5\na1 = [1, 2, 3, 4]\na2 = -2\na3 = 0.25\n"
      "force = [0, 1, {offset = 1, amplitude = 2, frequency = 1}, 0]\n",
      3, 0.25, jerk(line(4, 0.5), {1, 2, 3, 4}, -2.0, 0.25, {0, 1, 3, 0}));  // sin = 1 at 0.25 s
  expect_chain("element = \"jerk\"\ncount = 1\n", 3, 0.0, jerk(line(1, 0.0), {-1}, -1.0, -1.0, {0}));
}

TEST(Chain, WallElementsFollowTheirEquations) {
  expect_chain(
      "element = \"wall\"\ncount = 5\ne = 0\nmass = [1, 2, 3, 4, 5]\ndamping = 0.5\ncoupling = 2\n"
      "force = {amplitude = 3, frequency = 1}\n",
      2, 0.25, wall(line(5, 2.0), {1, 2, 3, 4, 5}, 0.5, Numbers(5, 3.0)));
  expect_chain("element = \"wall\"\ncount = 2\ne = 0\n", 2, 0.0,
               wall(line(2, 1.0), {1, 1}, 0.0, Numbers(2, -0.5)));
}

TEST(Chain, ContactElementsFollowTheirEquations) {
  expect_chain("element = \"contact\"\ncount = 5\nmass = [1, 2, 3, 4, 5]\ngravity = 9.81\n", 2, 0.0,
               contact({1, 2, 3, 4, 5}, 9.81));
  expect_chain("element = \"contact\"\ncount = 3\ngravity = 0\nforce = {amplitude = 3, frequency = 1}\n", 2,
               0.25, contact({1, 1, 1}, 0.0, 3.0));
  expect_chain("element = \"contact\"\ncount = 1\ntopology = \"chain\"\n", 2, 0.0, contact({1}, 1.0));
}

TEST(Chain, FlexibleElementsFollowTheirEquations) {
  expect_chain(
      "element = \"flexible\"\ncount = 4\ncoupling = 3\nmass = [1, 2, 3, 4]\ninertia = 0.5\n"
      "joint = [4, 5, 6, 7]\nground = 2\ndamping = 3\nforce = 0.5\n",
      4, 0.0, flexible(line(4, 3.0), {1, 2, 3, 4}, 0.5, {4, 5, 6, 7}, 2.0, 0.5, 3.0));
  expect_chain("element = \"flexible\"\ncount = 2\n", 4, 0.0,
               flexible(line(2, 1.0), {1, 1}, 1.0, {10, 10}, 1.0, -1.0));
}

TEST(Chain, RingsAndLatticesHaveTheirNeighbours) {
  const auto keys = [](int count, const std::string& topology) {
    return "element = \"wall\"\ne = 0\nforce = 0\ncoupling = 0.5\ncount = " + std::to_string(count) +
           "\ntopology = " + topology + "\n";
  };
  const auto free_walls = [](const Weights& S) {
    return wall(S, Numbers(S.count, 1.0), 0.0, Numbers(S.count, 0.0));
  };
  expect_chain(keys(3, "\"ring\""), 2, 0.0, free_walls(ring(3, 0.5)));
  expect_chain(keys(7, "\"ring\""), 2, 0.0, free_walls(ring(7, 0.5)));
  expect_chain(keys(6, "\"lattice\"\nshape = [3, 2]"), 2, 0.0, free_walls(lattice(3, 2, 0.5)));
  expect_chain(keys(12, "\"lattice\"\nshape = [3, 4]"), 2, 0.0, free_walls(lattice(3, 4, 0.5)));
  // A row of a lattice also hangs on the missing rows above and below.
  expect_chain(keys(4, "\"lattice\"\nshape = [1, 4]"), 2, 0.0, free_walls(lattice(1, 4, 0.5)));
  expect_chain(keys(1, "\"lattice\"\nshape = [1, 1]"), 2, 0.0, free_walls(lattice(1, 1, 0.5)));
}

TEST(Chain, ACouplingMatrixCouplesWithoutEnds) {
  Weights S = line(4, 0.0);
  S.k = {0,  1, 0,   -2,   //
         1,  0, 3,   0,    //
         0,  3, 0,   0.5,  //
         -2, 0, 0.5, 0};
  expect_chain(
      "element = \"flexible\"\ncount = 4\ncoupling = [[0,1,0,-2],[1,0,3,0],[0,3,0,0.5],[-2,0,0.5,0]]\n", 4,
      0.0, flexible(S, Numbers(4, 1.0), 1.0, Numbers(4, 10.0), 1.0, -1.0));
}

void expect_same_matrices(const std::string& one, const std::string& other) {
  const LinearSystem a = chain_system(one);
  const LinearSystem b = chain_system(other);
  PetscBool same = PETSC_FALSE;
  check(MatEqual(a.A.get(), b.A.get(), &same));
  EXPECT_TRUE(same) << one << other;
  check(MatEqual(a.B.get(), b.B.get(), &same));
  EXPECT_TRUE(same) << one << other;
  EXPECT_EQ(start_of(a), start_of(b)) << one << other;
}

TEST(Chain, ARingAsAMatrixIsTheRing) {
  const std::string ring_of_four = "element = \"jerk\"\ncount = 4\n";
  expect_same_matrices(
      ring_of_four + "coupling = 0.5\ntopology = \"ring\"\n",
      ring_of_four + "coupling = [[0,0.5,0,0.5],[0.5,0,0.5,0],[0,0.5,0,0.5],[0.5,0,0.5,0]]\n");
}

TEST(Chain, AChainAsAMatrixNeedsItsEndsInA1) {
  const std::string three = "element = \"jerk\"\ncount = 3\n";
  expect_same_matrices(three + "coupling = 0.5\n",
                       three + "coupling = [[0,0.5,0],[0.5,0,0.5],[0,0.5,0]]\na1 = [-1.5, -1, -1.5]\n");
}

TEST(Chain, OneValueForAllIsThatValueForEach) {
  expect_same_matrices("element = \"flexible\"\ncount = 3\nmass = 2\njoint = 5\n",
                       "element = \"flexible\"\ncount = 3\nmass = [2, 2, 2]\njoint = [5, 5, 5]\n");
  expect_same_matrices("element = \"wall\"\ncount = 3\ne = 0\nbase = 2\nwaves = 1\n",
                       "element = \"wall\"\ncount = 3\ne = [0, 0, 0]\nbase = [2, 2, 2]\nwaves = [1, 1, 1]\n");
}

TEST(Chain, StartsFromItsDefaultData) {
  const auto golden = [](int i) { return std::fmod(0.6180339887498949 * i, 1.0); };
  expect_same(start_of(chain_system("element = \"jerk\"\ncount = 3\nspread = 0.5\nbase = 1\n")),
              {1, 0, 0, 0, 0, 1 + 0.5 * golden(1), 0, 0, 0, 0, 1 + 0.5 * golden(2), 0, 0, 0, 0}, "jerk");
  const double side = 0.05 * std::sqrt(0.75);  // 3 waves on 9 elements: thirds of a turn
  expect_same(start_of(chain_system("element = \"wall\"\ncount = 9\ne = 0\n")),
              {0.1, 0.1 + side, 0.1 - side, 0.1, 0.1 + side, 0.1 - side, 0.1, 0.1 + side, 0.1 - side,  //
               0, 0, 0, 0, 0, 0, 0, 0, 0},
              "wall");
  expect_same(start_of(chain_system("element = \"contact\"\ncount = 3\n")), {0.1, 1.15, 2.2, 0, 0, 0},
              "contact");
  expect_same(start_of(chain_system("element = \"flexible\"\ncount = 4\n")),
              {0.5, 0.5, 0, 0, 0.6, 0.6, 0, 0, 0.7, 0.7, 0, 0, 0.5, 0.5, 0, 0}, "flexible");
  expect_same(start_of(chain_system("element = \"flexible\"\ncount = 2\nbase = [0, 1]\nspread = 0.25\n")),
              {0, 0, 0, 0, 1.25, 1.25, 0, 0}, "flexible");
}

TEST(Chain, AGivenStartStandsInTheOrderOfX) {
  const LinearSystem split =
      chain_system("element = \"wall\"\ncount = 4\ne = 0\nx0 = [1, 2, 3, 4, 5, 6, 7, 8]\n");
  EXPECT_EQ(start_of(split), (Numbers{1, 2, 3, 4, 5, 6, 7, 8}));
  EXPECT_EQ(rates(split, 0.0, start_of(split), Numbers(4, 0.0)).w, (Numbers{1, 2, 3, 4}));
}

// The forces alone: x' at x = 0.
TEST(Chain, PhaseSpreadGivesEachElementItsPhase) {
  const auto forces = [](const std::string& keys, double t) {
    const LinearSystem system = chain_system(keys);
    return rates(system, t, Numbers(static_cast<std::size_t>(system.states()), 0.0),
                 Numbers(static_cast<std::size_t>(system.constraints()), 0.0))
        .x;
  };
  for (const char* element : {"jerk", "flexible", "contact"}) {
    const std::string keys = fmt::format("element = \"{}\"\ncount = 7\n", element);
    const std::string wave = "{offset = -1, amplitude = 2, frequency = 0.5, ";
    std::string list;
    for (int i = 0; i < 7; ++i)
      list += fmt::format("{}phase = {}}}, ", wave, 0.25 + 6.0 * std::fmod(0.6180339887498949 * i, 1.0));
    for (const double t : {0.0, 0.3, 1.7})
      expect_same(forces(keys + "force = " + wave + "phase = 0.25, phase_spread = 6}\n", t),
                  forces(keys + "force = [" + list + "]\n", t), element);
  }
}

TEST(Chain, RanksOwnWholeElements) {
  LinearSystem system = chain_system("element = \"contact\"\ncount = 8\n");
  const auto expect_whole = [&] {
    ASSERT_EQ(system.block.size() % 2, 0U);
    for (std::size_t i = 0; i < system.block.size(); i += 2) {
      const PetscInt element = system.state_order[i];
      EXPECT_EQ(system.state_order[i + 1], 8 + element);  // all q, then all v
      EXPECT_EQ(system.block[i], system.block[i + 1]);
    }
  };
  EXPECT_EQ(system.block_count, 8);
  EXPECT_EQ(system.layout, StateLayout::state_by_state);
  expect_whole();
  RelativeDegree degree = analyse_relative_degree(system);
  distribute(system, degree);
  expect_whole();
}

}  // namespace
}  // namespace sweepvi::test
