#pragma once

#include <memory>

#include "petsc/finite_differences.hpp"
#include "sweepvi/nonlinear_lagrangian.hpp"

namespace sweepvi {

/// What a step of Moreau and Jean's scheme asks of v_{k+1} = v, but for impulses:
///
///     R(v) = M(q_theta) (v - v_k) + h [ theta F(q_{k+1}, v, t_{k+1}) + (1-theta) F(q_k, v_k, t_k) ],
///
/// positions eliminated, and its Jacobian, the system's own or by finite differences. All collective.
class Momentum {
public:
  Momentum(const NonlinearLagrangian& system, double theta, double h);

  void set_step(double h) { h_ = h; }  ///< before the next start
  /// From here on; q and v must stay as they are until the next start.
  void start(double t_old, double t_new, Vec q, Vec v);
  void evaluate(Vec v, Vec result);
  Mat jacobian(Vec v);             ///< valid until the next call
  Mat differences(Vec v);          ///< by finite differences, likewise
  Mat mass(Vec q);                 ///< M(q), valid until the next call of any member
  Matrix create_jacobian() const;  ///< empty, with its pattern

  Vec free_terms() const { return f_old_.get(); }  ///< h (1-theta) F_k

private:
  void place(Vec v);

  const NonlinearLagrangian& system_;
  double theta_, h_;
  double t_new_ = 0.0;
  Vec q_ = nullptr;
  Vec v_ = nullptr;
  Matrix mass_, jacobian_;
  Vector f_old_, q_new_, q_theta_, dv_, work_;
  std::unique_ptr<FiniteDifferences> differences_;
};

}  // namespace sweepvi
