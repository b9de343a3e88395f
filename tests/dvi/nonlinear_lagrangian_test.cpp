// ranks: 1 2 3
// several: *-*.PendulumsKeepTheirEnergy*:*.PendulumsBalance*
// three: NonlinearLagrangian.ALinearSystemInDisguiseMovesAsItself
#include "sweepvi/nonlinear_lagrangian.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "../../examples/pendulum_walls/pendulum_walls.hpp"
#include "dvi/systems.hpp"
#include "petsc/sparse.hpp"

namespace sweepvi::test {
namespace {

/// A LagrangianSystem seen as a nonlinear one: M constant, F = C v + K q - f.
class Disguised final : public NonlinearLagrangian {
public:
  Disguised(const LagrangianSystem& system, bool own_jacobian) : s_(system), own_jacobian_(own_jacobian) {
    work_ = duplicate(s_.q0.get());
  }
  Vector initial_position() const override { return copy(s_.q0.get()); }
  Vector initial_velocity() const override { return copy(s_.v0.get()); }
  std::vector<double> restitution() const override {
    const ReadArray e(s_.e.get());
    return {e.data(), e.data() + e.size()};
  }
  Matrix mass_pattern() const override { return copy(s_.M.get()); }
  void mass(Vec, Mat M) const override { check(MatCopy(s_.M.get(), M, SAME_NONZERO_PATTERN)); }
  void force(double t, Vec q, Vec v, Vec F) const override {
    check(MatMult(s_.K.get(), q, F));
    check(MatMult(s_.C.get(), v, work_.get()));
    check(VecAXPY(F, 1.0, work_.get()));
    s_.f.add_to(F, t, 0, -1.0);
  }
  Matrix gap_pattern() const override { return copy(s_.H.get()); }
  void gaps(Vec q, Vec g) const override { check(MatMultAdd(s_.H.get(), q, s_.g0.get(), g)); }
  void gap_gradient(Vec, Mat H) const override { check(MatCopy(s_.H.get(), H, SAME_NONZERO_PATTERN)); }
  Matrix jacobian_pattern() const override { return add(s_.K.get(), 1.0, s_.C.get()); }
  bool force_jacobian(double, Vec, Vec, double by_q, double by_v, Mat J) const override {
    if (!own_jacobian_) return false;
    for (const auto& [matrix, factor] : {std::pair{s_.K.get(), by_q}, {s_.C.get(), by_v}})
      for_each_row(matrix, [&, by = factor](PetscInt row, auto columns, auto values) {
        for (std::size_t k = 0; k < columns.size(); ++k)
          check(MatSetValue(J, row, columns[k], by * values[k], ADD_VALUES));
      });
    return true;
  }
  bool mass_jacobian(Vec, Vec, double, Mat) const override { return own_jacobian_; }

private:
  static Vector copy(Vec vector) {
    Vector result = duplicate(vector);
    check(VecCopy(vector, result.get()));
    return result;
  }
  static Matrix copy(Mat matrix) {
    Matrix result;
    check(MatDuplicate(matrix, MAT_COPY_VALUES, result.put()));
    return result;
  }
  const LagrangianSystem& s_;
  bool own_jacobian_;
  Vector work_;
};

/// Two coupled masses, three constraints on them, forced and damped.
LagrangianSystem small_system() {
  return LagrangianSystem::dense(PETSC_COMM_WORLD,
                                 {.M = {2.0, 0.5, 0.5, 1.0},
                                  .K = {4.0, -1.0, -1.0, 3.0},
                                  .H = {1.0, 0.0, 0.5, -1.0, 0.0, 1.0},
                                  .q0 = {1.0, 0.3},
                                  .v0 = {-1.0, 0.5},
                                  .C = {0.2, 0.8, -0.8, 0.1},
                                  .f = {Signal{-3.0}, Signal{.amplitude = 1.0, .frequency = 0.5}},
                                  .g0 = {0.0, 0.2, 0.1},
                                  .e = {0.5, 0.9, 0.0}});
}

int ranks() {
  int size = 1;
  MPI_Comm_size(PETSC_COMM_WORLD, &size);
  return size;
}

struct End {
  std::vector<double> x;
  double dissipated = 0.0, balance = 0.0;
  PetscInt impacts = 0;
};

End march(MechanicalDvi& dvi, const TimeGrid& grid) {
  End end;
  const Energy start = dvi.energy();
  TimeMarch time_march(dvi, grid);
  time_march.observe([&](const Step&, const StepReport&) {
    for (const StepEvent& event : dvi.events())
      end.impacts += event.impact ? 1 : 0;
  });
  EXPECT_TRUE(time_march.run().certified);
  EXPECT_EQ(time_march.steps_taken(), grid.steps);
  MPI_Allreduce(MPI_IN_PLACE, &end.impacts, 1, MPIU_INT, MPI_SUM, PETSC_COMM_WORLD);
  const Energy energy = dvi.energy();
  end.dissipated = energy.dissipated;
  end.balance = energy.kinetic + energy.potential + energy.dissipated - start.kinetic - start.potential;
  end.x = everywhere(dvi.position());
  const std::vector<double> v = everywhere(dvi.velocity());
  end.x.insert(end.x.end(), v.begin(), v.end());
  return end;
}

TEST(NonlinearLagrangian, ALinearSystemInDisguiseMovesAsItself) {
  const LagrangianSystem system = small_system();
  const bool serial = ranks() == 1;
  const TimeGrid grid{0.0, 5.0, serial ? 250 : 60};
  for (const Detection detection : {Detection::predicted, Detection::midpoint, Detection::current}) {
    if (!serial && detection != Detection::predicted) continue;
    const MoreauJeanOptions options{.theta = 0.6, .detection = detection};
    const End expected = march(*make_moreau_jean(system, options, grid), grid);
    EXPECT_GE(expected.impacts, 5);
    for (const bool own : {true, false}) {
      const Disguised disguised(system, own);
      const End end = march(*make_moreau_jean(disguised, options, grid), grid);
      // Both solve the same equations to the certificate's target of 1e-14; some ten impacts amplify that.
      EXPECT_LE(distance(end.x, expected.x), 1e-10) << name_of(detection) << (own ? "" : ", differences");
      EXPECT_NEAR(end.dissipated, expected.dissipated, 1e-10);
      EXPECT_EQ(end.impacts, expected.impacts);
    }
  }
}

// Central and one-sided differences of functions of order 1 to 10 are good to 1e-7; a wrong term shows as 1.
TEST(NonlinearLagrangian, DerivativesOfThePendulumsAreChecked) {
  const PendulumWalls carts(PETSC_COMM_WORLD, {.count = 4});
  const Vector q = carts.initial_position();
  const Vector v = carts.initial_velocity();
  EXPECT_LE(jacobian_error(carts, 0.0, q.get(), v.get()), 1e-6);

  /// The same with one derivative left out, or one wrong.
  class Wrong final : public NonlinearLagrangian {
  public:
    enum class What { mass, force, gap };
    Wrong(const PendulumWalls& carts, What what) : carts_(carts), what_(what) {}
    Vector initial_position() const override { return carts_.initial_position(); }
    Vector initial_velocity() const override { return carts_.initial_velocity(); }
    std::vector<double> restitution() const override { return carts_.restitution(); }
    Matrix mass_pattern() const override { return carts_.mass_pattern(); }
    void mass(Vec q, Mat M) const override { carts_.mass(q, M); }
    void force(double t, Vec q, Vec v, Vec F) const override { carts_.force(t, q, v, F); }
    Matrix gap_pattern() const override { return carts_.gap_pattern(); }
    void gaps(Vec q, Vec g) const override { carts_.gaps(q, g); }
    void gap_gradient(Vec q, Mat H) const override {
      carts_.gap_gradient(q, H);
      check(MatAssemblyBegin(H, MAT_FINAL_ASSEMBLY));
      check(MatAssemblyEnd(H, MAT_FINAL_ASSEMBLY));
      if (what_ == What::gap) check(MatScale(H, -1.0));
    }
    Matrix jacobian_pattern() const override { return carts_.jacobian_pattern(); }
    bool force_jacobian(double t, Vec q, Vec v, double by_q, double by_v, Mat J) const override {
      return carts_.force_jacobian(t, q, v, by_q, what_ == What::force ? 0.0 : by_v, J);
    }
    bool mass_jacobian(Vec q, Vec a, double factor, Mat J) const override {
      return carts_.mass_jacobian(q, a, what_ == What::mass ? 0.0 : factor, J);
    }

  private:
    const PendulumWalls& carts_;
    What what_;
  };
  for (const Wrong::What what : {Wrong::What::mass, Wrong::What::force, Wrong::What::gap})
    EXPECT_GE(jacobian_error(Wrong(carts, what), 0.0, q.get(), v.get()), 1e-3) << static_cast<int>(what);
}

TEST(NonlinearLagrangian, PendulumsKeepTheirEnergyToSecondOrderInFreeFlight) {
  double previous = 0.0;
  for (const PetscInt steps : {20, 40, 80}) {
    const TimeGrid grid{0.0, 0.4, steps};
    const PendulumWalls carts(PETSC_COMM_WORLD, {.count = 3, .wall = 10.0});
    const End end = march(*make_moreau_jean(carts, {.theta = 0.5}, grid), grid);
    EXPECT_EQ(end.impacts, 0);
    if (previous != 0.0) {
      EXPECT_NEAR(previous / std::abs(end.balance), 4.0, 0.5);
    }
    previous = std::abs(end.balance);
  }
}

TEST(NonlinearLagrangian, PendulumsBalanceToFirstOrderAtImpacts) {
  double previous = 0.0;
  for (const PetscInt steps : {40, 400}) {
    if (ranks() > 1 && steps > 100) continue;
    const TimeGrid grid{0.0, 1.0, steps};
    const PendulumWalls carts(PETSC_COMM_WORLD, {.count = 5});
    const auto dvi = make_moreau_jean(carts, {.theta = 0.5}, grid);
    const End end = march(*dvi, grid);
    EXPECT_GE(end.impacts, 5);
    EXPECT_GT(end.dissipated, 0.5);  // of 12 J
    EXPECT_EQ(dvi->penetration(), 0.0);
    EXPECT_LE(std::abs(end.balance), steps == 40 ? 5e-2 : 5e-3);
    if (previous != 0.0) {
      EXPECT_GE(previous / std::abs(end.balance), 5.0);
    }
    previous = std::abs(end.balance);
  }
  const TimeGrid grid{0.0, 0.5, 20};
  const PendulumWalls by_hand(PETSC_COMM_WORLD, {.count = 5});
  const PendulumWalls by_differences(PETSC_COMM_WORLD, {.count = 5, .own_jacobian = false});
  const End a = march(*make_moreau_jean(by_hand, {.theta = 0.5}, grid), grid);
  const End b = march(*make_moreau_jean(by_differences, {.theta = 0.5}, grid), grid);
  EXPECT_LE(distance(a.x, b.x), 1e-10);  // Newton's method ends where it ends, whatever the derivatives
}

TEST(NonlinearLagrangian, WhatMakesNoSenseIsRefused) {
  const TimeGrid grid{0.0, 1.0, 10};
  const auto complaint = [&](const PendulumWalls::Parameters& parameters, double theta) -> std::string {
    const PendulumWalls carts(PETSC_COMM_WORLD, parameters);
    try {
      make_moreau_jean(carts, {.theta = theta}, grid);
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ExitCode::bad_input);
      return error.what();
    }
    return "";
  };
  EXPECT_NE(complaint({.e = 1.2}, 0.5).find("1.2 of a NonlinearLagrangian is outside [0, 1]"),
            std::string::npos);
  EXPECT_NE(complaint({}, 0.0).find("theta"), std::string::npos);
  EXPECT_NE(complaint({.cart = -1.0, .bob = 0.5}, 0.5).find("gave -0.5 on the diagonal"), std::string::npos);
}

/// A model that says its gaps turn the other way: contacts push into the wall.
class TurnedOver final : public NonlinearLagrangian {
public:
  explicit TurnedOver(const LagrangianSystem& system) : right_(system, true) {}
  Vector initial_position() const override { return right_.initial_position(); }
  Vector initial_velocity() const override { return right_.initial_velocity(); }
  std::vector<double> restitution() const override { return right_.restitution(); }
  Matrix mass_pattern() const override { return right_.mass_pattern(); }
  void mass(Vec q, Mat M) const override { right_.mass(q, M); }
  void force(double t, Vec q, Vec v, Vec F) const override { right_.force(t, q, v, F); }
  Matrix gap_pattern() const override { return right_.gap_pattern(); }
  void gaps(Vec q, Vec g) const override { right_.gaps(q, g); }
  void gap_gradient(Vec q, Mat H) const override {
    right_.gap_gradient(q, H);
    check(MatScale(H, -1.0));
  }
  Matrix jacobian_pattern() const override { return right_.jacobian_pattern(); }
  bool force_jacobian(double t, Vec q, Vec v, double by_q, double by_v, Mat J) const override {
    return right_.force_jacobian(t, q, v, by_q, by_v, J);
  }
  bool mass_jacobian(Vec q, Vec v, double by, Mat M) const override {
    return right_.mass_jacobian(q, v, by, M);
  }

private:
  Disguised right_;
};

TEST(NonlinearMoreauJean, AStepThatPassesThroughAWallFails) {
  // A mass thrown at the wall q = 0 from 0.05 with 1 m/s, and nothing stops it: 10 steps of its speed behind
  // the wall the run fails, and stands where the last good step left it.
  const LagrangianSystem system = LagrangianSystem::dense(
      PETSC_COMM_WORLD,
      {.M = {1.0}, .K = {0.0}, .H = {1.0}, .q0 = {0.05}, .v0 = {-1.0}, .C = {0.0}, .e = {0.0}});
  constexpr double h = 0.0625;
  const TurnedOver model(system);
  const auto dvi = make_moreau_jean(model, {.theta = 0.5}, {0.0, 2.0, 32});
  TimeMarch time_march(*dvi, {0.0, 2.0, 32});
  const StepReport report = time_march.run();
  EXPECT_FALSE(report.certified);
  EXPECT_NE(report.obstacle.find("constraint 0"), std::string::npos) << report.obstacle;
  // -0.05 + k h > 10 h first at k = 11.
  EXPECT_EQ(time_march.steps_taken(), 10);
  EXPECT_NEAR(everywhere(dvi->position()).front(), 0.05 - 10 * h, 1e-12);
  EXPECT_NEAR(dvi->penetration(), 10 * h - 0.05, 1e-12);
}

}  // namespace
}  // namespace sweepvi::test
