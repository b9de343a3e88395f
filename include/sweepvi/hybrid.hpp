#pragma once

#include <cstdint>
#include <memory>
#include <string>
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
///     x' = A x + B lambda + f(t),   w = C x + D lambda + w0,   lambda = 0 on free constraints, w = 0 on
///     those in contact,
///
/// and whose jumps are steps of length 0 of its Dvi. All methods are collective.
class HybridProcess {
public:
  virtual ~HybridProcess() = default;

  virtual Dvi& dvi() = 0;
  virtual const LinearSystem& system() const = 0;
  virtual const RelativeDegree& degree() const = 0;
  /// What moves with time in w = C x + w0 + offset(t), where all degrees are equal; null: nothing.
  virtual const Forcing* offset() const { return nullptr; }
  /// Whether steps of length 0 leave positions beyond a wall where they are.
  virtual bool keeps_positions() const { return false; }

  /// The state of the Dvi at t: x in the system's layout, outputs z like the rows of Z. What stands at its
  /// wall is exactly there.
  virtual void read(double t, Vec x, std::vector<double>& z) = 0;
  /// Replaces the state of the Dvi. @param w  constraint values @param contact  wall at which each constraint
  /// is in contact @param mu  measure of each constraint's multiplier since the state was last written
  virtual void write(Vec x, const std::vector<double>& z, const std::vector<double>& w,
                     const std::vector<Side>& contact, const std::vector<double>& mu) = 0;
  /// Walls at which constraints are in contact in the state of the Dvi.
  virtual std::vector<Side> in_contact() = 0;
  /// Constraints that are equations: in contact for good, by multipliers of any sign. Empty: there are none.
  virtual std::vector<char> equations() const { return {}; }
  /// Why there is no motion at t with these constraints in contact; empty if there is. The same on every
  /// rank.
  virtual std::string against(double t, const std::vector<Side>& contact);
  /// Replaces the events that the Dvi tells of.
  virtual void tell(std::vector<StepEvent> events) = 0;
  /// The jump of the state at an event, one step of length 0. @param met  constraints whose impact at this
  /// instant has been told of; those of this jump are added
  virtual StepReport reset(StepSolver& solver, const Step& step, std::vector<char>& met) = 0;

  /// Shows one number of each state, of each constraint, by the entities that a checkpoint knows
  /// (StateVisitor).
  virtual void show_states(StateVisitor& visitor, const char* name, std::vector<double>& numbers);
  virtual void show_constraints(StateVisitor& visitor, const char* name, std::vector<double>& numbers);
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
  double tolerance = 1e-8;  ///< error over the whole run, relative to the size of each component; see Motion
  double start = 0.0, end = 1.0;  ///< of the run [s]
};

/// What it did.
struct HybridCounts {
  std::int64_t expansions = 0;    ///< Taylor series
  std::int64_t coefficients = 0;  ///< vectors in them, one MatMult with A each
  std::int64_t events = 0;        ///< instants at which a constraint was hit or released
  std::int64_t resets = 0;        ///< box VIs of length 0
  std::int64_t closed = 0;        ///< accumulations that were ended: flights below the tolerance
  double error = 0.0;             ///< estimate of the largest error of a component of x at the time reached
  double relative_error = 0.0;    ///< the same, of each component relative to its size so far
};

}  // namespace sweepvi
