#pragma once

#include "sweepvi/petsc.hpp"

namespace sweepvi {

/// The point of a step that was judged last, with F and ratio there: so that nobody who asks again about the
/// same numbers has them evaluated again. What PETSc counts (PetscObjectState) tells whether a vector was
/// written to since.
class JudgedPoint {
public:
  explicit JudgedPoint(MPI_Comm comm) : comm_(comm) {}

  void forget() { ratio_ = -1.0; }
  double ratio() const { return ratio_; }
  /// `point` was judged, and f is F there. @param inside  the point is within its bounds, on all ranks
  void set(Vec point, Vec f, double ratio, bool inside);
  /// SNESVI is about to begin: it writes its start u once, to project it on the box.
  void expect_projection(Vec u) { projection_ = inside_ && u == twin_.vector && twin_.untouched(); }
  /// Whether u has the numbers of the point, and f is still F there. @note Collective.
  bool is(Vec u);

private:
  struct Seen {
    Vec vector = nullptr;
    PetscObjectState state = 0;
    void take(Vec now);
    bool untouched() const;
  };
  bool same_here(Vec u) const;

  MPI_Comm comm_;
  double ratio_ = -1.0;  // below 0: there is none
  bool inside_ = false, projection_ = false;
  Seen point_, f_;
  Seen twin_;  // has the numbers of the point
};

}  // namespace sweepvi
