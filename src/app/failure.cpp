#include "app/failure.hpp"

#include <fmt/format.h>

namespace sweepvi::app {

std::string why_unsolved(const StepReport& report, const CertificateOptions& certificate) {
  std::string text = fmt::format(
      "could not be certified: {} after {} iterations in {} attempts, residual {:.3g} of the row "
      "terms (asked for {:.3g})",
      report.reason, report.iterations, report.attempts, report.residual, certificate.rtol);
  if (!report.diagnosis.empty()) text += "; " + report.diagnosis;
  if (!report.linear_failure.empty()) text += "; " + report.linear_failure;
  return text;
}

}  // namespace sweepvi::app
