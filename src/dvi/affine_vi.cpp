#include "dvi/affine_vi.hpp"

#include <algorithm>

#include "petsc/sparse.hpp"

namespace sweepvi {

AffineVi::AffineVi(Matrix M, Vector q, Vector lower, Vector upper, Vector u0)
    : M_(std::move(M)),
      abs_M_(absolute_copy(M_.get())),
      q_(std::move(q)),
      abs_q_(duplicate(q_.get())),
      lower_(std::move(lower)),
      upper_(std::move(upper)),
      u_(std::move(u0)),
      work_(duplicate(q_.get())) {
  check(VecCopy(q_.get(), abs_q_.get()));
  check(VecAbs(abs_q_.get()));
}

Matrix AffineVi::create_jacobian() const {
  Matrix jacobian;
  check(MatDuplicate(M_.get(), MAT_COPY_VALUES, jacobian.put()));
  return jacobian;
}

void AffineVi::begin(const Step&, Vec lower, Vec upper, Vec guess) {
  check(VecCopy(lower_.get(), lower));
  check(VecCopy(upper_.get(), upper));
  check(VecCopy(u_.get(), guess));
}

void AffineVi::row_terms(Vec u, Vec terms) {
  check(VecCopy(u, work_.get()));
  check(VecAbs(work_.get()));
  check(MatMultAdd(abs_M_.get(), work_.get(), abs_q_.get(), terms));
}

void AffineVi::settle(Vec u) {
  const WriteArray values(u);
  const ReadArray l(lower_.get());
  const ReadArray b(upper_.get());
  for (PetscInt i = 0; i < values.size(); ++i)
    values[i] = std::min(std::max(values[i], l[i]), b[i]);
}

double AffineVi::penetration() const {
  double worst = 0.0;
  {
    const ReadArray u(u_.get());
    const ReadArray l(lower_.get());
    const ReadArray b(upper_.get());
    for (PetscInt i = 0; i < u.size(); ++i)
      worst = std::max({worst, l[i] - u[i], u[i] - b[i]});
  }
  MPI_Allreduce(MPI_IN_PLACE, &worst, 1, MPI_DOUBLE, MPI_MAX, comm());
  return worst;
}

PetscInt AffineVi::active() const {
  const ReadArray u(u_.get());
  const ReadArray l(lower_.get());
  const ReadArray b(upper_.get());
  PetscInt count = 0;
  for (PetscInt i = 0; i < u.size(); ++i)
    count += u[i] <= l[i] || u[i] >= b[i] ? 1 : 0;
  return count;
}

}  // namespace sweepvi
