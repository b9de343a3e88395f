#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "app/command_line.hpp"
#include "io/posix_file.hpp"

namespace sweepvi::app {

/// What a sandbox leaves open of the file system.
struct SandboxPaths {
  std::vector<std::filesystem::path> read;  ///< files, and folders with all below
  std::vector<std::filesystem::path>
      write;  ///< folders in which files may be made, changed and removed; devices
};

/// Those of a command line: the documents and the files of its list are read; where -o, --summary, --csv,
/// --progress and --restart point to, is written.
SandboxPaths paths_of(const CommandLine& line, const std::vector<std::string>& listed);

/// A folder below /dev/shm that goes with this object, or with the next one made after this process was
/// killed.
class LockedFolder {
public:
  LockedFolder() = default;
  /// @return none if there can be none
  static LockedFolder make();
  LockedFolder(LockedFolder&&) = default;
  LockedFolder& operator=(LockedFolder&&) = delete;
  ~LockedFolder();

  const std::filesystem::path& path() const { return path_; }

private:
  std::filesystem::path path_;
  PosixFile lock_;
};

/// A process that reads what somebody else handed in, shut in for good by Landlock and seccomp as far as the
/// kernel has them (Linux 5.13 and 3.17): a document that breaks a reader breaks no more than its own job.
///
/// It begins before MPI starts, for all threads to come: no capabilities, no new privileges, no core dumps;
/// of the file system the paths, what MPI starts from (system folders and devices to read, its temporary
/// folder to write). Once MPI is up, close() leaves the paths, the libraries that are in use (to read), what
/// Linux says of this process and the machine's memory, and MPI's session; from then on no thread starts a
/// program or a process, opens a connection, or signals, traces, reads or writes another process.
class Sandbox {
public:
  /// @pre MPI has not started, no thread was made
  /// @throws Error (internal) if the kernel has Landlock and does not take it
  explicit Sandbox(SandboxPaths paths);
  Sandbox(const Sandbox&) = delete;
  Sandbox& operator=(const Sandbox&) = delete;

  /// @throws Error (internal) if the kernel has Landlock or seccomp and does not take it
  void close() const;

  /// "Landlock 4, seccomp": what of it this kernel has.
  static std::string describe();

private:
  SandboxPaths paths_;
  LockedFolder shared_memory_;  // of MPI, where nobody else chose a folder for it
};

}  // namespace sweepvi::app
