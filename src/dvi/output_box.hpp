#pragma once

#include <vector>

#include "dvi/level_dvi.hpp"
#include "petsc/vector_value.hpp"

namespace sweepvi {

/// I - h rates, with every diagonal entry in the pattern. @note Collective.
Matrix implicit_euler(Mat rates, double h);

/// HOMSP where outputs are unknowns: u_{a,i} = z_{a,i} stand in the box, and F_{a,i} reads the measure
/// mu_{a,i} (on level r: times a gain), so 0 <= z_{a,i} _|_ mu_{a,i} >= 0 for i <= r* is the box VI itself.
class OutputBox : public LevelDvi {
public:
  Degenerate degenerate() const final { return Degenerate::at_bound; }  // outputs are held where they touch
  void settle(Vec u) final;

protected:
  OutputBox(MPI_Comm comm, double h) : LevelDvi(comm, h) {}

  /// @param places  local index in u of each local output, constraint by constraint, level by level
  void set_places(std::vector<PetscInt> places) { places_ = std::move(places); }
  PetscInt place(std::size_t a, int i) const { return places_[levels_.at(a, i)]; }

  /// Reads outputs and constraint values of the initial state.
  void start_from(Vec u);
  /// Level rule, and the box it makes of the step.
  void begin_levels(Vec lower, Vec upper);
  /// Puts what is at its bound, up to rounding of these terms, exactly there. @return whether anything moved
  bool put_held(Vec u, Vec row_terms_of_u);
  /// Takes the settled u with F = f. @param gains  F on level r over mu, per constraint
  void take(Vec u, Vec f, const std::vector<double>& gains);

  std::vector<PetscInt> places_;

private:
  Vector terms_;
  VectorValue lower_, upper_;       // bounds as they were last written
  std::vector<int> written_;        // for which level and side, by constraint
  std::vector<double> z_new_;       // of the step that is taken
  std::vector<double> held_terms_;  // of rows whose output stood at a bound when they were last put there
};

}  // namespace sweepvi
