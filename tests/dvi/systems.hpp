#pragma once

#include <cmath>
#include <memory>
#include <vector>

#include "sweepvi/linear_dvi.hpp"
#include "sweepvi/time_march.hpp"

namespace sweepvi::test {

/// AB (65), start (1, 0, 0, 0, 0), optionally forced.
inline LinearSystem example65(MPI_Comm comm, const std::vector<Signal>& f = {}) {
  return LinearSystem::dense(comm, {.A = {0,  1,  0,  0,  0,  //
                                          0,  0,  1,  0,  0,  //
                                          -1, -1, -1, 0,  1,  //
                                          0,  0,  0,  0,  1,  //
                                          1,  0,  0,  -1, 0},
                                    .B = {0, 0, 1, 0, 0},
                                    .C = {1, 0, 0, 0, 0},
                                    .x0 = {1, 0, 0, 0, 0},
                                    .f = f});
}

/// Its state at t = 10: an event-driven solution in 50 digits (tests/reference/README.md).
inline const std::vector<double> exact65_at_10 = {2.038074313834594676, 0.453192855214661465,
                                                  -1.056047929937494749, 2.615870338795054074,
                                                  0.624221522682221825};

/// A whole vector on every rank.
inline std::vector<double> everywhere(Vec vector) {
  VecScatter scatter = nullptr;
  Vec all = nullptr;
  check(VecScatterCreateToAll(vector, &scatter, &all));
  check(VecScatterBegin(scatter, vector, all, INSERT_VALUES, SCATTER_FORWARD));
  check(VecScatterEnd(scatter, vector, all, INSERT_VALUES, SCATTER_FORWARD));
  std::vector<double> values;
  {
    const ReadArray array(all);
    values.assign(array.data(), array.data() + array.size());
  }
  check(VecScatterDestroy(&scatter));
  check(VecDestroy(&all));
  return values;
}

/// A whole vector of states, brought from the solver's order into the scene's.
inline std::vector<double> in_scene_order(const LinearSystem& system, const std::vector<double>& states) {
  Vector order;
  check(VecDuplicate(system.x0.get(), order.put()));
  {
    const WriteArray numbers(order.get());
    for (PetscInt i = 0; i < numbers.size(); ++i)
      numbers[i] = static_cast<double>(system.state_order[static_cast<std::size_t>(i)]);
  }
  const std::vector<double> scene_number = everywhere(order.get());
  std::vector<double> ordered(states.size());
  for (std::size_t i = 0; i < states.size(); ++i)
    ordered[static_cast<std::size_t>(scene_number[i])] = states[i];
  return ordered;
}

inline double distance(const std::vector<double>& a, const std::vector<double>& b) {
  double sum = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i)
    sum += (a[i] - b[i]) * (a[i] - b[i]);
  return std::sqrt(sum);
}

/// An option of PETSc's database for one scope.
class ScopedOption {
public:
  ScopedOption(const char* name, const char* value) : name_(name) {
    check(PetscOptionsSetValue(nullptr, name, value));
  }
  ~ScopedOption() { static_cast<void>(PetscOptionsClearValue(nullptr, name_)); }
  ScopedOption(const ScopedOption&) = delete;
  ScopedOption& operator=(const ScopedOption&) = delete;

private:
  const char* name_;
};

}  // namespace sweepvi::test
