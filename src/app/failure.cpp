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

std::string why_uncertified(const CertificateOptions& certificate) {
  return fmt::format(
      "done, but not certified: -sweepvi_certificate_rtol {:.3g} is above {:.0e}; its default is {:.0e}",
      certificate.rtol, CertificateOptions::loosest, CertificateOptions{}.rtol);
}

std::string failure_text(const TimeMarch& march, const StepReport& report) {
  const PetscInt number = march.steps_taken() + 1;
  const std::string step = fmt::format("step {}, t = {:.6g} s: ", number, march.grid().time(number));
  if (!report.obstacle.empty()) return step + report.obstacle;
  return step + "the step " + why_unsolved(report, march.solver().certificate());
}

}  // namespace sweepvi::app
