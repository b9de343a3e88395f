#pragma once

#include <mpi.h>

#include <optional>
#include <stdexcept>
#include <string>

namespace sweepvi {

/// What the program returns; the numbers are part of the command line's contract.
enum class ExitCode : int {
  done = 0,        ///< every step certified
  internal = 1,    ///< a bug
  bad_input = 2,   ///< bad usage, scene or data; nothing was computed or written
  unsolved = 3,    ///< a step could not be solved or certified
  stopped = 4,     ///< stopped by a signal or a limit
  output = 5,      ///< output could not be written
  uncertified = 6  ///< done, but with a certificate too loose to be one
};

/// A failure with the exit code it leads to. The message says what is wrong, where, what was found and
/// expected, and what to do.
class Error : public std::runtime_error {
public:
  Error(ExitCode code, const std::string& message) : std::runtime_error(message), code_(code) {}
  ExitCode code() const noexcept { return code_; }

private:
  ExitCode code_;
};

/// Shorthand for the most frequent kind.
class InputError : public Error {
public:
  explicit InputError(const std::string& message) : Error(ExitCode::bad_input, message) {}
};

/// Throws the complaint of the lowest complaining rank on every rank; returns if nobody complains.
/// @note Collective on `comm`.
void agree(MPI_Comm comm, const std::optional<Error>& complaint);

/// Runs `work` on this rank and agrees on its outcome, so that an Error on one rank cannot skip a collective
/// call that the others reach.
/// @note Collective on `comm`; `work` itself must not be collective.
template <class Work>
void agreed(MPI_Comm comm, Work&& work) {
  std::optional<Error> complaint;
  try {
    work();
  } catch (const Error& error) {
    complaint = error;
  } catch (const std::exception& error) {
    complaint = Error(ExitCode::internal, error.what());
  }
  agree(comm, complaint);
}

}  // namespace sweepvi
