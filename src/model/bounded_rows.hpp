#pragma once

#include <cmath>
#include <cstdint>
#include <vector>

#include "petsc/sparse.hpp"

namespace sweepvi {

/// One entry of a product of matrices, as far as it is known.
struct BoundedEntry {
  PetscInt column = 0;
  double high = 0.0, low = 0.0;  ///< the value is high + low, |low| at most rounding of high
  double bound = 0.0;            ///< how far that may be from the product of the data as they were meant
  double arithmetic = 0.0;       ///< how far from that of the data as they are; part of `bound`
  double magnitude = 0.0;        ///< the same product of the absolute values: the size of its terms
  bool written = true;           ///< no computed number is among its factors, see `was_written`

  double value() const { return high + low; }
  bool within_bound() const { return std::abs(high + low) <= bound; }
  /// |value| over the size of its terms: how much was left when they cancelled.
  double ratio() const { return magnitude > 0.0 ? std::abs(high + low) / magnitude : 0.0; }
};

/// A sparse row of them, sorted by column.
using BoundedRow = std::vector<BoundedEntry>;

/// Largest distance of a number from what it was meant to be: half a unit in the last place, and nothing for
/// integers and for binary fractions of up to 32 bits, which nothing was rounded for.
double data_bound(double value);

/// Whether a number has the look of one that somebody wrote: an integer, a binary fraction of up to 32 bits,
/// or a decimal number of up to nine digits. Its error is at most `data_bound`. Any other may come from a
/// computation (a change of coordinates, say) and carry the rounding of everything that went into it.
bool was_written(double value);

/// The rows of a matrix this rank owns, in the uncertainty of its data. @note Not collective.
std::vector<BoundedRow> bounded_rows(Mat matrix);

/// rows * matrix, in doubled precision with a running bound of the error, of the data's and of arithmetic:
/// for s = sum_j p_j a_j each product and sum is split into its rounded value and its error (Knuth 1969;
/// Dekker, Numer. Math. 18 (1971) 224-242), and what is lost even so is counted,
///
///     bound(s) = sum_j bound(p_j) (|a_j| + bound(a_j)) + |p_j| bound(a_j) + (what low lost).
///
/// A bound of 0 therefore means that the value is exact. Columns of `rows` are rows of `matrix`, wherever
/// they live. @note Collective on the matrix's communicator.
std::vector<BoundedRow> multiply(const std::vector<BoundedRow>& rows, Mat matrix);

/// Sum over common columns, in doubled precision. The operands' own bounds are not looked at.
double dot(const BoundedRow& a, const BoundedRow& b);

/// The values, rounded to doubles, without those that may be zero: within their bound, or rounding of
/// computed numbers.
SparseRow rounded(const BoundedRow& row);

/// The same for data that are meant as they are: without those that arithmetic alone may have left.
SparseRow at_face_value(const BoundedRow& row);

}  // namespace sweepvi
