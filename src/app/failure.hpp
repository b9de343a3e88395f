#pragma once

#include <string>

#include "sweepvi/step_solver.hpp"

namespace sweepvi::app {

/// "could not be certified: ...", for the message of a step or problem that no attempt solved.
std::string why_unsolved(const StepReport& report, const CertificateOptions& certificate);

}  // namespace sweepvi::app
