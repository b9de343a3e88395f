#pragma once

#include <string>
#include <utility>
#include <vector>

namespace sweepvi::app {

/// Verbs of the service, and what they are for. They belong to a program of its own, sweepvi-serve, which
/// needs neither MPI nor PETSc.
const std::vector<std::pair<std::string, std::string>>& service_verbs();

/// If the words begin with one of these verbs (or `help` and one of them), becomes sweepvi-serve, which
/// stands beside this program. Returns otherwise.
/// @throws Error (bad_input) if it is not there
void become_service(const std::vector<std::string>& words);

}  // namespace sweepvi::app
