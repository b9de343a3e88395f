#pragma once

#include <cstddef>
#include <vector>

namespace sweepvi {

/// A dense factorization M_SS = P L U Q with complete pivoting. Pivots below 1e-13 of the largest entry are
/// none: rows and columns that depend on others up to rounding are left out.
class PivotedLu {
public:
  /// @param matrix  of `members`, numbers in the vectors that it is solved in @param set  S, of these numbers
  PivotedLu(const std::vector<std::vector<double>>& matrix, const std::vector<std::size_t>& members,
            const std::vector<char>& set);

  /// values_S becomes the solution of M_SS y = right_S, 0 for what was left out; other values stay.
  void solve(const std::vector<double>& right, std::vector<double>& values) const;

  /// values_S becomes |M_SS^-1| right_S, the largest that errors of this size may make of it.
  void bound(const std::vector<double>& right, std::vector<double>& values) const;

private:
  std::size_t rank_ = 0;
  std::vector<double> lu_;                   // by steps of elimination, row by row of the whole
  std::vector<std::size_t> rows_, columns_;  // in the order of pivots
};

}  // namespace sweepvi
