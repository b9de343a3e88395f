#pragma once

#include <cmath>
#include <string>
#include <vector>

#include "sweepvi/petsc.hpp"
#include "sweepvi/signal.hpp"

namespace sweepvi {

/// f(t): a constant part and the entries that vary.
struct Forcing {
  struct Entry {
    PetscInt local = 0;  ///< this rank's row, from 0
    Signal signal;
    double sine = std::sin(signal.phase), cosine = std::cos(signal.phase);
  };
  std::vector<Entry> constant;  ///< signals that do not vary, this rank's rows
  std::vector<Entry> varying;   ///< this rank's rows
  bool any = false;             ///< some rank has an entry
  bool varies = false;          ///< some rank has a varying entry

  /// The rows [first, last) of signals that every rank knows in full.
  static Forcing from(const std::vector<Signal>& all, PetscInt first, PetscInt last);

  /// Sets the rows of y that have an entry to 0. @note Not collective.
  void clear(Vec y) const;
  /// y += factor * d^order f / dt^order at t. @note Not collective; y has the layout of x.
  void add_to(Vec y, double t, int order, double factor) const;
  /// The same of those that vary, to this rank's entries.
  void add_varying_to(double* y, double t, int order, double factor) const;
  /// The same with the largest value that each derivative ever has, which rounding of its value is relative
  /// to.
  void add_bound_to(Vec y, int order, double factor) const;
};

/// How a scene numbers the states of its elements; x0 and /x stand in that order.
enum class StateLayout {
  element_by_element,  ///< all states of element 0, then of element 1, ...
  state_by_state       ///< the first state of every element, then the second, ...
};

/// A row of the scene that says the opposite of an owned constraint a, as the second wall of a mass between
/// two: C_b = -s C_a and B_b = -t B_a, s, t > 0. The two are solved as one, 0 <= w_a <= w0_a + w0_b / s =
/// wmax_a, and w_b = s (wmax_a - w_a).
struct OppositeRow {
  PetscInt constraint;      ///< a, local
  PetscInt number;          ///< b, scene number
  double output_scale;      ///< s
  double multiplier_scale;  ///< t
};

/// A small system given in full, row-major; `D`, `f`, `w0`, `wmax` may be empty.
struct DenseSystem {
  std::vector<double> A;          ///< n x n
  std::vector<double> B;          ///< n x m
  std::vector<double> C;          ///< m x n
  std::vector<double> x0;         ///< n
  std::vector<double> D = {};     ///< m x m
  std::vector<Signal> f = {};     ///< n
  std::vector<double> w0 = {};    ///< m
  std::vector<double> wmax = {};  ///< m, > 0; infinite: none
};

/// A linear system with state constraints, distributed over the ranks of A's communicator:
///
///     x' = A x + B lambda + f(t),   w = C x + D lambda + w0,   0 <= w <= wmax,
///
/// lambda >= 0 acts at w = 0, lambda <= 0 at w = wmax, in the sense of the constraint's relative degree.
/// Rows of A and B are laid out like x, rows of C and D like w (and lambda). A rank may own nothing. The
/// order of the rows is the solver's; `state_order` and `constraint_order` lead back to the scene's. Source:
/// Acary & Brogliato (AB), eq. (18).
struct LinearSystem {
  Matrix A;  ///< n x n [1/s]
  Matrix B;  ///< n x m
  Matrix C;  ///< m x n
  Matrix D;  ///< m x m, or empty: zero
  Forcing f;
  Vector w0;                               ///< m
  Vector wmax;                             ///< m, PETSC_INFINITY where there is none; empty: none at all
  Vector x0;                               ///< n, state at the start
  std::vector<PetscInt> state_order;       ///< scene number of each state this rank owns
  std::vector<PetscInt> constraint_order;  ///< scene number of each constraint this rank owns
  std::vector<OppositeRow> opposite;       ///< rows merged into this rank's constraints
  /// Relative degrees that the scene states, in its order, on every rank; one: for all constraints; empty:
  /// none. They decide where numbers cannot, see RelativeDegree.
  std::vector<int> stated_degree;
  std::vector<PetscInt> block;           ///< per owned state: the element it belongs to, kept on one rank
  PetscInt block_count = 0;              ///< elements in all
  std::vector<std::string> state_names;  ///< of one element's states, alike for all; may be empty
  StateLayout layout = StateLayout::element_by_element;  ///< where the scene has them
  PetscInt edge_cut = 0;                                 ///< couplings between ranks, in element pairs

  MPI_Comm comm() const;
  PetscInt states() const;       ///< n
  PetscInt constraints() const;  ///< m

  PetscInt scene_constraints() const;  ///< m and the merged rows. @note Collective.

  /// A system of n = size of x0 states, given in full on every rank; rows are dealt out in order, the first
  /// ranks get more.
  /// @throws Error (bad_input) on every rank if sizes disagree or a number is not finite.
  /// @note Collective on `comm`; all ranks pass the same numbers.
  static LinearSystem dense(MPI_Comm comm, const DenseSystem& given);
};

}  // namespace sweepvi
