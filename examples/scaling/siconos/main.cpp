// The wall chain of sweepvi with Siconos: N unit masses above walls, springs of stiffness 1 between
// neighbours and to fixed ends, force -1/2, restitution 1/2; Moreau and Jean's scheme, theta = 1/2, contact
// detected at the midpoint.
//
//     q_i'' = S(q)_i - 1/2 + lambda_i,  q_i >= 0,   q_i(0) = 0.1 + 0.05 sin(6 pi i / N)
//
// usage: wall_chain dense|single N STEPS H TRAJECTORY
//   dense   one LagrangianLinearTIDS of N degrees of freedom: the scheme that sweepvi has
//   single  N of one degree of freedom, springs as forces known at the middle of the step: another scheme,
//   order h^2 apart
// Prints the seconds of each step, a line each; TRAJECTORY gets q and v at all times as they lie in memory.
#include <SiconosKernel.hpp>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <vector>

namespace {

constexpr double force = -0.5, restitution = 0.5, coupling = 1.0;

double start(int i, int n) {
  return 0.1 + 0.05 * std::sin(2.0 * std::acos(-1.0) * 3.0 * i / n);
}

/// S(q)_i
double springs(const std::vector<double>& q, int i) {
  const int n = static_cast<int>(q.size());
  const auto at = [&](int j) { return j < 0 || j >= n ? 0.0 : q[static_cast<std::size_t>(j)]; };
  return coupling * (at(i - 1) - 2.0 * at(i) + at(i + 1));
}

}  // namespace

int main(int argc, char** argv) try {
  if (argc != 6) {
    std::fprintf(stderr, "usage: wall_chain dense|single N STEPS H TRAJECTORY\n");
    return 2;
  }
  const bool dense = std::strcmp(argv[1], "dense") == 0;
  const int n = std::atoi(argv[2]);
  const int steps = std::atoi(argv[3]);
  const double h = std::atof(argv[4]);

  auto system = std::make_shared<NonSmoothDynamicalSystem>(0.0, (steps + 1) * h);
  auto law = std::make_shared<NewtonImpactNSL>(restitution);
  std::vector<SP::LagrangianLinearTIDS> bodies;
  if (dense) {
    auto q = std::make_shared<SiconosVector>(n), v = std::make_shared<SiconosVector>(n),
         f = std::make_shared<SiconosVector>(n);
    auto mass = std::make_shared<SimpleMatrix>(n, n), stiffness = std::make_shared<SimpleMatrix>(n, n);
    for (int i = 0; i < n; ++i) {
      (*q)(i) = start(i, n);
      (*f)(i) = force;
      (*mass)(i, i) = 1.0;
      (*stiffness)(i, i) = 2.0 * coupling;
      if (i > 0) (*stiffness)(i, i - 1) = (*stiffness)(i - 1, i) = -coupling;
    }
    bodies.push_back(std::make_shared<LagrangianLinearTIDS>(q, v, mass));
    bodies.front()->setKPtr(stiffness);
    bodies.front()->setFExtPtr(f);
    system->insertDynamicalSystem(bodies.front());
  }
  for (int i = 0; i < n; ++i) {
    auto reads = std::make_shared<SimpleMatrix>(1, dense ? n : 1);
    (*reads)(0, dense ? i : 0) = 1.0;
    if (!dense) {
      auto q = std::make_shared<SiconosVector>(1), v = std::make_shared<SiconosVector>(1);
      auto mass = std::make_shared<SimpleMatrix>(1, 1);
      (*q)(0) = start(i, n);
      (*mass)(0, 0) = 1.0;
      bodies.push_back(std::make_shared<LagrangianLinearTIDS>(q, v, mass));
      bodies.back()->setFExtPtr(std::make_shared<SiconosVector>(1));
      system->insertDynamicalSystem(bodies.back());
    }
    auto contact = std::make_shared<Interaction>(law, std::make_shared<LagrangianLinearTIR>(reads));
    system->link(contact, bodies.back());
  }
  auto integrator = std::make_shared<MoreauJeanOSI>(0.5);  // q + h v/2 decides
  integrator->setConstraintActivationThreshold(0.0);       // it has no value of its own
  auto problem = std::make_shared<LCP>(SICONOS_LCP_LEMKE);
  auto simulation = std::make_shared<TimeStepping>(system, std::make_shared<TimeDiscretisation>(0.0, h),
                                                   integrator, problem);

  std::ofstream trajectory(argv[5], std::ios::binary);
  std::vector<double> q(static_cast<std::size_t>(n)), v(q), middle(q);
  const auto keep = [&] {
    for (int i = 0; i < n; ++i) {
      const auto& body = *bodies[dense ? 0 : static_cast<std::size_t>(i)];
      q[static_cast<std::size_t>(i)] = (*body.q())(dense ? i : 0);
      v[static_cast<std::size_t>(i)] = (*body.velocity())(dense ? i : 0);
    }
    const auto bytes = static_cast<std::streamsize>(sizeof(double) * q.size());
    trajectory.write(reinterpret_cast<const char*>(q.data()), bytes);
    trajectory.write(reinterpret_cast<const char*>(v.data()), bytes);
  };
  keep();
  for (int k = 0; k < steps; ++k) {
    const auto begin = std::chrono::steady_clock::now();
    if (!dense) {
      for (int i = 0; i < n; ++i) {
        const auto& body = *bodies[static_cast<std::size_t>(i)];
        middle[static_cast<std::size_t>(i)] = (*body.q())(0) + 0.5 * h * (*body.velocity())(0);
      }
      for (int i = 0; i < n; ++i)
        (*bodies[static_cast<std::size_t>(i)]->fExt())(0) = force + springs(middle, i);
    }
    simulation->computeOneStep();
    simulation->nextStep();
    const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - begin;
    std::printf("%.9e\n", seconds.count());
    keep();
  }
  return trajectory.good() ? 0 : 5;
} catch (const std::exception& error) {
  std::fprintf(stderr, "wall_chain: %s\n", error.what());
  return 1;
}
