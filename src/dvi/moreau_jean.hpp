#pragma once

#include <utility>
#include <vector>

#include "dvi/contact_state.hpp"

namespace sweepvi {

/// The sums over all ranks. @note Collective.
Energy summed(MPI_Comm comm, const Energy& mine);

/// What the linear and the nonlinear form of Moreau and Jean's scheme share: positions, velocities, contacts,
/// where the energy went, and reading them.
class MoreauJean : public MechanicalDvi {
public:
  MPI_Comm comm() const final { return comm_; }
  Vec state() const final { return u_.get(); }
  Vec x() const final;
  Vec position() const final { return q_.get(); }
  Vec velocity() const final { return v_.get(); }
  const std::vector<double>& w() const final { return contacts_.gap; }
  const std::vector<double>& z() const final { return no_outputs_; }
  const std::vector<double>& mu() const final { return contacts_.mu; }
  int mu_levels() const final { return 2; }
  const std::vector<int>& level() const final { return contacts_.level; }
  const std::vector<Side>& side() const final { return contacts_.side; }
  const std::vector<StepEvent>& events() const final { return contacts_.events; }
  void tell(std::vector<StepEvent> events) final { contacts_.events = std::move(events); }
  double penetration() const final { return depth_; }
  bool suspect() const final;
  std::string defect() final;
  PetscInt active() const final { return contacts_.active(); }
  void visit(StateVisitor& visitor) override;

protected:
  /// @throws Error (bad_input) if theta is outside (0, 1]
  MoreauJean(MPI_Comm comm, const MoreauJeanOptions& options, double h, Vec q0, Vec v0);

  /// dq = h v_theta, from the first entries of u.
  void find_increment(Vec u);
  /// q += dq.
  void move();
  /// v = v_{k+1}.
  void take_velocity(Vec u);
  /// Looks how deep and how fast contacts are, once they have moved; `at_start`: that is where they start
  /// from.
  /// @note Collective.
  void look_at_contacts(bool at_start = false);
  /// As messages call an owned constraint.
  virtual PetscInt scene_number(std::size_t a) const = 0;

  MPI_Comm comm_;
  double h_;      // [s]
  double theta_;  // weight of k+1
  Detection detection_;
  PetscInt local_ = 0;  // coordinates of this rank
  ContactState contacts_;
  Energy lost_;  // this rank's part of all but kinetic and potential
  Vector u_;     // where velocities are all there is, v_
  Vector x_, q_, v_, dq_;

private:
  double limit() const;  ///< how deep a contact may be

  double depth_ = 0.0;        // largest penetration of all ranks
  double start_depth_ = 0.0;  // the same at the start
  double top_speed_ = 0.0;    // largest |H v| of all ranks so far
  mutable bool knows_x_ = false;
  std::vector<double> no_outputs_;
};

}  // namespace sweepvi
