#pragma once

#include <filesystem>

namespace sweepvi::service {

/// `sweepvi-serve supervise FOLDER`: runs one attempt to its end, without the daemon. Claims it, or leaves it
/// alone if somebody else has; starts what its order says in a process group of its own; copies what that
/// prints into the job's log; stops it when the attempt is asked to stop (or at SIGUSR1 or SIGTERM), when its
/// time is over or its order says so: SIGUSR1, then SIGTERM, then SIGKILL; leaves its ending in the folder.
/// @return exit code of the supervisor itself: 0 unless it could not work
int supervise(const std::filesystem::path& folder);

}  // namespace sweepvi::service
