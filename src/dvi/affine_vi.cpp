#include "dvi/affine_vi.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>

#include "dvi/no_solution.hpp"
#include "petsc/sparse.hpp"

namespace sweepvi {

namespace {

// The power of two for a row whose products and sums would leave the range of numbers; 1 for others, and
// where q would be lost by it.
double row_factor(std::span<const PetscScalar> values, double q) {
  constexpr double ordinary = 1e150;
  double largest = 0.0;
  for (const double value : values)
    largest = std::max(largest, std::abs(value));
  const bool fits = largest <= ordinary && (largest >= 1.0 / ordinary || largest == 0.0) && q <= ordinary;
  if (fits || !std::isfinite(largest)) return 1.0;
  const int exponent = largest > 0.0 ? std::ilogb(largest) : std::ilogb(q);
  const double factor = std::ldexp(1.0, std::clamp(-exponent, -1020, 1020));
  return q == 0.0 || q * factor >= std::numeric_limits<double>::min() ? factor : 1.0;
}

}  // namespace

AffineVi::AffineVi(Matrix M, Vector q, Vector lower, Vector upper, Vector u0, Vector terms)
    : M_(std::move(M)),
      q_(std::move(q)),
      abs_q_(terms ? std::move(terms) : duplicate(q_.get())),
      lower_(std::move(lower)),
      upper_(std::move(upper)),
      u_(std::move(u0)),
      f_(duplicate(q_.get())),
      terms_(duplicate(q_.get())),
      scale_(duplicate(q_.get())),
      work_(duplicate(q_.get())) {
  {
    const ReadArray constant(q_.get());
    const WriteArray size(abs_q_.get());
    const WriteArray scale(scale_.get());
    for (PetscInt i = 0; i < size.size(); ++i)
      size[i] = std::max(size[i], std::abs(constant[i]));
    const PetscInt first = row_range(M_.get()).first;
    for_each_row(M_.get(), [&](PetscInt row, auto, auto values) {
      scale[row - first] = row_factor(values, size[row - first]);
    });
  }
  check(MatDiagonalScale(M_.get(), scale_.get(), nullptr));
  abs_M_ = absolute_copy(M_.get());
  for (const Vector* part : {&q_, &abs_q_})
    check(VecPointwiseMult(part->get(), part->get(), scale_.get()));
}

void AffineVi::unscale(Vec f) const {
  check(VecPointwiseDivide(f, f, scale_.get()));
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
  {
    const WriteArray values(u);
    const ReadArray l(lower_.get());
    const ReadArray b(upper_.get());
    for (PetscInt i = 0; i < values.size(); ++i)
      values[i] = std::min(std::max(values[i], l[i]), b[i]);
  }
  residual(u, f_.get());
  row_terms(u, terms_.get());
  {
    const WriteArray inverse(terms_.get());
    for (PetscInt i = 0; i < inverse.size(); ++i)
      inverse[i] = inverse[i] > 0.0 ? std::min(1.0 / inverse[i], std::numeric_limits<double>::max()) : 0.0;
  }
  check(MatMultTranspose(abs_M_.get(), terms_.get(), work_.get()));
  const ReadArray f(f_.get());
  const ReadArray inverse(terms_.get());
  const ReadArray weights(work_.get());
  const WriteArray values(u);
  const ReadArray l(lower_.get());
  const ReadArray b(upper_.get());
  for (PetscInt i = 0; i < values.size(); ++i) {
    const double bound = f[i] > 0.0 ? l[i] : b[i];  // where F pushes
    if (bound <= PETSC_NINFINITY || bound >= PETSC_INFINITY) continue;
    const double change = std::abs(values[i] - bound) * std::max(weights[i], inverse[i]);
    if (change <= held_rtol && change < std::abs(f[i]) * inverse[i]) values[i] = bound;
  }
}

std::string AffineVi::diagnosis() {
  constexpr std::size_t most = 8;
  const auto found =
      prove_no_solution(M_.get(), q_.get(), abs_q_.get(), lower_.get(), upper_.get(), u_.get());
  if (!found) return {};
  const std::vector<PetscInt>& rows = found->faces;
  const std::size_t named = std::min(most, rows.size());
  return fmt::format("there is no solution: what F has to be in row{} {}{} excludes every point of the box",
                     rows.size() == 1 ? "" : "s",
                     fmt::join(rows.begin(), rows.begin() + static_cast<std::ptrdiff_t>(named), ", "),
                     rows.size() > named ? fmt::format(" and {} more", rows.size() - named) : "");
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
