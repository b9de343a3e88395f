#pragma once

#include <limits>
#include <vector>

#include "dvi/output_coordinates.hpp"
#include "petsc/affine_rows.hpp"
#include "sweepvi/dvi.hpp"

namespace sweepvi {

/// What the forcing adds to the right side of a step in u = W x + g(t), where g is what outputs see of it
/// (OutputForcing):
///
///     c = (I - h theta R) g_{k+1} - (I + h (1-theta) R) g_k + W phi + J e,
///
/// phi = h f_theta, in rows of level r and of states that are no outputs; 0 on the levels below. There, e is
/// J^{-1} times what phi lacks for AB (32) to hold exactly, h (g_{i+1} - Z f)_theta - (g_{i,k+1} - g_{i,k}):
/// the completion along d_{a,i}. All of that is linear in f and its derivatives at the ends of the step, and
/// the matrices in
///
///     c = c_0 + sum_p N_p f^(p)(t_{k+1}) + O_p f^(p)(t_k),   p <= r - 2,
///
/// have few entries. They are made once.
class ForcedIncrement {
public:
  ForcedIncrement() = default;
  /// @param unseen  g is 0 @param R  companion form of A @param jumps, inverse_jumps  J and its inverse;
  /// null: identity
  /// @note Collective, like all methods.
  ForcedIncrement(const LinearSystem& system, const RelativeDegree& relative_degree,
                  const OutputCoordinates& coordinates, bool unseen, Mat R, Mat jumps, Mat inverse_jumps,
                  double h, double theta);

  /// Writes the rows of c that may be other than 0.
  void find(const Step& step, Vec c);

private:
  struct Part {
    AffineRows rows;
    int order = 0;  // p
  };
  /// f and its derivatives at a time.
  struct Signals {
    double time = std::numeric_limits<double>::quiet_NaN();
    std::vector<Vector> of_order;
  };
  void find_kept(const RelativeDegree& relative_degree, const OutputCoordinates& coordinates,
                 PetscInt states);
  void add_part(Mat matrix, int order, std::vector<Part>& parts) const;
  void find_signals(double t, Signals& signals) const;
  void add_parts(const std::vector<Part>& parts, const Signals& signals, Vec c) const;

  const Forcing* f_ = nullptr;
  bool direct_ = false;  // c = phi
  double h_new_ = 0.0, h_old_ = 0.0;
  bool constant_ = false;       // c is the same in all steps,
  bool found_ = false;          // and was found
  std::vector<PetscInt> kept_;  // local rows of c that may be other than 0
  std::vector<double> c_0_;     // in them
  std::vector<Part> new_, old_;
  Signals now_, before_;
};

}  // namespace sweepvi
