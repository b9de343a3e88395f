#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "sweepvi/dvi.hpp"
#include "sweepvi/linear_system.hpp"
#include "sweepvi/time_grid.hpp"

namespace sweepvi {

/// A small sweeping process given in full, row-major; what is empty is not there. Either a box (`lower`,
/// `upper` or both) or a polyhedron (`G` and `g`).
struct DenseSweeping {
  std::vector<double> u0;          ///< n
  std::vector<Signal> f = {};      ///< n
  std::vector<double> A = {};      ///< n x n
  std::vector<Signal> lower = {};  ///< n; offset -infinity: no bound
  std::vector<Signal> upper = {};  ///< n; offset infinity: no bound
  std::vector<double> G = {};      ///< m x n
  std::vector<Signal> g = {};      ///< m
  bool faces_turn = false;         ///< zeros of G belong to its pattern, so that `move_faces` may fill them
};

/// A first-order sweeping process, distributed over the ranks of u0's communicator:
///
///     -u' in N_{K(t)}(u) - A u - f(t),     K(t) = { u : lower(t) <= u <= upper(t) }  or
///                                          K(t) = { u : G(t) u >= g(t) },
///
/// u is pushed by the moving set K(t), and only by it but for A u + f. Rows of A and entries of f, lower and
/// upper are laid out like u, rows of G and entries of g are the faces. A rank may own nothing. Source: Acary
/// & Brogliato (AB), eq. (13); A is ours.
struct SweepingSystem {
  Vector u0;  ///< n; may lie outside K: the first step projects it
  Matrix A;   ///< n x n [1/s], or empty: zero
  Forcing f;  ///< [1/s]
  std::optional<Forcing> lower,
      upper;                          ///< box; an entry may be infinite on its side, where there is no bound
  Matrix G;                           ///< m x n; empty: K is a box
  Forcing g;                          ///< m
  std::vector<PetscInt> state_order;  ///< scene number of each component this rank owns
  std::vector<PetscInt> face_order;   ///< scene number of each face this rank owns
  PetscInt edge_cut = 0;              ///< couplings between ranks

  /// For faces that turn, or move as no signal does: if set, called for the start and for the end of each
  /// step, to overwrite the values of `G`, within its pattern, and of `g`. @note Collective.
  std::function<void(double t, Mat G, Vec g)> move_faces;

  MPI_Comm comm() const;
  PetscInt states() const;  ///< n
  bool is_box() const { return !G; }
  /// Components that have a bound at all, or faces. @note Collective.
  PetscInt constraints() const;

  /// A process given in full on every rank; rows are dealt out in order, the first ranks get more.
  /// @throws Error (bad_input) on every rank if sizes disagree, a number is not finite, there is no set, or
  ///         both a box and a polyhedron
  /// @note Collective on `comm`; all ranks pass the same numbers.
  static SweepingSystem dense(MPI_Comm comm, const DenseSweeping& given);
};

/// Deals a sweeping process out over its ranks and numbers it for low fill, as `distribute` does for linear
/// systems: nonzeros of A and faces couple components. A face lives with the component it reads most.
/// `move_faces` sees the new numbers: `state_order` and `face_order` lead back to the scene's.
/// @note Collective. Rank 0 holds the whole graph for a while.
void distribute(SweepingSystem& system);

/// The catching-up algorithm, AB (19)-(20), on `grid`:
///
///     u_{k+1} = prox(K(t_{k+1}); u_k + h (A u_{k+1} + f(t_{k+1}))).
///
/// A box is a box VI in u alone, whose rows read the measure of u' - A u - f:
///
///     F = (I - hA) u - u_k - h f,     lower <= u <= upper.
///
/// A polyhedron has a multiplier for each face, its measure: (I - hA) u - u_k - h f - G' mu = 0,
/// 0 <= G u - g _|_ mu >= 0. Faces may be redundant, repeated, or more than dimensions at a vertex: u does
/// not depend on that, and where the mu do, they are the smallest ones (in the norm of mu_i |G_i|).
///
/// Each step has one solution if the symmetric part of I - hA is positive definite; see
/// `one_sided_lipschitz`.
///
/// w(): distance to the nearer bound of each component (infinite where there is none), or G u - g; exactly 0
/// in contact. mu(): one column, negative at an upper bound. level(): 1.
///
/// @throws Error (bad_input) on every rank if lower > upper at some t_k (the message names component and
///         time), or if K(t_0) is a polyhedron proved empty. That K(t_{k+1}) is empty is the `obstacle` of
///         that step.
/// @note Collective. `system` must outlive the result.
std::unique_ptr<ConstrainedDvi> make_sweeping_dvi(const SweepingSystem& system, const TimeGrid& grid);

/// An upper bound of v' A v / v' v (Gershgorin): each step has exactly one solution if h times that is below
/// 1. @note Collective.
double one_sided_lipschitz(const SweepingSystem& system);

}  // namespace sweepvi
