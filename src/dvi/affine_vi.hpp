#pragma once

#include "sweepvi/dvi.hpp"

namespace sweepvi {

/// A single box VI as a Dvi of one step: F(u) = M u + q, l <= u <= b. Source: the contract of `sweepvi
/// solve`.
class AffineVi final : public Dvi {
public:
  /// Infinite bounds are PETSC_NINFINITY and PETSC_INFINITY; `u0` is where the solver starts.
  /// @note Collective on M's communicator.
  AffineVi(Matrix M, Vector q, Vector lower, Vector upper, Vector u0);

  MPI_Comm comm() const override { return PetscObjectComm(reinterpret_cast<PetscObject>(M_.get())); }
  Vec state() const override { return u_.get(); }
  Matrix create_jacobian() const override;
  void begin(const Step& step, Vec lower, Vec upper, Vec guess) override;
  void residual(Vec u, Vec f) override { check(MatMultAdd(M_.get(), u, q_.get(), f)); }
  void row_terms(Vec u, Vec terms) override;
  void jacobian(Vec, Mat jacobian) override { check(MatCopy(M_.get(), jacobian, SAME_NONZERO_PATTERN)); }
  std::uint64_t jacobian_version() const override { return 0; }  // constant
  void settle(Vec u) override;                                   // into the box, exactly
  void accept(Vec u, Vec) override { check(VecCopy(u, u_.get())); }
  void visit(StateVisitor& visitor) override { visitor.visit("u", Belongs::state, u_.get()); }
  double penetration() const override;
  PetscInt active() const override;

private:
  Matrix M_, abs_M_;
  Vector q_, abs_q_, lower_, upper_, u_, work_;
};

}  // namespace sweepvi
