#pragma once

#include <map>
#include <optional>
#include <string>

namespace sweepvi {

// A scene that somebody else handed in may name any file of this machine. A process that reads such scenes is
// confined first, for good: from then on, documents name what is on a list and nothing else, and HDF5 files
// may not lead to other files.

/// @param files  for each name that documents may use, where the file is
void confine_files(std::map<std::string, std::string> files);

bool files_are_confined();

/// Where the file that a document calls `name` is; nothing if it is not on the list.
/// @pre files_are_confined()
std::optional<std::string> confined_file(const std::string& name);

}  // namespace sweepvi
