#pragma once

#include <vector>

#include "petsc/affine_rows.hpp"
#include "sweepvi/linear_system.hpp"
#include "sweepvi/relative_degree.hpp"

namespace sweepvi {

/// Coordinates u = W x + g(t) in which every output is an unknown of its own: output q stands in the place of
/// its pivot state (RelativeDegree::pivot), the other states stay what they are. Vectors u have the layout of
/// x.
class OutputCoordinates {
public:
  /// @pre  relative_degree.has_pivots, each pivot on the rank of its constraint
  /// @throws Error (internal) on every rank otherwise
  /// @note Collective, like all methods but `position`.
  OutputCoordinates(const LinearSystem& system, const RelativeDegree& relative_degree);

  /// Local place in u of each local output.
  const std::vector<PetscInt>& positions() const { return position_; }
  /// The output at a local place of u, -1 for a state.
  PetscInt output_at(PetscInt place) const { return output_at_[static_cast<std::size_t>(place)]; }

  /// W is the identity: u is x, but for g.
  bool plain() const { return plain_; }
  Matrix to_u_matrix() const;     ///< W
  Matrix to_x_matrix() const;     ///< W^{-1}
  void to_u(Vec x, Vec u) const;  ///< u = W x
  void to_x(Vec u, Vec x) const;  ///< x = W^{-1} u

  /// W A W^{-1}: the rows of levels below r hold one 1, in the place of the next level, exactly.
  Matrix companion() const;

  /// How measures act: u jumps by J mu with mu_{a,i} in the place of z_{a,i}, J = W D there and the identity
  /// on states. Empty if that is the identity everywhere: no measure reaches another constraint's outputs or
  /// a state that is no output.
  Matrix jumps() const;
  /// J^{-1} by a finite Neumann series: J - I leads only to levels nearer to r, or to other states.
  Matrix inverse_jumps(Mat jumps) const;

private:
  Matrix scaling(bool inverse) const;
  void find_positions();
  void find_inverse();

  const LinearSystem& system_;
  const RelativeDegree& relative_degree_;
  std::vector<PetscInt> position_;   // local outputs -> local states
  std::vector<PetscInt> output_at_;  // local states -> local outputs
  Vector scale_;  // W if diagonal_: entry of each output in its row of Z, 1 for other states
  bool diagonal_ = false, plain_ = false;
  Matrix W_, inverse_;  // if not diagonal_
  AffineRows W_rows_, inverse_rows_;
};

}  // namespace sweepvi
