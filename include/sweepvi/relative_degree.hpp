#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "sweepvi/linear_system.hpp"

namespace sweepvi {

/// How lambda reaches each constraint, and what follows from it.
///
/// r_a = the smallest r with C_a A^{r-1} B != 0 (0 where D_a != 0). The products are formed in doubled
/// precision with a bound of their error, from arithmetic and from rounding of the data (none for integers
/// and short binary fractions, half an ulp otherwise). What is within its bound is zero. What is above it
/// counts if only numbers that somebody wrote (decimals of up to nine digits) enter; where computed ones do,
/// it counts above 1e-10 of its terms, as such data carry the rounding of what they were computed from, and
/// what is between is taken as zero if a coupling at least 100 times as large (relative to terms) follows,
/// and else cannot be decided. `LinearSystem::stated_degree` decides there. Outputs z_{a,i} = C_a A^{i-1} x +
/// g_{a,i}(t) for i = 1 ... r_a. A measure of level i acts along d_{a,i} in span{B_a, A B_a, ..., A^{r_a-1}
/// B_a} with z_{a,j}(d_{a,i}) = delta_ij for the constraint's own outputs; at level r that is B_a / M_aa.
/// Source: AB (25)-(39) for one constraint; for many see README.md, "Many constraints".
struct RelativeDegree {
  std::vector<int> degree;  ///< r_a of the constraints this rank owns
  std::vector<PetscInt>
      first_level;  ///< local index of output (a, 1) for each owned constraint; one more at the end
  std::vector<double> markov_diagonal;  ///< M_aa of the owned constraints
  int lowest = 0;                       ///< smallest r_a of all constraints
  int highest = 0;                      ///< largest r_a
  PetscInt outputs = 0;                 ///< sum of r_a (0 for constraints of degree 0)
  Matrix Z;                             ///< outputs x n, rows constraint by constraint, level by level
  Matrix directions;                    ///< outputs x n, row (a, i) is d_{a,i}
  Matrix markov;                        ///< M, m x m: rows C_a A^{r_a - 1} B (D_a where r_a = 0)
  bool outputs_are_states =
      false;  ///< every output is one state of its own, up to scale, and so is its direction
  /// Global number of the state whose place each owned output can take, so that (outputs, other states) are
  /// coordinates with a sparse inverse; empty on all ranks if there is no such choice, or if M is not
  /// diagonal.
  std::vector<PetscInt> pivot;
  bool has_pivots = false;  ///< on all ranks
  /// Smallest |C_a A^{r-1} B| that counted, over (|C||A|^{r-1}|B|): what was left when its terms cancelled.
  double smallest_kept = 0.0;
  double smallest_margin = 0.0;  ///< the same over its error bound; infinite: all of them are exact
  double largest_dropped = 0.0;  ///< largest |C_a A^{i-1} B| over its terms that was taken as zero
  /// Constraints with such a zero that is above its error bound: taken as rounding of computed data.
  std::int64_t doubtful = 0;
};

/// What can be said about the leading Markov matrix M.
struct MarkovReport {
  bool diagonal = true;
  PetscInt nonzeros = 0;
  PetscInt largest_block = 1;   ///< constraints in the largest coupled group
  double condition = 1.0;       ///< largest 2-norm condition of the coupled groups examined
  bool condition_known = true;  ///< false where a coupled group is too large to examine densely
  enum class Solvability {
    positive_definite,
    p_matrix,
    positive_semidefinite,
    not_checked
  } solvability = Solvability::positive_definite;
  std::array<PetscInt, 8> doubtful{};  ///< the first constraints of the group that made it worst
  int doubtful_count = 0;

  /// What a step that could not be solved may owe to the matrix; empty where each step has a solution.
  std::string diagnosis() const;
};

/// @throws Error (bad_input) on every rank if lambda never reaches a constraint, if its degree can not be
/// decided or contradicts what is stated, or if D stands beside a degree above 1.
/// @note Collective on the system's communicator.
RelativeDegree analyse_relative_degree(const LinearSystem& system);

/// Checks that M makes each step's complementarity problem solvable: M_aa > 0, nonsingular, a P-matrix as far
/// as it can be checked; for degrees <= 1 positive semidefinite suffices.
/// @throws Error (bad_input) on every rank, naming the constraints, if M is singular or a diagonal entry
/// negative.
/// @note Collective.
MarkovReport check_markov_matrix(const LinearSystem& system, const RelativeDegree& relative_degree);

/// Largest real part of the zero dynamics' spectrum (states with all outputs held at zero), for n <= `limit`.
/// @return size n - sum r and the largest real part; the latter is NaN when n > limit or the size is 0.
/// @note Collective.
struct ZeroDynamics {
  PetscInt size = 0;
  double largest_real_part = 0.0;
};
ZeroDynamics zero_dynamics(const LinearSystem& system, const RelativeDegree& relative_degree,
                           PetscInt limit = 500);

}  // namespace sweepvi
