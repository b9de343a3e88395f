#pragma once

#include <string>

#include "sweepvi/step_solver.hpp"
#include "sweepvi/time_march.hpp"

namespace sweepvi::app {

/// "could not be certified: ...", for the message of a step or problem that no attempt solved.
std::string why_unsolved(const StepReport& report, const CertificateOptions& certificate);

/// "done, but not certified: ...", where the tolerance was set too loose for that.
std::string why_uncertified(const CertificateOptions& certificate);

/// "step 17, t = 0.17 s: " and why, of the step that a march could not take.
std::string failure_text(const TimeMarch& march, const StepReport& report);

}  // namespace sweepvi::app
