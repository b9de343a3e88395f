#pragma once

#include <mpi.h>

#include <filesystem>
#include <string>

namespace sweepvi {

/// Memory that can still be taken [B]; infinite where nothing is known.
struct Memory {
  double node = 0.0;     ///< by all processes of this node together
  std::string source;    ///< of that number, as messages name it
  double process = 0.0;  ///< by this process alone: `ulimit -v`
};

/// What Linux says is left: MemAvailable and free swap, or less where the control groups of this process
/// (batch systems, containers) allow less. The option -sweepvi_memory_limit [GB], of a node, replaces all of
/// it.
/// @param root  where /proc and /sys are looked for
Memory available_memory(const std::filesystem::path& root = "/");

/// "3.2 GB".
std::string memory_text(double bytes);

/// Complains if `bytes` that this rank is about to take are not there: before a file's word about its size is
/// believed.
/// @param what  subject and verb of the complaint, as in "m.mtx:2: 2147483647 rows take"
/// @throws Error (bad_input).  @note Not collective.
void require_memory(double bytes, const std::string& what);

/// The same where every rank is about to take `bytes`, its own number of them.
/// @throws Error (bad_input) on every rank.  @note Collective on `comm`.
void require_memory(MPI_Comm comm, double bytes, const std::string& what);

}  // namespace sweepvi
