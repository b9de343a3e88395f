#pragma once

#include <mpi.h>

#include <string>

namespace sweepvi {

/// Where HDF5 opens, flushes or closes a file on several ranks, a rank whose MPI-IO fails leaves the others
/// waiting for it for ever. While an object of this class is there such a rank says what failed, and ends the
/// program on all ranks (exit code 5).
class EndAtMpiIoFailure {
public:
  /// @param path  of the file, for the message
  EndAtMpiIoFailure(MPI_Comm comm, const std::string& path);
  ~EndAtMpiIoFailure();
  EndAtMpiIoFailure(const EndAtMpiIoFailure&) = delete;
  EndAtMpiIoFailure& operator=(const EndAtMpiIoFailure&) = delete;

  /// What the message ends with: what is kept.
  static void say(const std::string& kept);
};

}  // namespace sweepvi
