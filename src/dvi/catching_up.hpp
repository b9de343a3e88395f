#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "sweepvi/sweeping.hpp"
#include "sweepvi/time_grid.hpp"
#include "vi/proximal_newton.hpp"

namespace sweepvi {

/// What boxes and polyhedra share: contacts, their measures and events, and reading them.
class CatchingUp : public ConstrainedDvi {
public:
  MPI_Comm comm() const final { return system_.comm(); }
  Vec state() const final { return u_.get(); }
  std::uint64_t jacobian_version() const final { return version_; }
  double penetration() const final;
  PetscInt active() const final;
  const std::vector<double>& w() const final { return w_; }
  const std::vector<double>& z() const final { return no_outputs_; }
  const std::vector<double>& mu() const final { return mu_; }
  int mu_levels() const final { return 1; }
  const std::vector<int>& level() const final { return level_; }
  const std::vector<Side>& side() const final { return old_side_; }
  const std::vector<StepEvent>& events() const final { return events_; }
  void tell(std::vector<StepEvent> events) final { events_ = std::move(events); }
  void visit(StateVisitor& visitor) override;

protected:
  CatchingUp(const SweepingSystem& system, const TimeGrid& grid);
  void allocate(std::size_t constraints);
  /// The sides of the start, with its w_.
  void start(const std::vector<Side>& side);
  /// Takes the sides of a finished step, with its w_ and mu_, and derives its events: an impact where contact
  /// closes (or a start outside K is projected), a lift-off where it ends.
  void advance(const std::vector<Side>& side);

  const SweepingSystem& system_;
  double h_;  // [s]
  std::uint64_t version_ = 0;
  Vector u_;                // unknowns
  std::vector<double> w_;   // exactly 0 in contact; negative only at a start outside K
  std::vector<double> mu_;  // of the last step
  std::vector<int> level_;  // of the last step
  std::vector<Side> side_;  // at the time reached
  std::vector<StepEvent> events_;

private:
  std::vector<Side> old_side_;         // at which the last step began
  std::vector<char> started_outside_;  // until the first step
  std::vector<double> no_outputs_;
};

/// K a moving box: unknowns u, F = (I - hA) u - u_k - h f.
class CatchingUpBox final : public CatchingUp {
public:
  CatchingUpBox(const SweepingSystem& system, const TimeGrid& grid);

  Vec x() const override { return u_.get(); }
  Matrix create_jacobian() const override;
  void begin(const Step& step, Vec lower, Vec upper, Vec guess) override;
  bool predict(Vec guess) override;
  bool predicts() const override { return true; }
  void residual(Vec u, Vec f) override;
  void row_terms(Vec u, Vec terms) override;
  void jacobian(Vec u, Mat jacobian) override;
  Degenerate degenerate() const override { return Degenerate::at_bound; }
  void settle(Vec u) override;
  void accept(Vec u, Vec f) override;
  bool set_step(double h) override;

private:
  void find_bounds(double t);
  void refuse_empty(const TimeGrid& grid) const;
  std::vector<Side> observe(Vec u);

  Matrix K_, abs_K_;      // I - hA
  Vector lower_, upper_;  // at the end of the step
  Vector rhs_, rhs_terms_, work_;
};

/// K a moving polyhedron: unknowns (u, mu) on each rank, with the rows of AB (20) written out,
///
///     F_u = (I - hA) u - u_k - h f - G' mu,      F_mu = G u - g,   mu >= 0.
///
/// Steps are solved by ProximalNewton, which redundant faces do not disturb; its regularised matrix is also
/// the Jacobian offered to SNESVI, because the exact one is singular where faces in contact are dependent.
class CatchingUpPolyhedron final : public CatchingUp {
public:
  CatchingUpPolyhedron(const SweepingSystem& system, const TimeGrid& grid);

  Vec x() const override { return x_.get(); }
  Matrix create_jacobian() const override;
  void begin(const Step& step, Vec lower, Vec upper, Vec guess) override;
  bool predict(Vec guess) override;
  bool predicts() const override { return true; }
  std::string obstacle() override;
  void residual(Vec u, Vec f) override;
  void row_terms(Vec u, Vec terms) override;
  void jacobian(Vec u, Mat jacobian) override;  // regularised
  void derivative(Vec u, Mat matrix) override;
  Degenerate degenerate() const override { return Degenerate::off_bound; }
  void settle(Vec u) override;
  void accept(Vec u, Vec f) override;
  void visit(StateVisitor& visitor) override;
  bool set_step(double h) override;

private:
  void move_faces(double t);
  void find_terms_of_g();
  void assemble();
  void find_unit_faces();
  void find_held(Vec u);
  std::vector<Side> observe(Vec u);

  double t_new_ = 0.0;
  PetscInt components_ = 0;  // of this rank; its faces follow
  Matrix K_;                 // I - hA
  Matrix G_;                 // at the end of the step
  Vector g_, g_terms_;
  Matrix S_, abs_S_;  // [K, -G'; G, 0]
  Vector rhs_, rhs_terms_, residual_, terms_, x_, push_;
  std::optional<ProximalNewton> newton_;
  struct UnitFace {
    PetscInt face;     // local
    PetscInt unknown;  // global
    double entry;
  };
  std::vector<UnitFace> unit_faces_;   // faces that read one component: held exactly
  bool any_unit_face_ = false;         // on some rank
  std::optional<PetscInt> zero_face_;  // scene number of a face that reads nothing
  enum class Solved { not_tried, yes, no } solved_ = Solved::not_tried;
  std::vector<char> held_;  // faces in contact
};

}  // namespace sweepvi
