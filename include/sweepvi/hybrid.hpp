#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "sweepvi/dvi.hpp"
#include "sweepvi/linear_system.hpp"
#include "sweepvi/relative_degree.hpp"
#include "sweepvi/step_solver.hpp"

namespace sweepvi {

class ImpactDvi;
class ImpactOscillators;
class MechanicalDvi;
struct SweepingSystem;
struct LagrangianSystem;

/// A process whose motion between events is that of a linear system in contact with some of its constraints,
/// as the hybrid scheme sees it:
///
///     x' = A x + B lambda + f(t),   w = C x + w0,   lambda = 0 on free constraints, w = 0 on those in
///     contact,
///
/// and whose events are steps of length 0 of its Dvi. All methods are collective.
class HybridProcess {
public:
  virtual ~HybridProcess() = default;

  virtual Dvi& dvi() = 0;
  virtual const LinearSystem& system() const = 0;
  virtual const RelativeDegree& degree() const = 0;
  /// What moves with time in w = C x + w0 + offset(t), where all degrees are equal; null: nothing.
  virtual const Forcing* offset() const { return nullptr; }
  /// Whether these constraints can be in contact together; if not, steps are taken instead. @note Not
  /// collective.
  virtual bool admits(const std::vector<Side>&) const { return true; }

  /// The state of the Dvi at t: x in the system's layout, outputs z like the rows of Z. What stands at its
  /// wall is exactly there.
  virtual void read(double t, Vec x, std::vector<double>& z) = 0;
  /// Replaces the state of the Dvi. @param contact  wall at which each constraint is in contact
  /// @param mu  measure of each constraint's multiplier since the state was last written
  virtual void write(Vec x, const std::vector<double>& z, const std::vector<Side>& contact,
                     const std::vector<double>& mu) = 0;
  /// Walls at which constraints are in contact after a step of the Dvi.
  virtual std::vector<Side> in_contact() = 0;
  /// Replaces the events that the Dvi tells of.
  virtual void tell(std::vector<StepEvent> events) = 0;
  /// The jump of the state at an event, one step of length 0.
  virtual StepReport reset(StepSolver& solver, const Step& step);
};

/// A linear system that HOMSP steps. All must outlive the result.
std::unique_ptr<HybridProcess> make_hybrid(ConstrainedDvi& dvi, const LinearSystem& system,
                                           const RelativeDegree& degree);
/// A mechanical system that Moreau and Jean's scheme steps, detecting at the predicted position. Both must
/// outlive the result.
/// @throws Error (bad_input) on every rank if M is not diagonal @note Collective.
std::unique_ptr<HybridProcess> make_hybrid(MechanicalDvi& dvi, const LagrangianSystem& system);

/// Impact oscillators without a regulator, a chain of the element "zhuravlev-ivanov". All must outlive the
/// result. @note Collective.
std::unique_ptr<HybridProcess> make_hybrid(ImpactDvi& dvi, const ImpactOscillators& oscillators,
                                           const LinearSystem& system);

/// A moving set that the catching-up algorithm steps, without `move_faces`. Both must outlive the result.
/// @throws Error (bad_input) on every rank if a face reads nothing @note Collective.
std::unique_ptr<HybridProcess> make_hybrid(ConstrainedDvi& dvi, const SweepingSystem& system);

/// How the hybrid scheme works.
struct HybridOptions {
  double tolerance = 1e-8;  ///< error of the smooth motion over the whole run, relative to the size of x
  double start = 0.0, end = 1.0;  ///< of the run [s]
  std::int64_t crowd = 1000;  ///< -sweepvi_hybrid_events: in one interval; beyond, the rest is time-stepped
};

/// What it did.
struct HybridCounts {
  std::int64_t expansions = 0;    ///< Taylor series
  std::int64_t coefficients = 0;  ///< vectors in them, one MatMult with A each
  std::int64_t events = 0;        ///< instants at which a constraint was hit or released
  std::int64_t resets = 0;        ///< box VIs of length 0
  std::int64_t steps = 0;         ///< of the time-stepping scheme, where events accumulate or crowd
  double stepped = 0.0;           ///< time covered by them [s]
};

}  // namespace sweepvi
