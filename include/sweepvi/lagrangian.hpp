#pragma once

#include <memory>
#include <string>
#include <vector>

#include "sweepvi/dvi.hpp"
#include "sweepvi/linear_system.hpp"
#include "sweepvi/scheme.hpp"
#include "sweepvi/time_grid.hpp"

namespace sweepvi {

/// A small Lagrangian system given in full, row-major; `C`, `f`, `g0`, `e` may be empty: zero.
struct DenseLagrangian {
  std::vector<double> M;        ///< n x n
  std::vector<double> K;        ///< n x n
  std::vector<double> H;        ///< m x n
  std::vector<double> q0;       ///< n
  std::vector<double> v0;       ///< n
  std::vector<double> C = {};   ///< n x n
  std::vector<Signal> f = {};   ///< n
  std::vector<double> g0 = {};  ///< m
  std::vector<double> e = {};   ///< m
};

/// A linear mechanical system with unilateral constraints, distributed over the ranks of M's communicator:
///
///     M q'' + C q' + K q = f(t) + H' lambda,    0 <= g = H q + g0  _|_  lambda >= 0,
///     where g_a = 0:  (H v)_a+ >= -e_a (H v)_a-   (Newton's law of impact).
///
/// M is symmetric and positive definite, 0 <= e <= 1. Rows of M, K and C
/// are laid out like q, rows of H like g. A rank may own nothing. The order of the rows is the solver's;
/// `coordinate_order` and `constraint_order` lead back to the scene's.
/// Source: Acary & Brogliato (AB), eq. (14)-(16).
struct LagrangianSystem {
  Matrix M;                                ///< n x n [kg]
  Matrix K;                                ///< n x n [N/m]
  Matrix C;                                ///< n x n [N s/m], or empty: zero
  Matrix H;                                ///< m x n
  Forcing f;                               ///< n [N]
  Vector g0;                               ///< m [m]
  Vector e;                                ///< m
  Vector q0, v0;                           ///< n [m], [m/s]
  std::vector<PetscInt> coordinate_order;  ///< scene number of each coordinate this rank owns
  std::vector<PetscInt> constraint_order;  ///< scene number of each constraint this rank owns
  std::vector<PetscInt> block;             ///< per owned coordinate: the element it belongs to
  PetscInt block_count = 0;                ///< elements in all
  PetscInt edge_cut = 0;                   ///< couplings between ranks, in element pairs

  MPI_Comm comm() const;
  PetscInt coordinates() const;  ///< n
  PetscInt constraints() const;  ///< m

  /// A system of n = size of q0 coordinates, given in full on every rank; rows are dealt out in order.
  /// @throws Error (bad_input) on every rank if sizes disagree or values make no sense, as `check_values`.
  /// @note Collective on `comm`; all ranks pass the same numbers.
  static LagrangianSystem dense(MPI_Comm comm, const DenseLagrangian& given);

  /// Checks what can be checked: M symmetric up to rounding and positive definite (where it is too large to
  /// be factored: as far as Lanczos' method sees), no empty row of H, e in [0, 1].
  /// @throws Error (bad_input) on every rank, naming the scene's row. @note Collective.
  void check_values() const;
};

/// Deals a system out over its ranks by METIS and numbers it for low fill, as `distribute` of a LinearSystem
/// does (partition.hpp). A constraint lives with the coordinate it reads most.
/// @throws Error (internal) on every rank if METIS fails
/// @note Collective.
void distribute(LagrangianSystem& system);

/// The same system in first-order form for HOMSP, x = (q, v), relative degree 2: A = [0 I; -M^-1 K -M^-1 C],
/// B = [0; M^-1 H'], C = [H 0]. States stand as pairs (q_j, v_j); `state_order` has all q, then all v.
/// @throws Error (bad_input) on every rank if M is not diagonal (M^-1 K would be dense) or some e > 0 (HOMSP
/// has no restitution)
/// @note Collective.
LinearSystem to_linear(const LagrangianSystem& system);
/// That form whatever e is: the motion between impacts. @throws Error (bad_input) if M is not diagonal @note
/// Collective.
LinearSystem first_order_form(const LagrangianSystem& system);

/// Where the energy of a mechanical system went since the start, summed over all ranks [J]:
///
///     kinetic + potential + dissipated + damping + scheme - work = their sum at the start,
///
/// exactly, but for rounding.
struct Energy {
  double kinetic = 0.0;     ///< 1/2 v' M v
  double potential = 0.0;   ///< 1/2 q' K q - f' q, f the constant forces
  double dissipated = 0.0;  ///< at impacts: sum of -1/2 mu' (H v_k + H v_{k+1})
  double damping = 0.0;     ///< sum of h v_theta' C v_theta
  double work = 0.0;        ///< of forces that vary, and of a K that is not symmetric
  double scheme = 0.0;      ///< lost to theta > 1/2: (theta - 1/2) (dv' M dv + dq' K dq - mu' H dv)
};

/// A mechanical system as a Dvi. `x` holds this rank's coordinates, then its velocities; `w` the gaps g; `mu`
/// the impulses, in the column of level 2. `level` is 2 where the constraint was detected, else 1; it is in
/// contact (`active`) where it was, and Newton's law held with equality. An impact is the step in which
/// contact begins. Penetration is max(0, -g). There is no `z`.
class MechanicalDvi : public ConstrainedDvi {
public:
  virtual Vec position() const = 0;  ///< q
  virtual Vec velocity() const = 0;  ///< v
  /// @note Collective.
  virtual Energy energy() = 0;
};

struct MoreauJeanOptions {
  double theta = 1.0;  ///< weight of k+1 in the state terms, (0, 1]; 1/2 keeps the energy
  Detection detection = Detection::predicted;
};

/// Discretises `system` by Moreau and Jean's scheme on `grid`: with x_theta = theta x_{k+1} + (1-theta) x_k,
///
///     M (v_{k+1} - v_k) + h [ C v_theta + K q_theta - f_theta ] = H' mu_{k+1},    q_{k+1} = q_k + h v_theta,
///     detected:  0 <= H v_{k+1} + e H v_k  _|_  mu_{k+1} >= 0;      else mu_{k+1} = 0.
///
/// Positions are eliminated: the unknowns are v alone where no two constraints share a coordinate (a box on
/// v), else v and one impulse per constraint; -sweepvi_form box-on-v | primal-dual chooses. Gaps and their
/// velocities are carried along, and those of constraints in contact are exactly -e times the last. Which
/// position detects: a ball dropped on the floor rebounds in the step in which it would pass the floor
/// (predicted), in the one after the first that ended below it (current), or in between.
/// Source: AB (22)-(24), with the misprints of theta and of signs corrected. `system` must outlive the
/// result.
/// @throws Error (bad_input) on every rank: theta outside (0, 1], a form that does not fit
/// @note Collective.
std::unique_ptr<MechanicalDvi> make_moreau_jean(const LagrangianSystem& system,
                                                const MoreauJeanOptions& options, const TimeGrid& grid);

/// Looks at the matrix of Moreau and Jean's steps, J = M + theta h C + theta^2 h^2 K, whose solution has to
/// be the motion's: the symmetric part positive definite, or, where K or C is not symmetric, J nonsingular
/// for all smaller h (from the eigenvalues of up to 200 coordinates; larger ones are not examined then).
/// @return what was found, for people
/// @throws Error (bad_input) on every rank, with the largest h that works. @note Collective.
std::string check_step_matrix(const LagrangianSystem& system, double h, double theta);

/// Why the unknowns cannot be v alone; empty if they can. @note Collective.
std::string against_box_on_v(const LagrangianSystem& system);

}  // namespace sweepvi
