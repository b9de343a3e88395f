#pragma once

#include <mpi.h>

#include <map>
#include <string>
#include <vector>

#include "app/command_line.hpp"
#include "sweepvi/petsc.hpp"

namespace sweepvi::app {

/// Puts a scene's own PETSc options into the database at their rank: below -sweepvi_petscrc, PETSC_OPTIONS
/// and the command line (`--set petsc.options` stands between the last two).
void insert_scene_options(const CommandLine& line, const std::string& options, bool from_set);

/// Options, and whether anybody read them.
using OptionsRead = std::map<std::string, bool>;

/// An options database of its own for as long as this lives. It begins as a copy of the one before it; what
/// is put into it leaves no trace there.
class OptionsScope {
public:
  /// @param read  gets this scope's options when it ends
  explicit OptionsScope(OptionsRead& read);
  ~OptionsScope();
  OptionsScope(const OptionsScope&) = delete;
  OptionsScope& operator=(const OptionsScope&) = delete;

  /// Puts options in, above all but those of the command line.
  /// @throws Error (bad_input) if PETSc does not take them
  void insert(const CommandLine& line, const std::string& options);

private:
  OptionsRead& read_;
  PetscOptions options_ = nullptr;
};

/// After the last scope: options that were read in one of them count as read, and those that were not count
/// as given.
void give_back(const OptionsRead& read);

/// Options of the database that nobody read; reported on standard error by rank 0, with the
/// nearest known name.
std::vector<std::string> report_unused_options(MPI_Comm comm);

}  // namespace sweepvi::app
