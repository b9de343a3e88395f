#pragma once

#include <cstddef>
#include <vector>

#include "dvi/zhuravlev_ivanov.hpp"

namespace sweepvi {

/// Of one oscillator, one after the other.
enum Unknown { of_s, of_v, of_lambda_s, of_lambda_v, unknowns };

inline OscillatorState state_at(const double* u, PetscInt i) {
  const double* own = u + std::ptrdiff_t{unknowns} * i;
  return {own[of_s], own[of_v], own[of_lambda_s], own[of_lambda_v]};
}

inline void put(const OscillatorState& state, double* u, PetscInt i) {
  double* own = u + std::ptrdiff_t{unknowns} * i;
  own[of_s] = state.s;
  own[of_v] = state.v;
  own[of_lambda_s] = state.lambda_s;
  own[of_lambda_v] = state.lambda_v;
}

/// Each oscillator's step, its acceleration linearised in x_i and x_i' about the point looked at last. Reads
/// vectors of the process: for one scope.
class ZhuravlevIvanov::Oscillators {
public:
  explicit Oscillators(const ZhuravlevIvanov& dvi)
      : kappa_(dvi.kappa_),
        old_(dvi.u_.get()),
        a_(dvi.a_.get()),
        x_(dvi.x_hat_.get()),
        velocity_(dvi.velocity_hat_.get()),
        by_x_(dvi.slope_x_.get()),
        by_velocity_(dvi.slope_velocity_.get()),
        terms_(dvi.force_terms_.get()) {
    step_.h = dvi.h_;
    step_.theta = dvi.options_.theta;
    step_.gamma = dvi.options_.gamma;
    if (!dvi.options_.regulator) return;
    step_.mu1 = dvi.options_.regulator->mu1;
    step_.mu2 = dvi.options_.regulator->mu2;
  }

  /// Valid until the next.
  const OscillatorStep& operator[](PetscInt i) {
    step_.old = state_at(old_.data(), i);
    step_.kappa = kappa_[static_cast<std::size_t>(i)];
    step_.a = a_[i] - by_x_[i] * x_[i] - by_velocity_[i] * velocity_[i];
    step_.by_x = by_x_[i];
    step_.by_velocity = by_velocity_[i];
    step_.terms = terms_[i];
    step_.velocity_hat = velocity_[i];
    return step_;
  }

private:
  const std::vector<double>& kappa_;
  ReadArray old_, a_, x_, velocity_, by_x_, by_velocity_, terms_;
  OscillatorStep step_;
};

}  // namespace sweepvi
