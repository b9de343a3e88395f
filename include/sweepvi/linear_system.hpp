#pragma once

#include <string>
#include <vector>

#include "sweepvi/petsc.hpp"
#include "sweepvi/signal.hpp"

namespace sweepvi {

/// f(t): a constant part and the entries that vary.
struct Forcing {
  struct Entry {
    PetscInt local;  ///< this rank's row, from 0
    Signal signal;
  };
  std::vector<Entry> constant;  ///< signals that do not vary, this rank's rows
  std::vector<Entry> varying;   ///< this rank's rows
  bool any = false;             ///< some rank has an entry
  bool varies = false;          ///< some rank has a varying entry

  /// The rows [first, last) of signals that every rank knows in full.
  static Forcing from(const std::vector<Signal>& all, PetscInt first, PetscInt last);

  /// y += factor * d^order f / dt^order at t. @note Not collective; y has the layout of x.
  void add_to(Vec y, double t, int order, double factor) const;
};

/// How a scene numbers the states of its elements; x0 and /x stand in that order.
enum class StateLayout {
  element_by_element,  ///< all states of element 0, then of element 1, ...
  state_by_state       ///< the first state of every element, then the second, ...
};

/// A linear system with state constraints, distributed over the ranks of A's communicator:
///
///     x' = A x + B lambda + f(t),   w = C x + D lambda + w0,   0 <= w  _|_  lambda >= 0 in the sense of its
///     degree.
///
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
  Vector x0;                               ///< n, state at the start
  std::vector<PetscInt> state_order;       ///< scene number of each state this rank owns
  std::vector<PetscInt> constraint_order;  ///< scene number of each constraint this rank owns
  std::vector<PetscInt> block;             ///< per owned state: the element it belongs to, kept on one rank
  PetscInt block_count = 0;                ///< elements in all
  std::vector<std::string> state_names;    ///< of one element's states, alike for all; may be empty
  StateLayout layout = StateLayout::element_by_element;  ///< where the scene has them
  PetscInt edge_cut = 0;                                 ///< couplings between ranks, in element pairs

  MPI_Comm comm() const;
  PetscInt states() const;       ///< n
  PetscInt constraints() const;  ///< m

  /// A small system given in full on every rank; rows are dealt out in order, the first ranks get more.
  /// `a`, `b`, `c`, `d` are row-major n x n, n x m, m x n, m x m (d may be empty), `f` and `w0` may be empty.
  /// @throws Error (bad_input) on every rank if sizes disagree or a number is not finite.
  /// @note Collective on `comm`; all ranks pass the same numbers.
  static LinearSystem dense(MPI_Comm comm, PetscInt n, PetscInt m, const std::vector<double>& a,
                            const std::vector<double>& b, const std::vector<double>& c,
                            const std::vector<double>& x0, const std::vector<double>& d = {},
                            const std::vector<Signal>& f = {}, const std::vector<double>& w0 = {});
};

}  // namespace sweepvi
