#pragma once

#include <string>
#include <vector>

namespace sweepvi::service {

/// `sweepvi fsck [--data FOLDER] [--mend]`: says what is wrong with a data folder in which no daemon works, a
/// line for each thing, and changes nothing. With --mend it does first what a daemon does when it starts:
/// queues that are damaged are set aside, jobs come back from their folders, what was promised to nobody is
/// removed, and what cannot be explained goes to quarantine/.
/// @return the exit code: 0 if nothing is wrong (any more), 2 if something is
/// @throws UsageError  if there is no data folder, or a daemon works there
int act_as_fsck(const std::vector<std::string>& words);

}  // namespace sweepvi::service
