#pragma once

#include <limits>

#include "sweepvi/dvi.hpp"
#include "sweepvi/linear_system.hpp"
#include "sweepvi/relative_degree.hpp"

namespace sweepvi {

/// What the forcing adds to the outputs z = Z x + g(t):
///
///     g_{a,1} = w0_a,   g_{a,i+1} = C_a A^{i-1} f + g_{a,i}',   so   g_{a,i} = sum_{p=0}^{i-2} (Z
///     f^(p))_{a,i-1-p}, i > 1.
class OutputForcing {
public:
  OutputForcing(const LinearSystem& system, const RelativeDegree& relative_degree);

  /// g(t), laid out like the rows of Z. @note Collective.
  void evaluate(double t, Vec g);

  /// e_{a,i} = h g_{a,i}'_theta - (g_{a,i}(t_new) - g_{a,i}(t_old)) for i < r, 0 on level r: what the
  /// increment h f_theta lacks for AB (32) to hold exactly. @note Collective.
  void increment_defect(const Step& step, double theta, Vec g_old, Vec g_new, Vec defect);

  /// sum_{p=1}^{i-1} (Z f^(p+order))_{a,i-p}: with (Z (A x + f)) it is the derivative of an output, at t, of
  /// its own `order`-th derivative. @note Collective.
  void remaining_rate(double t, int order, Vec rate);

  bool varies() const { return system_.f.varies; }
  /// g is zero at all times: no offset, and no output but those of level r sees the forcing.
  bool vanishes() const { return vanishes_; }

private:
  void find_seen();
  void find_image(double t, int order);
  void map_to_outputs();

  const LinearSystem& system_;
  const RelativeDegree& relative_degree_;
  Vector f_, image_;                                              // layouts of x and of the outputs
  double image_time_ = std::numeric_limits<double>::quiet_NaN();  // image_ is Z f then
  bool vanishes_ = false;
  /// An output below level r that sees the forcing.
  struct Seeing {
    PetscInt number;  // local
    PetscInt above;   // levels above it
    PetscInt end;     // of its entries of Z where f is not 0; they begin where those of the one before end
  };
  std::vector<Seeing> seeing_;
  PetscInt most_above_ = 0;        // of all ranks
  bool local_ = false;             // they see f of our own rank alone, and those entries are all
  std::vector<PetscInt> columns_;  // local
  std::vector<double> values_;
};

}  // namespace sweepvi
