#pragma once

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "app/command_line.hpp"
#include "io/process_state.hpp"
#include "io/recording.hpp"
#include "io/scene.hpp"
#include "sweepvi/dvi.hpp"
#include "sweepvi/hybrid.hpp"

namespace sweepvi::app {

/// What `check` prints, line by line: a name and a text.
using Lines = std::vector<std::pair<std::string, std::string>>;

/// A scene made ready to march: its process, and what of it is recorded and reported. One implementation for
/// each kind of process; all methods are collective unless they say otherwise.
class Case {
public:
  virtual ~Case() = default;

  virtual Dvi& dvi() = 0;
  /// The process of the scheme `hybrid`; null with the other schemes.
  virtual HybridProcess* hybrid() { return nullptr; }
  /// What a run records. Reads from this case, which must outlive it.
  virtual Recording recording(const OutputSpec& output) const = 0;
  /// What the unknowns are, in a word or two. @note Not collective.
  virtual std::string form() const = 0;
  virtual std::int64_t constraints() const = 0;        ///< as the scene counts them
  virtual std::int64_t edge_cut() const { return 0; }  ///< couplings between ranks
  /// How many constraints of this rank were hit or released in the last step. @note Not collective.
  virtual std::int64_t contact_changes() const = 0;
  /// Where the process's entities stand in the scene. @note Not collective.
  virtual StateOrder state_order() const = 0;
  /// What `check` has to say about the model; `unknowns` of a step in all.
  virtual Lines report(std::int64_t unknowns) const = 0;
};

/// How many constraints the events of a step are about: a constraint's follow each other.
std::int64_t count_constraints(const std::vector<StepEvent>& events);

/// Reads the scene that `line` names, and puts its solver options into the database.
/// @throws Error (bad_input) on every rank.  @note Collective.
Scene load(MPI_Comm comm, const CommandLine& line);

/// Checks, classifies and deals out over the ranks what a scene describes. The scene's matrices are emptied.
/// @throws Error (bad_input) on every rank.  @note Collective.
std::unique_ptr<Case> make_case(MPI_Comm comm, Scene& scene);

// One file for each, called by make_case.
std::unique_ptr<Case> make_linear_case(MPI_Comm comm, Scene& scene);      ///< homsp and the Euler schemes
std::unique_ptr<Case> make_lagrangian_case(MPI_Comm comm, Scene& scene);  ///< moreau-jean
std::unique_ptr<Case> make_sweeping_case(MPI_Comm comm, Scene& scene);    ///< catching-up
std::unique_ptr<Case> make_tracking_case(MPI_Comm comm, Scene& scene);  ///< zhuravlev-ivanov with a reference
std::unique_ptr<Case> make_impact_case(MPI_Comm comm, Scene& scene);    ///< zhuravlev-ivanov, one or a chain

}  // namespace sweepvi::app
