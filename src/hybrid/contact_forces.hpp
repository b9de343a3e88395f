#pragma once

#include <vector>

#include "hybrid/pivoted_lu.hpp"
#include "sweepvi/dvi.hpp"
#include "sweepvi/linear_system.hpp"
#include "sweepvi/petsc.hpp"
#include "sweepvi/relative_degree.hpp"

namespace sweepvi {

/// What a constraint does in a problem for multipliers.
enum class Role : signed char {
  upper = -1,  ///< lambda <= 0 and rest <= 0, one of them 0
  off = 0,     ///< lambda = 0, the rest is free
  lower = 1,   ///< lambda >= 0 and rest >= 0, one of them 0
  holds = 2,   ///< the rest is 0, lambda is free
  between = 3  ///< 0 <= rest <= wmax, lambda >= 0 at 0, <= 0 at wmax, 0 between them
};

/// Problems in multipliers with the leading Markov matrix M: rest = a + M lambda.
///
/// Groups of up to 64 constraints that M couples to each other only are solved densely with complete
/// pivoting, rows that depend on earlier ones get the multiplier 0; larger ones, and those over several ranks
/// where there are more than 64 constraints in all, by PETSc (prefix sweepvi_contact_). Complementary ones
/// are tried by active sets, from who was in contact last and from nobody, and then go to a StepSolver,
/// certified like any step. All methods are collective.
class ContactForces {
public:
  ContactForces(const LinearSystem& system, const RelativeDegree& degree);

  bool coupled() const { return coupled_; }  ///< M is not diagonal

  /// M_SS y = right_S, y = 0 elsewhere. @param values in: right, out: y
  /// @return false if M_SS could not be factored
  bool solve(const std::vector<char>& set, std::vector<double>& values);

  /// The mixed complementarity problem. @param small  what is zero in a row, up to rounding
  /// @param guess  who may carry a force, at which wall
  /// @return false if no solution was found
  bool complement(double t, const std::vector<Role>& roles, const std::vector<double>& a,
                  const std::vector<double>& small, const std::vector<Side>& guess,
                  std::vector<double>& lambda, std::vector<double>& rest);

  /// rest = a + M lambda.
  void find_rest(const std::vector<double>& a, const std::vector<double>& lambda, std::vector<double>& rest);

  /// Below this multipliers of a solution are zero, where their rows know what they are made of up to
  /// `small`,
  ///
  ///     |M_SS^-1| small,   S: who has a rest of 0 and may carry a force;
  ///
  /// `small` becomes what their rests are known up to with that, small + |M| |M_SS^-1| small.
  std::vector<double> negligible(const std::vector<Role>& roles, const std::vector<double>& rest,
                                 std::vector<double>& small);

private:
  /// Constraints that M couples to no other ones.
  struct Group {
    std::vector<std::size_t> members;         // of the vectors that it is solved in
    std::vector<std::vector<double>> matrix;  // of members
  };
  struct Factor {
    std::vector<char> set;
    std::vector<PivotedLu> groups;
    Matrix matrix;  // of those in no group
    LinearSolver solver;
  };
  void find_groups();
  void gather_all();
  Factor& factor(const std::vector<char>& set);
  std::vector<double> bound_of_forces(const std::vector<char>& set, const std::vector<double>& small);
  Matrix masked(const std::vector<char>& set) const;
  std::vector<double> from_all(const std::vector<double>& own) const;
  struct Problem {
    const std::vector<Role>& roles;
    const std::vector<double>&a, &small;
  };
  bool fits(const Problem& problem, std::vector<Side>& sides, std::vector<double>& lambda,
            std::vector<double>& rest);
  bool solve_vi(double t, const Problem& problem, std::vector<double>& lambda);

  MPI_Comm comm_;
  const RelativeDegree& degree_;
  bool coupled_ = false, zero_diagonal_ = false;
  bool together_ = false;      // one group of all constraints, the same on every rank
  bool any_single_ = false;    // some constraint, on some rank, is in no group
  std::vector<char> grouped_;  // own constraints
  std::vector<Group> groups_;
  std::vector<int> counts_, begins_;  // of each rank's constraints, where together_
  std::vector<double> upper_;         // walls
  std::vector<Factor> factors_;       // of the sets seen last
  std::size_t next_ = 0;
  Matrix abs_markov_;
  Vector in_, out_;
};

}  // namespace sweepvi
