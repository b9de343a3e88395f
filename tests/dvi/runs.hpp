#pragma once

#include <Eigen/Dense>
#include <algorithm>
#include <string>
#include <vector>

#include "dvi/systems.hpp"
#include "parallel/gather.hpp"
#include "sweepvi/partition.hpp"

namespace sweepvi::test {

inline std::vector<double> row_major(const Eigen::MatrixXd& m) {
  std::vector<double> values;
  for (Eigen::Index i = 0; i < m.rows(); ++i)
    for (Eigen::Index j = 0; j < m.cols(); ++j)
      values.push_back(m(i, j));
  return values;
}

struct How {
  Scheme scheme = Scheme::homsp;
  std::string form = "auto";
  std::string snes_type = SNESVINEWTONRSLS;
  std::string predictor = "active-set";
  double theta = 1.0;
};

/// What a run left, on every rank, in the order of the scene.
struct Record {
  struct Event {
    double t;
    PetscInt constraint;
    Side side;
    int level;
    bool impact;
    double impulse;
  };
  bool certified = false;
  Form form = Form::box_on_z;
  PetscInt unknowns = 0, iterations = 0;
  std::size_t steps = 0, constraints = 0, width = 1;
  std::vector<std::vector<double>> x;                 // [step][state]
  std::vector<double> w, level, side, degree, z, mu;  // [step][constraint], z and mu with `width` levels
  std::vector<Event> events;

  std::size_t at(std::size_t step, std::size_t a) const { return step * constraints + a; }
  std::size_t at(std::size_t step, std::size_t a, std::size_t i) const { return at(step, a) * width + i - 1; }
};

inline Record simulate(const DenseSystem& given, const TimeGrid& grid, const How& how = {}) {
  const ScopedOption form("-sweepvi_form", how.form.c_str());
  const ScopedOption type("-snes_type", how.snes_type.c_str());
  const ScopedOption predictor("-sweepvi_predictor", how.predictor.c_str());
  LinearSystem system = LinearSystem::dense(PETSC_COMM_WORLD, given);
  RelativeDegree degree = analyse_relative_degree(system);
  distribute(system, degree);
  Record run;
  run.form = choose_form(system, degree, how.scheme);
  const auto dvi = make_linear_dvi(system, degree, how.scheme, run.form, grid, how.theta);
  check(VecGetSize(dvi->state(), &run.unknowns));
  run.steps = static_cast<std::size_t>(grid.steps);
  run.constraints = static_cast<std::size_t>(system.constraints());
  run.width = static_cast<std::size_t>(std::max(1, degree.highest));
  const std::size_t rows = run.steps * run.constraints;
  for (std::vector<double>* values : {&run.w, &run.level, &run.side})
    values->assign(rows, 0.0);
  for (std::vector<double>* values : {&run.z, &run.mu})
    values->assign(rows * run.width, 0.0);
  run.degree.assign(run.constraints, 0.0);

  TimeMarch march(*dvi, grid);
  march.observe([&](const Step& step, const StepReport& report) {
    const auto k = static_cast<std::size_t>(step.number - 1);
    run.iterations += report.iterations;
    run.x.push_back(in_scene_order(system, everywhere(dvi->x())));
    for (std::size_t a = 0; a < system.constraint_order.size(); ++a) {
      const auto number = static_cast<std::size_t>(system.constraint_order[a]);
      run.w[run.at(k, number)] = dvi->w()[a];
      run.level[run.at(k, number)] = dvi->level()[a];
      run.side[run.at(k, number)] = static_cast<double>(dvi->side()[a]);
      run.degree[number] = degree.degree[a];
      const auto columns = static_cast<std::size_t>(dvi->mu_levels());
      for (std::size_t i = 1; i <= columns; ++i)
        run.mu[run.at(k, number, i)] = dvi->mu()[a * columns + i - 1];
      for (std::size_t i = 1; i <= static_cast<std::size_t>(degree.degree[a]) && !dvi->z().empty(); ++i)
        run.z[run.at(k, number, i)] = dvi->z()[static_cast<std::size_t>(degree.first_level[a]) + i - 1];
    }
    for (const StepEvent& event : dvi->events())
      run.events.push_back({step.t_new, system.constraint_order[static_cast<std::size_t>(event.constraint)],
                            event.side, event.level, event.impact, event.impulse});
  });
  run.certified = march.run().certified && march.steps_taken() == grid.steps;

  for (std::vector<double>* values : {&run.w, &run.level, &run.side, &run.degree, &run.z, &run.mu}) {
    const auto count = static_cast<int>(values->size());
    // One rank knows each entry; the others add zeros.
    if (!run.degree.empty())
      MPI_Allreduce(MPI_IN_PLACE, values->data(), count, MPI_DOUBLE, MPI_SUM, PETSC_COMM_WORLD);
  }
  run.events = gather(PETSC_COMM_WORLD, run.events);
  broadcast(PETSC_COMM_WORLD, run.events);
  std::stable_sort(run.events.begin(), run.events.end(),
                   [](const Record::Event& a, const Record::Event& b) { return a.t < b.t; });
  return run;
}

/// The largest |a - b| / (1 + |b|).
inline double worst(const std::vector<double>& a, const std::vector<double>& b) {
  EXPECT_EQ(a.size(), b.size());
  double result = 0.0;
  for (std::size_t i = 0; i < std::min(a.size(), b.size()); ++i)
    result = std::max(result, std::abs(a[i] - b[i]) / (1.0 + std::abs(b[i])));
  return result;
}

inline double worst(const std::vector<std::vector<double>>& a, const std::vector<std::vector<double>>& b) {
  EXPECT_EQ(a.size(), b.size());
  double result = 0.0;
  for (std::size_t k = 0; k < std::min(a.size(), b.size()); ++k)
    result = std::max(result, worst(a[k], b[k]));
  return result;
}

/// e^M by the Taylor series of M / 2^k, a matrix of norm below 1/8, squared k times: to rounding.
inline Eigen::MatrixXd exponential(Eigen::MatrixXd m) {
  int squarings = 0;
  for (; m.cwiseAbs().rowwise().sum().maxCoeff() > 0.125; ++squarings)
    m /= 2.0;
  Eigen::MatrixXd power = Eigen::MatrixXd::Identity(m.rows(), m.cols());
  Eigen::MatrixXd result = power;
  for (int k = 1; k <= 14; ++k) {  // 0.125^15 / 15! is below 1e-25
    power = power * m / k;
    result += power;
  }
  for (; squarings > 0; --squarings)
    result = (result * result).eval();
  return result;
}

}  // namespace sweepvi::test
