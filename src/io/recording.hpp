#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "io/table_file.hpp"
#include "sweepvi/petsc.hpp"

namespace sweepvi {

/// One dataset of a trajectory: entries that ranks own in the solver's order, stored in the scene's. An entry
/// is one number, or as many as `extents` say.
struct Quantity {
  std::string name;  ///< "/x"
  std::string description;
  std::string units = "1";
  FieldSpec::Type type = FieldSpec::Type::real;
  std::vector<hsize_t> extents = {};     ///< shape of an entry; empty: one number
  std::vector<std::string> names = {};   ///< as FieldSpec::names
  std::string order = {};                ///< as FieldSpec::order
  std::vector<PetscInt> positions = {};  ///< place in the file of each entry of this rank; -1: left out
  PetscInt total = 0;                    ///< entries in the file, over all ranks
  bool summed = false;                   ///< a row holds the sum over the steps since the last one
  /// Fills this rank's entries, row-major, as they are after the step taken last. @note Collective.
  std::function<void(double*)> read = {};
};

/// What a run records of itself; time and solver come on top. What it reads from must outlive it.
struct Recording {
  std::vector<Quantity> quantities = {};
  /// This rank's events of the last step, which ended at t, in the scene's numbers; empty: there are none to
  /// tell of. @note Not collective.
  std::function<std::vector<Event>(double t)> events = {};
  std::string impulse_units = "1";
  /// Estimate of the error of x now, see hybrid.hpp; empty: there is none.
  std::function<double()> error = {};
  std::optional<std::vector<std::int64_t>> elements = {};  ///< numbers of the columns, if only some are kept
};

}  // namespace sweepvi
