#pragma once

#include <cstdint>
#include <vector>

#include "dvi/contact_kernels.hpp"
#include "dvi/contact_state.hpp"
#include "petsc/vector_value.hpp"

namespace sweepvi {

/// Contacts of Moreau and Jean's scheme as a box on v: each constraint reads one coordinate of this rank,
/// H_aj v_j >= -e_a (H v_k)_a where it is detected, and no two read the same.
class BoxContacts {
public:
  explicit BoxContacts(ContactState& contacts) : contacts_(&contacts) {}

  /// Reads which coordinate belongs to which constraint; contacts have to be started. @note Collective.
  void start(Mat H, Vec g0);

  /// Box rule, and the bounds it makes. Only coordinates of constraints ever have one.
  void begin(Vec lower, Vec upper, double h, Detection detection);
  /// Puts velocities that are on their bound, up to rounding of their rows' terms, exactly there. Says
  /// whether anything on this rank moved.
  bool settle(Vec u, Vec terms);
  /// Takes impulses, which are what F is left with where v stands on its bound, and moves on gaps and their
  /// velocities; adds what is lost in impacts and by the scheme. @param scale  1 / d of the rows
  /// @param q  q_{k+1}
  void take(Vec u, Vec f, Vec q, Vec scale, double h, double theta, Energy& lost);
  /// Levels were replaced from outside.
  void forget() { has_levels_ = false; }

private:
  /// Constraints side by side whose coordinates are, too.
  struct Run {
    std::int32_t first, count;
  };
  template <class Visit>
  void each_run(Visit&& visit);

  ContactState* contacts_;
  std::vector<PetscInt> place_;                                      // of each constraint: its coordinate
  std::vector<double> weight_;                                       // H there
  std::vector<double> offset_;                                       // g0
  std::vector<double> bound_;                                        // on v
  std::vector<double> held_terms_;                                   // of the rows, when settled
  bool same_e_ = false, same_weight_ = false, same_offset_ = false;  // of all constraints of this rank
  std::vector<Run> runs_;
  std::vector<std::int32_t> changed_;  // room for those whose contact begins or ends
  bool has_levels_ = false;            // those of bound_
  VectorValue lower_, upper_;          // who has these bounds, and no others
};

}  // namespace sweepvi
