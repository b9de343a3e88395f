#pragma once

#include "sweepvi/dvi.hpp"

namespace sweepvi {

/// A single box VI as a Dvi of one step: F(u) = M u + q, l <= u <= b. Source: the contract of `sweepvi
/// solve`.
class AffineVi final : public Dvi {
public:
  /// Infinite bounds are PETSC_NINFINITY and PETSC_INFINITY; `u0` is where the solver starts. `terms` is the
  /// size of the terms that each q_i was summed from: its residue is judged against those; |q| where it is
  /// less, or where there are none given. Rows of extreme size (1e150, 1e-150) are scaled, by powers of two.
  /// @note Collective on M's communicator.
  AffineVi(Matrix M, Vector q, Vector lower, Vector upper, Vector u0, Vector terms = {});

  /// f = F(u) of a solver, as it comes from M and q without scaling.
  void unscale(Vec f) const;

  MPI_Comm comm() const override { return PetscObjectComm(reinterpret_cast<PetscObject>(M_.get())); }
  Vec state() const override { return u_.get(); }
  Matrix create_jacobian() const override;
  void begin(const Step& step, Vec lower, Vec upper, Vec guess) override;
  void residual(Vec u, Vec f) override { check(MatMultAdd(M_.get(), u, q_.get(), f)); }
  void row_terms(Vec u, Vec terms) override;
  void jacobian(Vec, Mat jacobian) override { check(MatCopy(M_.get(), jacobian, SAME_NONZERO_PATTERN)); }
  std::uint64_t jacobian_version() const override { return 0; }  // constant
  /// Into the box; and onto a bound to which F pushes, from where no row sees the difference.
  void settle(Vec u) override;
  /// That there is no solution, and which rows say so, if that can be proved.
  std::string diagnosis() override;
  void accept(Vec u, Vec) override { check(VecCopy(u, u_.get())); }
  void visit(StateVisitor& visitor) override { visitor.visit("u", Belongs::state, u_.get()); }
  double penetration() const override;
  PetscInt active() const override;

private:
  Matrix M_, abs_M_;
  Vector q_, abs_q_, lower_, upper_, u_, f_, terms_, scale_, work_;
};

}  // namespace sweepvi
