#pragma once

namespace sweepvi {

/// Gains of a twisting controller in the coordinates (s, v) of Zhuravlev and Ivanov, HO (3): v' gets
/// R^{-1} (-mu1 sgn(s) - mu2 sgn(v)), so x'' gets -mu1 - mu2 sgn(s) sgn(v) off the wall.
struct Regulator {
  double mu1 = 0.0, mu2 = 0.0;  ///< > 0 [m/s^2]
};

/// Whether the gains bring an oscillator to rest in finite time against any force of at most `bound` per unit
/// mass: HO's condition bound < mu2 < mu1 - bound.
inline bool gains_suffice(const Regulator& regulator, double bound) {
  return bound < regulator.mu2 && regulator.mu2 < regulator.mu1 - bound;
}

}  // namespace sweepvi
