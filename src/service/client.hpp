#pragma once

#include <string>
#include <vector>

namespace sweepvi::service {

/// `sweepvi submit|jobs|watch|fetch|cancel|resume ...`, by its name: the interface from the command line.
/// @param words  those behind the verb
/// @return exit code; that of the job where one was waited for
/// @throws UsageError, RemoteError
int act_as_client(const std::string& name, const std::vector<std::string>& words);

bool is_client_verb(const std::string& verb);

}  // namespace sweepvi::service
