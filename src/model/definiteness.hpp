#pragma once

#include <vector>

#include "petsc/sparse.hpp"

namespace sweepvi {

/// Whether x' A x > 0 for all x != 0, and how that is known.
struct Definiteness {
  enum class How {
    dominance,  ///< rows are diagonally dominant (Gershgorin): no eigenvalue of the symmetric part is below 0
    factored,   ///< L D L' of it: the signs of D are those of its eigenvalues (Sylvester)
    estimated   ///< too much fill to factor; Lanczos' bounds of its smallest eigenvalue
  } how = How::dominance;
  bool definite = true;
  double form = 0.0;              ///< x' A x of the vector found if it is not, max |x_i| = 1
  std::vector<PetscInt> largest;  ///< rows of the largest |x_i|, at most eight of them

  const char* how_text() const;
};

/// Examines the symmetric part of a matrix, scaled to a diagonal of ones, so that units do not count. What is
/// singular up to rounding is not definite. Dominance is looked at first; then the fill of a factorization is
/// counted on rank 0 (approximate minimum degree order), which is done where it takes at most `allowed`
/// multiplications and a quarter of the memory there is; else 80 steps of Lanczos: a Ritz value below 0
/// proves that the matrix is not definite, one above 0 by more than its residual is taken for the smallest
/// eigenvalue. Sources: Davis, ACM TOMS 31 (2005) 587-591 (L D L' row by row); Parlett, The Symmetric
/// Eigenvalue Problem, 13.2.
/// @note Collective; all ranks get the same.
Definiteness examine_definiteness(Mat matrix, double allowed = 2e9);

}  // namespace sweepvi
